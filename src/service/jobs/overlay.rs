//! A read-only view of the database file. The database library repairs a file that was not closed properly as it
//! opens it; the view keeps such writes in memory.

use redb::backends::FileBackend;
use redb::{BackendError, StorageBackend};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fs::File;
use std::io;
use std::ops::Bound;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The size of a page of the view of the database file, in bytes.
const PAGE: u64 = 4096;

/// A database file and the pages written over it in memory; clones share both.
#[derive(Clone, Debug)]
pub struct Overlay {
    file: Arc<FileBackend>,
    over: Arc<Mutex<Over>>,
}

#[derive(Debug)]
struct Over {
    length: u64,
    pages: BTreeMap<u64, Box<[u8]>>,
}

impl Overlay {
    /// Opens a view of the file at `path`, with nothing written over it.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        let file = FileBackend::new(file).map_err(io::Error::other)?;
        Ok(Self { file: Arc::new(file), over: Arc::new(Mutex::new(Over { length, pages: BTreeMap::new() })) })
    }

    fn lock(&self) -> MutexGuard<'_, Over> {
        self.over.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads the page with this number from the database file, padded with zeros beyond the end of the file.
    fn below(&self, number: u64) -> io::Result<Box<[u8]>> {
        let mut page = vec![0; PAGE as usize].into_boxed_slice();
        let here = self.file.len()?.saturating_sub(number * PAGE).min(PAGE);
        if here > 0 {
            self.file.read(number * PAGE, &mut page[..here as usize])?;
        }
        Ok(page)
    }
}

/// Returns the pages that a range of `length` bytes from `offset` touches: for each page its number, the first byte
/// of the range within the page, and the number of bytes.
fn pages(offset: u64, length: usize) -> impl Iterator<Item = (u64, usize, usize)> {
    let end = offset + length as u64;
    (offset / PAGE..end.div_ceil(PAGE)).map(move |number| {
        let first = offset.max(number * PAGE);
        let last = end.min((number + 1) * PAGE);
        (number, (first - number * PAGE) as usize, (last - first) as usize)
    })
}

impl StorageBackend for Overlay {
    fn len(&self) -> io::Result<u64> {
        Ok(self.lock().length)
    }

    fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        let over = self.lock();
        if offset.checked_add(out.len() as u64).is_none_or(|end| end > over.length) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let mut rest = out;
        for (number, first, length) in pages(offset, rest.len()) {
            let (piece, behind) = rest.split_at_mut(length);
            match over.pages.get(&number) {
                Some(page) => piece.copy_from_slice(&page[first..first + length]),
                None => piece.copy_from_slice(&self.below(number)?[first..first + length]),
            }
            rest = behind;
        }
        Ok(())
    }

    fn set_len(&self, length: u64) -> io::Result<()> {
        self.lock().length = length;
        Ok(())
    }

    fn sync_data(&self) -> io::Result<()> {
        Ok(())
    }

    fn write(&self, offset: u64, data: &[u8]) -> io::Result<()> {
        let mut over = self.lock();
        let mut rest = data;
        for (number, first, length) in pages(offset, data.len()) {
            let (piece, behind) = rest.split_at(length);
            let page = match over.pages.entry(number) {
                Entry::Occupied(page) => page.into_mut(),
                Entry::Vacant(page) => page.insert(self.below(number)?),
            };
            page[first..first + length].copy_from_slice(piece);
            rest = behind;
        }
        over.length = over.length.max(offset + data.len() as u64);
        Ok(())
    }

    // The lock on the file is a shared one: the reader excludes writers, but not other readers.
    fn try_lock_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<bool, BackendError> {
        self.file.try_lock_shared_range(start, end)
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
