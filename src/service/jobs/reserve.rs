//! Room on the disk that is held back: where the rest is full, jobs can still be deleted and ended, which takes some pages
//! before it gives any back.

use super::files::OWN;
use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;

/// A group of changes rewrites at most some thousand pages of 4 KiB.
const BYTES: usize = 4 << 20;

/// A file of that room.
#[derive(Debug)]
pub struct Reserve {
    path: PathBuf,
}

impl Reserve {
    /// The file at `path`.
    pub fn at(path: PathBuf) -> Self {
        Self { path }
    }

    /// Holds the room, which may be held already.
    ///
    /// # Errors
    /// Those of the disk, as where it is full; nothing is held then.
    pub fn hold(&self) -> io::Result<()> {
        if fs::metadata(&self.path).is_ok_and(|data| data.len() == BYTES as u64) {
            return Ok(());
        }
        let held = OpenOptions::new().write(true).create(true).truncate(true).mode(OWN).open(&self.path).and_then(
            |mut file| {
                // Written, since a length alone holds no room.
                (0..BYTES / PIECE.len()).try_for_each(|_| file.write_all(&PIECE))?;
                file.sync_all()
            },
        );
        if held.is_err() {
            self.release();
        }
        held
    }

    /// Whether there is so much room beside.
    pub fn is_beside(&self, bytes: usize) -> bool {
        let path = self.path.with_extension("part");
        let tried =
            OpenOptions::new().write(true).create(true).truncate(true).mode(OWN).open(&path).and_then(|mut file| {
                (0..bytes.div_ceil(PIECE.len())).try_for_each(|_| file.write_all(&PIECE))?;
                file.sync_all()
            });
        // One that stays is written over by the next.
        let _ = fs::remove_file(&path);
        tried.is_ok()
    }

    /// Gives the room back.
    pub fn release(&self) {
        if let Err(error) = fs::remove_file(&self.path)
            && error.kind() != io::ErrorKind::NotFound
        {
            tracing::warn!(%error, "the room held back cannot be given back");
        }
    }
}

static PIECE: [u8; 64 << 10] = [0; 64 << 10];
