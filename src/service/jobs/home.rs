//! The place of the database file, and its replacement by a rebuilt one: all that can be read is written to a new
//! file beside it, which is then renamed; the damaged file is kept, under a name that contains the date.

use super::files::{self, OWN};
use super::marks::Marks;
use super::salvage::{Salvaged, Source, salvage};
use super::watched::Sums;
use super::{JobId, Record};
use jiff::Timestamp;
use redb::Database as Redb;
use std::ffi::OsString;
use std::fs::{self, OpenOptions};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A function that returns the rows of the jobs that this process has in memory.
pub type Memory = Box<dyn Fn() -> Vec<(JobId, Record)> + Send + Sync>;

/// The path of a database file, and the identity (device and inode) of the file opened at that path.
pub struct Home {
    path: PathBuf,
    /// The checksums of the blocks of the database file.
    sums: Arc<Mutex<Sums>>,
    file: Mutex<(u64, u64)>,
    memory: OnceLock<Memory>,
    rebuilds: AtomicU64,
    in_vain: AtomicBool,
}

impl Home {
    /// Records the identity of the file at `path`, with the checksums of its blocks.
    ///
    /// # Errors
    /// There is no file at `path`.
    pub fn of(path: &Path, sums: Arc<Mutex<Sums>>) -> io::Result<Self> {
        Ok(Self {
            path: path.to_owned(),
            sums,
            file: Mutex::new(identity(path)?),
            memory: OnceLock::new(),
            rebuilds: AtomicU64::new(0),
            in_vain: AtomicBool::new(false),
        })
    }

    /// The path of the database file of the job store.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the opened database file is still at its path.
    pub fn is_in_place(&self) -> bool {
        let file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        identity(&self.path).is_ok_and(|there| there == *file)
    }

    /// Sets the function that returns the rows of jobs in memory, from which a rebuild restores rows that a damaged
    /// database file has lost.
    pub fn remember(&self, memory: Memory) {
        // `set` fails if a function is set already, which is harmless: all such functions return the rows of one set of
        // jobs.
        let _ = self.memory.set(memory);
    }

    /// Returns the number of times that the database file was rebuilt.
    pub fn rebuilds(&self) -> u64 {
        self.rebuilds.load(Relaxed)
    }

    /// Counts a rebuild of the database file.
    pub fn count_rebuild(&self) {
        self.rebuilds.fetch_add(1, Relaxed);
    }

    /// Whether another rebuild may repair a damaged database file: no earlier rebuild was in vain.
    pub fn may_be_rebuilt(&self) -> bool {
        !self.in_vain.load(Relaxed)
    }

    /// Records that a rebuild of the database file did not help: if the machine damages what is written, each attempt
    /// would take the disk space of a file.
    pub fn give_up(&self) {
        self.in_vain.store(true, Relaxed);
    }

    /// Replaces the database file by a new one with all that can be read of `source`, and returns the new database.
    ///
    /// # Errors
    /// I/O errors of the disk; the damaged file stays in place.
    pub fn rebuild(&self, source: &Source<'_>, reason: &io::Error) -> io::Result<(Redb, Salvaged)> {
        tracing::error!(%reason, "{} is built anew from what can be read", self.path.display());
        let part = beside(&self.path, "part");
        let rebuilt = self.write(source, &part);
        if rebuilt.is_err() {
            let _ = fs::remove_file(&part);
        }
        let (rebuilt, salvaged) = rebuilt?;
        let Salvaged { jobs, remembered, lost, aside } = &salvaged;
        self.count_rebuild();
        for (id, what) in lost {
            tracing::warn!(job.id = %id, "job {id} has lost its {}", what.join(", "));
        }
        let (lost, aside) = (lost.len(), aside.display());
        tracing::warn!(
            jobs,
            remembered,
            lost,
            "the store was built anew with {jobs} jobs; {lost} have lost something, and the damaged file stays as {aside}"
        );
        Ok((rebuilt, salvaged))
    }

    fn write(&self, source: &Source<'_>, part: &Path) -> io::Result<(Redb, Salvaged)> {
        let folder = self.path.parent().unwrap_or(Path::new("."));
        let new = match fs::remove_file(part) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => OpenOptions::new().read(true).write(true).create_new(true).mode(OWN).open(part)?,
        };
        let starts = || Marks::all(folder).ok()?.into_iter().map(|(start, _)| start).max();
        let start = match source {
            Source::Tables(database) => database.starts().ok(),
            Source::Leaves(..) => None,
        };
        let start = start.or_else(starts).unwrap_or(0);
        let remembered = self.memory.get().map(|memory| memory()).unwrap_or_default();
        let sums = Sums::default();
        let (rebuilt, salvaged) = salvage(source, new, sums.clone(), start, remembered)?;
        let file = identity(part)?;
        let aside = beside(&self.path, &format!("damaged-{}", Timestamp::now().strftime("%Y%m%dT%H%M%S%3fZ")));
        // The old file is linked to its new name before the rename, so that a file has the name of the database at
        // any moment.
        if fs::hard_link(&self.path, &aside).is_err() {
            fs::copy(&self.path, &aside)?;
        }
        // The identity of the new file is recorded before the rename, so that a check in between finds the file
        // missing from its path, and the database is not written meanwhile.
        *self.file.lock().unwrap_or_else(PoisonError::into_inner) = file;
        fs::rename(part, &self.path)?;
        *self.sums.lock().unwrap_or_else(PoisonError::into_inner) = sums;
        files::sync(folder)?;
        Ok((rebuilt, Salvaged { aside, ..salvaged }))
    }
}

/// Appends `.` and a suffix to the path of the database file, for a file beside it.
fn beside(path: &Path, what: &str) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(".");
    name.push(what);
    name.into()
}

/// Returns the identity (device and inode) of the file at `path`.
fn identity(path: &Path) -> io::Result<(u64, u64)> {
    let data = fs::metadata(path)?;
    Ok((data.dev(), data.ino()))
}
