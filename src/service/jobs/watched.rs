//! The database file while it is open: every block that is read must be as it was at opening or as last written.
//!
//! The database library follows page numbers without checking their checksums. A page corrupted on the disk could
//! lead it into a cycle, whose recursion exhausts the stack and ends the process. So the file is checksummed block by
//! block when it is opened, once its pages have been checked against each other; from then on a block that differs
//! from its checksum is an I/O error.

use redb::backends::FileBackend;
use redb::{BackendError, StorageBackend};
use std::fs::File;
use std::hash::{DefaultHasher, Hasher};
use std::io;
use std::ops::{Bound, Range};
use std::sync::{Arc, PoisonError, RwLock};

/// The size of a block with a checksum, in bytes: one page of the database file.
const BLOCK: u64 = 4096;

/// The checksums of the blocks of a database file; `None` for blocks that were never written. The checksums are kept
/// when the file is reopened.
#[derive(Clone, Debug, Default)]
pub struct Sums(Arc<RwLock<Option<Vec<Option<u64>>>>>);

/// A database file with the checksums of its blocks.
#[derive(Debug)]
pub struct Watched {
    file: FileBackend,
    sums: Sums,
}

impl Watched {
    /// Creates a backend of the database over `file`, with the checksums of an earlier opening, if there was one.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn over(file: File, sums: Sums) -> io::Result<Self> {
        let file = FileBackend::new(file).map_err(io::Error::other)?;
        Ok(Self { file, sums })
    }

    /// Computes the checksums of all blocks of the database file, unless that has been done.
    fn sum_up(&self) -> io::Result<()> {
        let mut sums = self.sums.0.write().unwrap_or_else(PoisonError::into_inner);
        if sums.is_none() {
            let length = self.file.len()?;
            let block = |number| self.block(number, length).map(|block| Some(sum(&block)));
            *sums = Some((0..length.div_ceil(BLOCK)).map(block).collect::<io::Result<_>>()?);
        }
        Ok(())
    }

    /// Reads the block `number` of a file of `length` bytes, without checking its checksum.
    fn block(&self, number: u64, length: u64) -> io::Result<Vec<u8>> {
        let start = number * BLOCK;
        let mut block = vec![0; length.saturating_sub(start).min(BLOCK) as usize];
        self.file.read(start, &mut block)?;
        Ok(block)
    }
}

/// Returns the numbers of the blocks of the file that a range of `bytes` bytes from `offset` touches.
fn blocks(offset: u64, bytes: usize) -> Range<u64> {
    offset / BLOCK..(offset + bytes as u64).div_ceil(BLOCK)
}

/// Returns the block `number` as a part of `bytes`, which begin at `offset` in the file, if they contain the whole
/// block.
fn whole(bytes: &[u8], offset: u64, number: u64) -> Option<&[u8]> {
    let start = usize::try_from((number * BLOCK).checked_sub(offset)?).ok()?;
    bytes.get(start..start + BLOCK as usize)
}

/// Returns the checksum of a block, which detects faults but not malicious changes, which could change the checksum
/// too.
fn sum(block: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    hasher.write(block);
    hasher.finish()
}

impl StorageBackend for Watched {
    fn len(&self) -> io::Result<u64> {
        self.file.len()
    }

    fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        let sums = self.sums.0.read().unwrap_or_else(PoisonError::into_inner);
        self.file.read(offset, out)?;
        let Some(sums) = &*sums else { return Ok(()) };
        let length = self.file.len()?;
        for number in blocks(offset, out.len()) {
            let Some(Some(known)) = sums.get(number as usize) else { continue };
            let found = match whole(out, offset, number) {
                Some(block) => sum(block),
                None => sum(&self.block(number, length)?),
            };
            if found != *known {
                let told = format!("block {number} of the database is not as it was written");
                return Err(io::Error::new(io::ErrorKind::InvalidData, told));
            }
        }
        Ok(())
    }

    fn set_len(&self, length: u64) -> io::Result<()> {
        let mut sums = self.sums.0.write().unwrap_or_else(PoisonError::into_inner);
        let before = self.file.len()?;
        self.file.set_len(length)?;
        if let Some(sums) = &mut *sums {
            sums.resize(length.div_ceil(BLOCK) as usize, None);
            // The change of length has extended or cut the block at the former or the new end of the file, so that
            // the checksum of that block is unknown.
            if let Some(last) = sums.get_mut((before.min(length) / BLOCK) as usize) {
                *last = None;
            }
        }
        Ok(())
    }

    fn sync_data(&self) -> io::Result<()> {
        self.file.sync_data()
    }

    fn write(&self, offset: u64, data: &[u8]) -> io::Result<()> {
        let mut sums = self.sums.0.write().unwrap_or_else(PoisonError::into_inner);
        let written = self.file.write(offset, data);
        if let Some(sums) = &mut *sums {
            let length = self.file.len()?;
            for number in blocks(offset, data.len()) {
                let found = match (whole(data, offset, number), &written) {
                    (Some(block), Ok(())) => Some(sum(block)),
                    // A block that was written in part, or whose write failed, is read back for its checksum.
                    _ => self.block(number, length).ok().map(|block| sum(&block)),
                };
                let number = number as usize;
                sums.resize(sums.len().max(number + 1), None);
                sums[number] = found;
            }
        }
        written
    }

    fn close(&self) -> io::Result<()> {
        self.file.close()
    }

    fn try_lock_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<bool, BackendError> {
        let locked = self.file.try_lock_range(start, end)?;
        if locked {
            // The checksums are computed here, since the file is now locked against other writers, and nothing has
            // been read from it yet.
            self.sum_up()?;
        }
        Ok(locked)
    }

    fn try_lock_shared_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<bool, BackendError> {
        self.file.try_lock_shared_range(start, end)
    }

    fn unlock_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<(), BackendError> {
        self.file.unlock_range(start, end)
    }

    fn query_lock_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<bool, BackendError> {
        self.file.query_lock_range(start, end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::FileExt;

    #[test]
    fn a_block_that_changes_by_itself_is_not_read() {
        let path = std::env::temp_dir().join(format!("dvi-watched-{}", std::process::id()));
        fs::write(&path, vec![7; 3 * BLOCK as usize + 100]).unwrap();
        let file = || File::options().read(true).write(true).open(&path).unwrap();
        let sums = Sums::default();
        let watched = Watched::over(file(), sums.clone()).unwrap();
        watched.sum_up().unwrap();
        file().write_all_at(&[8], 2 * BLOCK + 5).unwrap();
        let mut bytes = vec![0; 2 * BLOCK as usize];
        watched.read(0, &mut bytes).unwrap();
        assert_eq!(watched.read(BLOCK, &mut bytes).unwrap_err().kind(), io::ErrorKind::InvalidData);
        assert!(watched.read(2 * BLOCK + 4000, &mut [0]).is_err());
        // The database file is reopened with the checksums of its first opening.
        let anew = Watched::over(file(), sums).unwrap();
        anew.sum_up().unwrap();
        assert!(anew.read(2 * BLOCK, &mut [0]).is_err());
        // Writes update the checksums, for whole blocks, for parts of a block, and beyond the end of the file.
        anew.write(2 * BLOCK, &vec![9; BLOCK as usize]).unwrap();
        anew.write(3 * BLOCK + 50, &[1; 100]).unwrap();
        anew.set_len(6 * BLOCK).unwrap();
        let mut all = vec![0; 6 * BLOCK as usize];
        anew.read(0, &mut all).unwrap();
        file().write_all_at(&[0], 2 * BLOCK + 60).unwrap();
        assert!(anew.read(0, &mut all).is_err());
        fs::remove_file(&path).unwrap();
    }
}
