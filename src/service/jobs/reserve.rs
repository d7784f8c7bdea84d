//! Reserved space on the disk: when the rest is full, jobs can still be deleted and ended, which takes some database
//! pages before it frees any.

use super::files::OWN;
use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;

/// The size of the reserved disk space, in bytes: a group of changes to the database rewrites at most some thousand
/// pages of 4 KiB.
const BYTES: usize = 4 << 20;

/// A file that occupies the reserved disk space.
#[derive(Debug)]
pub struct Reserve {
    path: PathBuf,
}

impl Reserve {
    /// Refers to the disk space reserved by the file at `path`, which may not exist yet.
    pub fn at(path: PathBuf) -> Self {
        Self { path }
    }

    /// Writes the reserve, unless it has its full size already.
    ///
    /// # Errors
    /// I/O errors of the disk, for instance if it is full; nothing is reserved then.
    pub fn hold(&self) -> io::Result<()> {
        if fs::metadata(&self.path).is_ok_and(|data| data.len() == BYTES as u64) {
            return Ok(());
        }
        let held = OpenOptions::new().write(true).create(true).truncate(true).mode(OWN).open(&self.path).and_then(
            |mut file| {
                // The bytes of the reserve are written, since setting the length of a file alone reserves no disk
                // space.
                (0..BYTES / PIECE.len()).try_for_each(|_| file.write_all(&PIECE))?;
                file.sync_all()
            },
        );
        if held.is_err() {
            self.release();
        }
        held
    }

    /// Whether the disk has `bytes` bytes of free space in addition to the reserved space.
    pub fn is_beside(&self, bytes: usize) -> bool {
        let path = self.path.with_extension("part");
        let tried =
            OpenOptions::new().write(true).create(true).truncate(true).mode(OWN).open(&path).and_then(|mut file| {
                (0..bytes.div_ceil(PIECE.len())).try_for_each(|_| file.write_all(&PIECE))?;
                file.sync_all()
            });
        // If the trial file cannot be removed, the next call overwrites it.
        let _ = fs::remove_file(&path);
        tried.is_ok()
    }

    /// Frees the reserved disk space.
    pub fn release(&self) {
        if let Err(error) = fs::remove_file(&self.path)
            && error.kind() != io::ErrorKind::NotFound
        {
            tracing::warn!(%error, "the room held back cannot be given back");
        }
    }
}

static PIECE: [u8; 64 << 10] = [0; 64 << 10];
