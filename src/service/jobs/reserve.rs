//! Reserved room on the disk: when the rest is full, jobs can still be deleted and ended, which takes some pages before
//! it frees any.

use super::files::OWN;
use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;

/// The size of the reserve, in bytes: a group of changes rewrites at most some thousand pages of 4 KiB.
const BYTES: usize = 4 << 20;

/// A file that occupies the reserved room.
#[derive(Debug)]
pub struct Reserve {
    path: PathBuf,
}

impl Reserve {
    /// The file at `path`.
    pub fn at(path: PathBuf) -> Self {
        Self { path }
    }

    /// Writes the file, unless it has its full size already.
    ///
    /// # Errors
    /// I/O errors of the disk, for instance if it is full; nothing is reserved then.
    pub fn hold(&self) -> io::Result<()> {
        if fs::metadata(&self.path).is_ok_and(|data| data.len() == BYTES as u64) {
            return Ok(());
        }
        let held = OpenOptions::new().write(true).create(true).truncate(true).mode(OWN).open(&self.path).and_then(
            |mut file| {
                // Written out, since a length alone reserves no room.
                (0..BYTES / PIECE.len()).try_for_each(|_| file.write_all(&PIECE))?;
                file.sync_all()
            },
        );
        if held.is_err() {
            self.release();
        }
        held
    }

    /// Whether there are `bytes` of room besides the reserve.
    pub fn is_beside(&self, bytes: usize) -> bool {
        let path = self.path.with_extension("part");
        let tried =
            OpenOptions::new().write(true).create(true).truncate(true).mode(OWN).open(&path).and_then(|mut file| {
                (0..bytes.div_ceil(PIECE.len())).try_for_each(|_| file.write_all(&PIECE))?;
                file.sync_all()
            });
        // If it cannot be removed, the next call overwrites it.
        let _ = fs::remove_file(&path);
        tried.is_ok()
    }

    /// Frees the reserved room.
    pub fn release(&self) {
        if let Err(error) = fs::remove_file(&self.path)
            && error.kind() != io::ErrorKind::NotFound
        {
            tracing::warn!(%error, "the room held back cannot be given back");
        }
    }
}

static PIECE: [u8; 64 << 10] = [0; 64 << 10];
