//! A store is looked at, before it is opened, in a process of its own: what a damaged page makes of the library of the database
//! ends that process, and is a damaged store to this one, which has it built anew.

use super::database::Database;
use super::guarded::guarded;
use super::home::Home;
use super::is_damage;
use super::overlay::Overlay;
use super::salvage::Source;
use super::tables;
use redb::Builder;
use rustix::process::{Resource, Rlimit, setrlimit};
use std::ffi::OsStr;
use std::io::{self, Read};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};

/// The code with which a process ends that has found a store damaged, or has mended one and could not mend all of it.
pub const DAMAGED: u8 = 1;

/// A process that follows pages in a circle may not end by itself. It has a while to start on a busy machine, and then the time
/// that the slowest disk takes to read the file.
const START: Duration = Duration::from_secs(30);
const BYTES_PER_SECOND: u64 = 4 << 20;

/// The time between two looks at it.
const LOOK: Duration = Duration::from_millis(1);

/// Whether the pages of the store in `folder` are what was written, read through in the way that a start would. Where that cannot be
/// said, since another process uses the store or it is of another version, whoever opens it is told.
pub fn is_sound(folder: &Path) -> bool {
    // Whoever asked is told enough by its end.
    let _ = setrlimit(Resource::Core, Rlimit { current: Some(0), maximum: Some(0) });
    let Ok(overlay) = Overlay::open(&folder.join("jobs.redb")) else { return true };
    let redb = match guarded(|| Ok(Builder::new().create_with_backend(overlay.clone())?)) {
        Ok(redb) => redb,
        Err(error) => return !is_damage(&error),
    };
    // Rows without digests cannot be told from others: those of the first format are left to the start.
    guarded(|| tables::has_first_rows(&redb)).unwrap_or(false) || Database::looked_at(redb).is_sound()
}

/// Has the store in `folder` looked at by a process of `program`, and built anew if it is damaged; whether it was.
///
/// # Errors
/// Those of the disk.
pub fn heal(program: &OsStr, folder: &Path) -> io::Result<bool> {
    let path = folder.join("jobs.redb");
    let bytes = match path.metadata() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        data => data?.len(),
    };
    // One that has yet to be made.
    if bytes == 0 {
        return Ok(false);
    }
    let most = START + Duration::from_secs(bytes / BYTES_PER_SECOND);
    let run = |action| run(program, action, folder, most);
    match run("examine")?.0 {
        Some(DAMAGED) => tracing::error!("pages of the database are damaged; it is built anew"),
        Some(_) => return Ok(false),
        None => tracing::error!("pages of the database lead in a circle; it is built anew"),
    }
    // From its tables, if they can be read.
    let (mended, told) = run("repair")?;
    if matches!(mended, Some(0 | DAMAGED)) && run("examine")?.0 == Some(0) {
        told.lines().for_each(|line| tracing::warn!("{line}"));
        return Ok(true);
    }
    let reason = io::Error::new(io::ErrorKind::InvalidData, "its tables cannot be read");
    Home::of(&path, Arc::default())?.rebuild(&Source::leaves(&path)?, &reason)?;
    Ok(true)
}

/// Runs a process over the store; the code with which it ended by itself, if it did in its time, and what it said.
fn run(program: &OsStr, action: &str, folder: &Path, most: Duration) -> io::Result<(Option<u8>, String)> {
    let mut process = Command::new(program)
        .arg0("dvi")
        .args(["store", action])
        .arg(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()?;
    let out = process.stdout.take();
    let reader = spawn(move || {
        let mut told = String::new();
        // What was said before its end is what there is.
        let _ = out.map(|mut out| out.read_to_string(&mut told));
        told
    });
    let begun = Instant::now();
    while begun.elapsed() < most {
        if let Some(status) = process.try_wait()? {
            let code = status.code().and_then(|code| u8::try_from(code).ok());
            return Ok((code, reader.join().unwrap_or_default()));
        }
        sleep(LOOK);
    }
    process.kill()?;
    process.wait()?;
    Ok((None, reader.join().unwrap_or_default()))
}
