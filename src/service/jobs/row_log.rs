//! The rows of the finished chunks of a sweep, until the table of the sweep is made: a file to which each chunk is
//! appended with its digest, and synced before it counts. The first incomplete or damaged record ends the file: the
//! members of that record and of those after it are solved again, to the same rows.
//!
//! ```text
//! head       the mark (8), the first member, the one behind the last, the accepted steps, the length of the rows
//!            (8 each, little-endian), and the SHA-256 of these numbers and the rows
//! rows       as [`solution::Table`] writes them
//! ```
//!
//! A job that is not durable has its rows in memory, and so have chunks that a full disk refused, until there is
//! space.

use super::files::{OWN, sync};
use crate::digest::{Digest, LENGTH};
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::Path;

/// The bytes with which the record of a finished chunk begins in the file of a sweep's rows.
const MARK: [u8; 8] = *b"dvi rows";

/// The number of integers in the header of the record of a finished chunk.
const NUMBERS: usize = 4;

/// The size of the header of the record of a finished chunk, in bytes.
const HEAD: usize = MARK.len() + 8 * NUMBERS + LENGTH;

/// The record of a finished chunk of a sweep.
#[derive(Debug)]
pub struct Record {
    /// The range of members of the sweep that the chunk contains.
    pub members: Range<usize>,
    /// The total number of accepted steps of the solves of the chunk's members.
    pub steps: u64,
    place: Place,
}

/// The place of the rows of a chunk: the file of the log, or memory.
#[derive(Debug)]
enum Place {
    Memory(Vec<u8>),
    /// The rows of the chunk are in the file of the log, from this offset on.
    File {
        offset: u64,
        bytes: usize,
        digest: Digest,
    },
}

/// The records of the finished chunks of a sweep, with the rows of their members, in the order of their ends.
#[derive(Debug, Default)]
pub struct RowLog {
    file: Option<File>,
    /// The total length of the records in the file of the log, in bytes.
    length: u64,
    records: Vec<Record>,
}

impl RowLog {
    /// Opens the log in the file at `path`, if there is one; a damaged end of the file is cut off.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = match OpenOptions::new().read(true).write(true).open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Self::default()),
            file => file?,
        };
        let mut log = Self { file: None, length: 0, records: Vec::new() };
        let rest = file.metadata()?.len();
        while let Some((record, end)) = read(&file, log.length, rest)? {
            // A chunk of the sweep that was solved twice, for instance by two processes, counts once.
            if log.records.iter().all(|known| is_apart(&known.members, &record.members)) {
                log.records.push(record);
            }
            log.length = end;
        }
        if log.length < rest {
            tracing::warn!(path = %path.display(), "the last rows of a sweep are cut off and made again");
            file.set_len(log.length)?;
        }
        Ok(Self { file: Some(file), ..log })
    }

    /// Adds a finished chunk of the sweep with its rows, as bytes, to the log, in memory only.
    pub fn append(&mut self, members: Range<usize>, steps: u64, rows: Vec<u8>) {
        self.records.push(Record { members, steps, place: Place::Memory(rows) });
    }

    /// Writes the rows of the chunks that are only in memory to the file at `path`, if it is given and the disk accepts
    /// them.
    pub fn save(&mut self, path: Option<&Path>) {
        let Some(path) = path else { return };
        if let Err(error) = self.write(path) {
            tracing::warn!(%error, "the rows of a sweep are kept in memory");
        }
    }

    fn write(&mut self, path: &Path) -> io::Result<()> {
        let file = match &mut self.file {
            Some(file) => file,
            None => {
                let file =
                    OpenOptions::new().read(true).write(true).create(true).truncate(true).mode(OWN).open(path)?;
                path.parent().map_or(Ok(()), sync)?;
                self.length = 0;
                self.file.insert(file)
            }
        };
        let mut end = self.length;
        let mut places = Vec::new();
        for (k, record) in self.records.iter().enumerate() {
            let Place::Memory(rows) = &record.place else { continue };
            let (head, digest) = head(&record.members, record.steps, rows);
            let offset = end + HEAD as u64;
            let written = file.write_all_at(&head, end).and_then(|()| file.write_all_at(rows, offset));
            if let Err(error) = written {
                // On a full disk, an incomplete record of a chunk must not occupy space; the next record overwrites
                // what remains of it.
                let _ = file.set_len(self.length);
                return Err(error);
            }
            end = offset + rows.len() as u64;
            places.push((k, Place::File { offset, bytes: rows.len(), digest }));
        }
        file.sync_data()?;
        self.length = end;
        places.into_iter().for_each(|(k, place)| self.records[k].place = place);
        Ok(())
    }

    /// Returns the records of the finished chunks of the sweep.
    pub fn records(&self) -> &[Record] {
        &self.records
    }

    /// Returns the records of the finished chunks in the order of the sweep's members, with the rows of each, which are
    /// read on demand.
    pub fn in_order(&self) -> impl Iterator<Item = (&Record, io::Result<Vec<u8>>)> {
        let mut records: Vec<&Record> = self.records.iter().collect();
        records.sort_by_key(|record| record.members.start);
        records.into_iter().map(|record| (record, self.rows(record)))
    }

    /// Returns the rows of a chunk, verified against their digest.
    ///
    /// # Errors
    /// I/O errors of the disk; [`io::ErrorKind::InvalidData`] if the rows differ from what was written.
    fn rows(&self, record: &Record) -> io::Result<Vec<u8>> {
        match (&record.place, &self.file) {
            (Place::Memory(rows), _) => Ok(rows.clone()),
            (Place::File { offset, bytes, digest }, Some(file)) => {
                let mut rows = vec![0; *bytes];
                file.read_exact_at(&mut rows, *offset).map_err(|error| match error.kind() {
                    io::ErrorKind::UnexpectedEof => io::ErrorKind::InvalidData.into(),
                    _ => error,
                })?;
                if digest_of(&record.members, record.steps, &rows) == *digest {
                    Ok(rows)
                } else {
                    Err(io::Error::new(io::ErrorKind::InvalidData, "rows of a sweep are not those that were written"))
                }
            }
            (Place::File { .. }, None) => Err(io::ErrorKind::InvalidData.into()),
        }
    }

    /// Drops the chunks whose rows cannot be read from the log, and returns their members.
    pub fn drop_damaged(&mut self) -> Vec<Range<usize>> {
        let is_damaged: Vec<bool> = self.records.iter().map(|record| self.rows(record).is_err()).collect();
        let mut damaged = is_damaged.iter();
        let mut members = Vec::new();
        self.records.retain(|record| {
            let stays = !damaged.next().copied().unwrap_or_default();
            if !stays {
                members.push(record.members.clone());
            }
            stays
        });
        members
    }

    /// Whether the rows of any chunk of the sweep are only in memory.
    #[cfg(test)]
    fn is_in_memory(&self) -> bool {
        self.records.iter().any(|record| matches!(record.place, Place::Memory(_)))
    }
}

fn is_apart(one: &Range<usize>, other: &Range<usize>) -> bool {
    one.end <= other.start || other.end <= one.start
}

/// Encodes the integers of the header of the record of a finished chunk as bytes.
fn numbers(members: &Range<usize>, steps: u64, rows: &[u8]) -> [u8; 8 * NUMBERS] {
    let mut bytes = [0; 8 * NUMBERS];
    let numbers = [members.start as u64, members.end as u64, steps, rows.len() as u64];
    for (place, number) in bytes.as_chunks_mut::<8>().0.iter_mut().zip(numbers) {
        *place = number.to_le_bytes();
    }
    bytes
}

fn digest_of(members: &Range<usize>, steps: u64, rows: &[u8]) -> Digest {
    Digest::of_all(&[&numbers(members, steps, rows), rows])
}

fn head(members: &Range<usize>, steps: u64, rows: &[u8]) -> ([u8; HEAD], Digest) {
    let digest = digest_of(members, steps, rows);
    let mut head = [0; HEAD];
    let (mark, rest) = head.split_at_mut(MARK.len());
    let (counts, sum) = rest.split_at_mut(8 * NUMBERS);
    mark.copy_from_slice(&MARK);
    counts.copy_from_slice(&numbers(members, steps, rows));
    sum.copy_from_slice(digest.bytes());
    (head, digest)
}

/// Reads the record of a chunk at offset `start` of a file of `length` bytes, and returns it with the offset of its
/// end; `None` if there is no complete and intact record.
fn read(file: &File, start: u64, length: u64) -> io::Result<Option<(Record, u64)>> {
    let mut file = file;
    file.seek(SeekFrom::Start(start))?;
    let mut head_bytes = [0; HEAD];
    let offset = start + HEAD as u64;
    if offset > length {
        return Ok(None);
    }
    file.read_exact(&mut head_bytes)?;
    let (words, _) = head_bytes[MARK.len()..].as_chunks::<8>();
    let mut counts = words.iter().take(NUMBERS).map(|word| u64::from_le_bytes(*word));
    let mut count = || counts.next().unwrap_or(u64::MAX);
    let (first, end, steps, bytes) = (count(), count(), count(), count());
    let ends = offset.checked_add(bytes).filter(|ends| *ends <= length);
    let (Ok(first), Ok(end), Ok(bytes), Some(ends)) =
        (usize::try_from(first), usize::try_from(end), usize::try_from(bytes), ends)
    else {
        return Ok(None);
    };
    let mut rows = vec![0; bytes];
    file.read_exact(&mut rows)?;
    let (expected, digest) = head(&(first..end), steps, &rows);
    let record = Record { members: first..end, steps, place: Place::File { offset, bytes, digest } };
    Ok((expected == head_bytes && first < end).then_some((record, ends)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::path::PathBuf;

    /// A temporary file of rows for tests, removed when it is dropped.
    struct Temporary(PathBuf);

    impl Temporary {
        fn new(name: &str) -> Self {
            Self(std::env::temp_dir().join(format!("dvi-rows-{name}-{}", std::process::id())))
        }
    }

    impl Drop for Temporary {
        fn drop(&mut self) {
            let _ = fs::remove_file(&self.0);
        }
    }

    fn all(log: &RowLog) -> Vec<(Range<usize>, u64, Option<Vec<u8>>)> {
        log.in_order().map(|(record, rows)| (record.members.clone(), record.steps, rows.ok())).collect()
    }

    #[test]
    fn chunks_read_back_in_the_order_of_members_and_a_cut_end_is_made_again() {
        let path = Temporary::new("cut");
        let mut log = RowLog::default();
        log.append(10..20, 7, vec![1; 100]);
        assert!(log.is_in_memory() && !path.0.exists());
        log.append(0..10, 5, vec![2; 1000]);
        log.save(Some(&path.0));
        log.append(20..21, 1, vec![]);
        log.save(Some(&path.0));
        let whole = all(&log);
        assert!(!log.is_in_memory() && whole[0] == (0..10, 5, Some(vec![2; 1000])), "{whole:?}");
        drop(log);
        let bytes = fs::read(&path.0).unwrap();
        assert_eq!(all(&RowLog::open(&path.0).unwrap()), whole);
        // A kill may cut the file of rows off at any byte of the last two records.
        for length in (HEAD + 100..bytes.len()).step_by(13) {
            fs::write(&path.0, &bytes[..length]).unwrap();
            let mut log = RowLog::open(&path.0).unwrap();
            let kept = if length >= bytes.len() - HEAD { 2 } else { 1 };
            assert_eq!(log.records().len(), kept, "{length}");
            log.append(30..40, 1, vec![3; 50]);
            log.save(Some(&path.0));
            drop(log);
            assert_eq!(RowLog::open(&path.0).unwrap().records().len(), kept + 1, "{length}");
        }
    }

    #[test]
    fn a_flipped_bit_is_found_at_the_start_and_on_the_way() {
        let path = Temporary::new("flipped");
        let mut log = RowLog::default();
        (0..3).for_each(|k| log.append(10 * k..10 * k + 10, 1, vec![k as u8; 100]));
        log.save(Some(&path.0));
        let bytes = fs::read(&path.0).unwrap();
        for place in 0..bytes.len() {
            let mut flipped = bytes.clone();
            flipped[place] ^= 1;
            fs::write(&path.0, &flipped).unwrap();
            let opened = RowLog::open(&path.0).unwrap();
            assert_eq!(opened.records().len(), place / (HEAD + 100), "{place}");
        }
        let mut flipped = bytes.clone();
        flipped[2 * HEAD + 150] ^= 1;
        fs::write(&path.0, &flipped).unwrap();
        assert!(log.drop_damaged().into_iter().eq(std::iter::once(10..20)));
        assert_eq!(all(&log).len(), 2);
    }
}
