//! Checks of the job database in a child process, before the service opens it. If a damaged page makes the database
//! library crash, only the child process dies; the database counts as damaged and is rebuilt. The child process ends
//! when its standard input is closed, so that it does not outlive a service that is killed, nor keep the database
//! locked.

use super::database::Database;
use super::guarded::guarded;
use super::home::Home;
use super::is_damage;
use super::overlay::Overlay;
use super::salvage::Source;
use super::tables;
use super::tenancy::patiently;
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

/// The exit code of a child process that examined the database of jobs and found it damaged, or repaired it with
/// losses.
pub const DAMAGED: u8 = 1;

/// The time limit of a child process that examines or repairs the database, which may never end by itself if damaged
/// pages form a cycle: the start-up time on a busy machine, and the time in which a slow disk reads the file.
const START: Duration = Duration::from_secs(30);
const BYTES_PER_SECOND: u64 = 4 << 20;

/// The interval between two polls whether the child process that examines or repairs the database has ended.
const LOOK: Duration = Duration::from_millis(1);

/// Whether the pages of the database in `folder` are intact, read in the way in which the service reads them at its
/// start. If that cannot be decided, since another process uses the database or another version wrote it, returns
/// true: opening the database will report the reason.
pub fn is_sound(folder: &Path) -> bool {
    // The exit code of this child process reports enough to its parent, so that no core file is needed.
    let _ = setrlimit(Resource::Core, Rlimit { current: Some(0), maximum: Some(0) });
    let Ok(overlay) = Overlay::open(&folder.join("jobs.redb")) else { return true };
    let open = || guarded(|| Ok(Builder::new().create_with_backend(overlay.clone())?));
    // The wait for the lock of the database must end before the time limit of this child process.
    let redb = match patiently(START / 2, open) {
        Ok(redb) => redb,
        Err(error) => return !is_damage(&error),
    };
    // Rows of jobs in the first format of the database have no digests; they are checked when the service converts
    // them.
    guarded(|| tables::has_first_rows(&redb)).unwrap_or(false) || Database::looked_at(redb).is_sound()
}

/// Returns the time limit of a child process that reads the database at `path`.
///
/// # Errors
/// I/O errors of the disk.
pub fn patience(path: &Path) -> io::Result<Duration> {
    let bytes = match path.metadata() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => 0,
        data => data?.len(),
    };
    Ok(START + Duration::from_secs(bytes / BYTES_PER_SECOND))
}

/// Lets a process of `program` check the database in `folder`, and rebuilds the database if it is damaged. Returns
/// whether it was rebuilt.
///
/// # Errors
/// I/O errors of the disk.
pub fn heal(program: &OsStr, folder: &Path) -> io::Result<bool> {
    let path = folder.join("jobs.redb");
    // If there is no file, or an empty one, the database has yet to be created.
    if path.metadata().map_or(0, |data| data.len()) == 0 {
        return Ok(false);
    }
    let most = patience(&path)?;
    let run = |action| run(program, action, folder, most);
    match run("examine")?.0 {
        Some(DAMAGED) => tracing::error!("pages of the database are damaged; it is built anew"),
        Some(_) => return Ok(false),
        None => tracing::error!("pages of the database lead in a circle; it is built anew"),
    }
    // The database is rebuilt from its tables, if they can be read, and otherwise from its leaf pages.
    let (mended, told) = run("repair")?;
    if matches!(mended, Some(0 | DAMAGED)) && run("examine")?.0 == Some(0) {
        told.lines().for_each(|line| tracing::warn!("{line}"));
        return Ok(true);
    }
    let reason = io::Error::new(io::ErrorKind::InvalidData, "its tables cannot be read");
    Home::of(&path, Arc::default())?.rebuild(&Source::leaves(&path)?, &reason)?;
    Ok(true)
}

/// Runs the command `store ACTION` of `program` on `folder`; returns its exit code (`None` if the process was killed
/// at its time limit or by a signal) and its output.
fn run(program: &OsStr, action: &str, folder: &Path, most: Duration) -> io::Result<(Option<u8>, String)> {
    let mut process = Command::new(program)
        .arg0("dvi")
        .args(["store", action, "--attended"])
        .arg(folder)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()?;
    // The pipe to the standard input of the child process stays open until the process has ended.
    let _attending = process.stdin.take();
    let out = process.stdout.take();
    let reader = spawn(move || {
        let mut told = String::new();
        // After a read error, the output of the child process so far is kept.
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
