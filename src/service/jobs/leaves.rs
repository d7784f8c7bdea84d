//! The rows of a `redb` database file that the library cannot open, for instance since its header is damaged: they
//! are found on the leaf pages without the trees above them, and verified by their digests.
//!
//! A leaf begins with its kind (one byte), a byte of padding, and the number of its rows (two bytes, little-endian).
//! Then come the end offsets of its values, from the beginning of the leaf (four bytes each), the keys (job ids of
//! sixteen bytes each), and the values. Pages begin at multiples of the page size, and a leaf may span several. Free
//! pages contain rows as well, of earlier states of a job: the latest row found is used, so that a recently deleted
//! job may reappear.

use super::seal::unseal;
use super::{JobId, Record};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;

/// The size of a page of the database file, in bytes.
const PAGE: u64 = 4096;

/// The first byte of a leaf page (B-tree leaf) of the database file.
const LEAF: u8 = 1;

/// The sizes of the header of a leaf page, of the end offset of a value, and of a key, in bytes.
const HEAD: usize = 4;
const END: usize = 4;
const KEY: usize = 16;

/// The longest value of a table that is looked for on the pages of a damaged database file, in bytes: longer than a
/// specification may be by default.
const LONGEST: u64 = 64 << 20;

/// A database file whose leaf pages are read one by one.
#[derive(Debug)]
pub struct Leaves {
    file: File,
    length: u64,
}

impl Leaves {
    /// Opens the database file at `path`.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn of(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        Ok(Self { file, length })
    }

    /// Visits every possible value with its key, of any table.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn scan(&self, visit: &mut dyn FnMut(JobId, &[u8])) -> io::Result<()> {
        let mut value = Vec::new();
        self.places(&mut |id, place| {
            value.resize((place.end - place.start) as usize, 0);
            self.file.read_exact_at(&mut value, place.start)?;
            visit(id, &value);
            Ok(())
        })
    }

    /// Returns the latest row of each job, in its stored form.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn rows(&self) -> io::Result<BTreeMap<JobId, Vec<u8>>> {
        let mut rows: BTreeMap<JobId, (Option<Age>, Vec<u8>)> = BTreeMap::new();
        self.scan(&mut |id, sealed| {
            let Some(row) = unseal(id, sealed) else { return };
            let age = age(row);
            if rows.get(&id).is_none_or(|(other, _)| *other < age) {
                rows.insert(id, (age, sealed.to_vec()));
            }
        })?;
        Ok(rows.into_iter().map(|(id, (_, sealed))| (id, sealed)).collect())
    }

    /// Returns every key that is the id of a job.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn names(&self) -> io::Result<BTreeSet<JobId>> {
        let mut names = BTreeSet::new();
        self.places(&mut |id, _| {
            names.insert(id);
            Ok(())
        })?;
        Ok(names)
    }

    fn places(&self, visit: &mut dyn FnMut(JobId, Range<u64>) -> io::Result<()>) -> io::Result<()> {
        let mut table = Vec::new();
        for page in (0..self.length).step_by(PAGE as usize) {
            let rest = self.length - page;
            let mut head = [0; HEAD];
            if rest < PAGE || self.file.read_exact_at(&mut head, page).is_err() || head[0] != LEAF {
                continue;
            }
            let count = usize::from(u16::from_le_bytes([head[2], head[3]]));
            let keys = HEAD + END * count;
            let values = (keys + KEY * count) as u64;
            if count == 0 || values > rest {
                continue;
            }
            table.resize(values as usize, 0);
            self.file.read_exact_at(&mut table, page)?;
            let ends = table[HEAD..keys].as_chunks::<END>().0.iter().map(|end| u64::from(u32::from_le_bytes(*end)));
            let mut start = values;
            for (key, end) in table[keys..].as_chunks::<KEY>().0.iter().zip(ends) {
                let is_place = start >= values && start <= end && end <= rest && end - start <= LONGEST;
                if let Some(id) = JobId::of_key(*key).filter(|_| is_place) {
                    visit(id, page + start..page + end)?;
                }
                start = end;
            }
        }
        Ok(())
    }
}

/// The progress of a job, which orders its rows: whether it has ended, whether it was dismissed, its number of
/// crashes, and whether its results are intact.
type Age = (bool, bool, u32, Reverse<bool>);

fn age(row: &[u8]) -> Option<Age> {
    let record: Record = serde_json::from_slice(row).ok()?;
    let is_damaged = record.ended.as_ref().is_some_and(|ended| ended.damaged);
    Some((record.ended.is_some(), record.dismissed, record.crashes, Reverse(is_damaged)))
}
