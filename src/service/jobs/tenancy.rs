//! The exclusive use of the data folder by one service.
//!
//! The lock of the database belongs to the open file, and every child process has a copy of that file until it
//! executes its own program: if the service is killed at that moment, the child holds the lock for some milliseconds
//! more, and a child process that checks the database at a start holds the lock until it ends. A record lock
//! (`fcntl`) belongs to the process: no child inherits it, and it ends with the process. So a service that has the
//! record lock knows that no other service uses the folder, and that any holder of the database's lock is a process
//! that is about to end; the service waits for it.

use super::files::OWN;
use super::guarded::in_use;
use redb::StorageBackend;
use redb::backends::FileBackend;
use rustix::fs::{FlockOperation, fcntl_lock};
use rustix::io::Errno;
use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::ops::Bound;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// The name of the file in the data folder on which the record lock is taken; the file stays empty.
const NAME: &str = "lock";

/// The interval between two attempts to lock the database of jobs.
const LOOK: Duration = Duration::from_millis(1);

/// The time after which the wait for the lock of the database of jobs is logged.
const LONG: Duration = Duration::from_secs(1);

/// The exclusive use of a data folder by one process, until this value is dropped or the process ends.
#[derive(Debug)]
pub struct Tenancy {
    /// The locked file, which this process opens only once: closing any other descriptor of it would end the lock.
    _lock: File,
}

impl Tenancy {
    /// Takes the exclusive use of `folder`, and waits at most `patience` until the database at `path` is unlocked.
    ///
    /// # Errors
    /// [`io::ErrorKind::ResourceBusy`] if another process uses the folder; I/O errors of the disk.
    pub fn take(folder: &Path, path: &Path, patience: Duration) -> io::Result<Self> {
        let lock = OpenOptions::new().write(true).create(true).truncate(false).mode(OWN).open(folder.join(NAME))?;
        match fcntl_lock(&lock, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(Errno::AGAIN | Errno::ACCESS) => return Err(in_use()),
            // On a file system without record locks, only the lock of the database protects the folder.
            Err(error) => tracing::debug!(%error, "the folder cannot be locked by itself"),
        }
        patiently(patience, || if is_free(path)? { Ok(()) } else { Err(in_use()) })?;
        Ok(Self { _lock: lock })
    }
}

/// Opens a database in a folder whose [`Tenancy`] this process or its parent has: while the database is in use,
/// `open` is called again for at most `patience`. A process that was checking the database for a service that was
/// killed may still hold it, or open it, until that process ends.
///
/// # Errors
/// The errors of `open`.
pub fn patiently<T>(patience: Duration, mut open: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    let begun = Instant::now();
    let mut is_told = false;
    loop {
        match open() {
            Err(error) if error.kind() == io::ErrorKind::ResourceBusy && begun.elapsed() < patience => {}
            opened => return opened,
        }
        if begun.elapsed() > LONG && !is_told {
            is_told = true;
            tracing::warn!("another process still has the database open; waiting until it ends");
        }
        sleep(LOOK);
    }
}

/// Whether the database file at `path` is unlocked, or there is no such file.
fn is_free(path: &Path) -> io::Result<bool> {
    let file = match OpenOptions::new().read(true).write(true).open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(true),
        file => file?,
    };
    // The database library locks the whole file in one way and its parts in another; both locks end as the file is
    // closed.
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => return Ok(false),
        // An error other than a held lock means that the file system lacks this kind of file lock.
        Ok(()) | Err(TryLockError::Error(_)) => {}
    }
    let backend = FileBackend::new(file).map_err(io::Error::other)?;
    Ok(backend.try_lock_range(Bound::Unbounded, Bound::Unbounded).unwrap_or(true))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_database_in_use_is_opened_once_it_is_free_and_other_errors_are_told_at_once() {
        let (mut attempts, minute) = (0, Duration::from_secs(60));
        let mut opened = |free: u32, error: fn() -> io::Error| {
            attempts = 0;
            let opened = patiently(minute, || {
                attempts += 1;
                if attempts < free { Err(error()) } else { Ok(()) }
            });
            (attempts, opened.is_ok())
        };
        assert_eq!(opened(20, in_use), (20, true));
        assert_eq!(opened(20, || io::ErrorKind::StorageFull.into()), (1, false));
        assert_eq!(
            patiently(Duration::ZERO, || Err::<(), _>(in_use())).unwrap_err().kind(),
            io::ErrorKind::ResourceBusy
        );
    }
}
