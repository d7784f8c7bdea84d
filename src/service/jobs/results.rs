//! The results of a solve: short ones as JSON, long ones as [columns](solution::columnar), so that a response reads
//! only the part that it needs. The JSON of long results is generated once, in the worker, for its length and its
//! digest.

use super::spool::Backing;
use crate::digest::{Digest, Fingerprint, Measure};
use solution::columnar::{Columns, PartsIndex, Skeleton, Source, Stored, write_columns, write_whole};
use solution::{Selection, Solution, encodings};
use std::io::{self, Write};
use std::sync::OnceLock;

/// The largest size of short results as JSON, in bytes.
pub const SHORT: usize = 64 << 10;

/// The stored form of a solution.
#[derive(Debug)]
pub enum Results {
    /// As JSON.
    Text(Text),
    /// As columns.
    Columns(Long),
}

/// JSON, and its digest once it has been computed.
#[derive(Debug)]
pub struct Text {
    json: Vec<u8>,
    digest: OnceLock<Digest>,
}

/// Columns, and the fingerprints that identify them.
#[derive(Debug)]
pub struct Long {
    /// The place of the columns.
    pub backing: Backing,
    /// The fingerprint of the JSON that they encode.
    pub json: Fingerprint,
    /// The fingerprint of their index, at the end of the file.
    pub index: Fingerprint,
}

/// Columns opened for reading, and the other parts of their solution.
pub struct Opened {
    /// The columns.
    pub columns: Box<dyn Columns>,
    /// The other parts of the solution.
    pub skeleton: Skeleton,
}

/// The results as JSON exceed the size limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLarge;

/// A solution to be stored.
pub enum Encoded {
    /// Short results as JSON.
    Text(Vec<u8>),
    /// Long results, to be written as columns: the fingerprint of their JSON, and the parts other than columns.
    Columns(Fingerprint, Skeleton),
}

impl Encoded {
    /// Encodes `solution` as JSON if that is short, and otherwise computes the fingerprint of its JSON.
    ///
    /// # Errors
    /// The JSON is longer than `limit` bytes.
    pub fn of(solution: &Solution, limit: usize) -> Result<Self, TooLarge> {
        let mut json = Bounded { bytes: Vec::new(), limit: limit.min(SHORT) };
        // Writing to memory fails only at the bound.
        if encodings::write_json(solution, &mut json).is_ok() {
            json.bytes.shrink_to_fit();
            return Ok(Self::Text(json.bytes));
        }
        let mut measure = io::BufWriter::with_capacity(SHORT, Measure::new(limit));
        encodings::write_json(solution, &mut measure).and_then(|()| measure.flush()).map_err(|_| TooLarge)?;
        let (measure, _) = measure.into_parts();
        Ok(Self::Columns(measure.fingerprint(), Skeleton::of(solution).map_err(|_| TooLarge)?))
    }
}

impl Results {
    /// Encodes `solution`, in memory.
    ///
    /// # Errors
    /// The JSON of `solution` is longer than `limit` bytes.
    pub fn of(solution: &Solution, limit: usize) -> Result<Self, TooLarge> {
        match Encoded::of(solution, limit)? {
            Encoded::Text(json) => Ok(Self::read(json)),
            Encoded::Columns(json, skeleton) => {
                let mut bytes = Vec::new();
                let (trajectory, table) = (&solution.trajectory, solution.table.as_ref());
                let index = write_columns(trajectory, table, &skeleton, &mut bytes).map_err(|_| TooLarge)?;
                let (backing, index) = (Backing::memory(bytes), Fingerprint::of(&index));
                Ok(Self::Columns(Long { backing, json, index }))
            }
        }
    }

    /// The results that a table of a sweep is, in `backing` from its beginning to its end, with the rest of its solution.
    /// The table is never in memory as a whole.
    ///
    /// # Errors
    /// I/O errors of the disk; [`io::ErrorKind::FileTooLarge`] if the JSON is longer than `limit` bytes.
    pub fn of_members(backing: Backing, index: PartsIndex, skeleton: Skeleton, limit: usize) -> io::Result<Self> {
        let (source, _) = backing.open()?;
        let columns = Stored::of_members(source, index, skeleton);
        let mut json = Bounded { bytes: Vec::new(), limit: limit.min(SHORT) };
        match write_whole(&columns, columns.skeleton(), &mut json) {
            Ok(()) => return Ok(Self::read(json.bytes)),
            Err(error) if error.kind() != io::ErrorKind::FileTooLarge => return Err(error),
            Err(_) => {}
        }
        let mut measure = io::BufWriter::with_capacity(SHORT, Measure::new(limit));
        write_whole(&columns, columns.skeleton(), &mut measure)?;
        measure.flush()?;
        let (measure, _) = measure.into_parts();
        let index = columns.index()?;
        drop(columns);
        let (backing, index) = (backing.append(&index)?, Fingerprint::of(&index));
        Ok(Self::Columns(Long { backing, json: measure.fingerprint(), index }))
    }

    /// Results encoded before, as JSON.
    pub fn read(json: Vec<u8>) -> Self {
        Self::Text(Text { json, digest: OnceLock::new() })
    }

    /// JSON read from the disk, verified against its digest.
    ///
    /// # Errors
    /// The digest differs.
    pub fn vouched(json: Vec<u8>, digest: Digest) -> io::Result<Self> {
        Ok(Self::Text(Text { json: digest.vouch(json)?, digest: digest.into() }))
    }

    /// The length of the JSON and its digest.
    pub fn fingerprint(&self) -> Fingerprint {
        match self {
            Self::Text(text) => {
                Fingerprint { bytes: text.json.len(), digest: *text.digest.get_or_init(|| Digest::of(&text.json)) }
            }
            Self::Columns(long) => long.json,
        }
    }

    /// The digest of the JSON.
    pub fn digest(&self) -> Digest {
        self.fingerprint().digest
    }

    /// The JSON, if it is in memory.
    pub fn text(&self) -> Option<&[u8]> {
        match self {
            Self::Text(text) => Some(&text.json),
            Self::Columns(_) => None,
        }
    }

    /// Opens the columns and the other parts of the solution. JSON is parsed as a whole.
    ///
    /// # Errors
    /// I/O errors of the disk; [`io::ErrorKind::InvalidData`] if the stored data are damaged.
    pub fn open(&self) -> io::Result<Opened> {
        match self {
            Self::Text(text) => {
                let (skeleton, trajectory) = Skeleton::read(&text.json)?;
                Ok(Opened { columns: Box::new(trajectory), skeleton })
            }
            Self::Columns(long) => {
                let columns = long.open()?;
                let skeleton = columns.skeleton().clone();
                Ok(Opened { columns: Box::new(columns), skeleton })
            }
        }
    }

    /// The size of what stands in memory, in bytes.
    pub fn resident(&self) -> usize {
        match self {
            Self::Text(text) => text.json.len(),
            Self::Columns(long) => long.backing.resident(),
        }
    }

    /// The size of the results as JSON, in bytes.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Text(text) => text.json.len(),
            Self::Columns(long) => long.json.bytes,
        }
    }
}

impl Long {
    /// Opens the columns, with their index verified.
    ///
    /// # Errors
    /// I/O errors of the disk; [`io::ErrorKind::InvalidData`] if the index is damaged.
    pub fn open(&self) -> io::Result<Stored> {
        let (source, length) = self.backing.open()?;
        let damaged = |why: &str| io::Error::new(io::ErrorKind::InvalidData, why);
        let start = length.checked_sub(self.index.bytes as u64).ok_or_else(|| damaged("the columns are cut off"))?;
        let mut index = vec![0; self.index.bytes];
        source.read_at(start, &mut index)?;
        let columns = Stored::open(source, &self.index.digest.vouch(index)?)?;
        if columns.bytes() == start { Ok(columns) } else { Err(damaged("the columns are not as long as they were")) }
    }
}

impl Long {
    /// Verifies every block of the columns.
    ///
    /// # Errors
    /// See [`Long::open`].
    pub fn verify(&self) -> io::Result<()> {
        let columns = self.open()?;
        columns.members().map_or(Ok(()), |members| members.verify())?;
        Selection::whole(&columns).verify(&columns)
    }
}

/// A buffer that refuses to grow past a limit, in bytes.
struct Bounded {
    bytes: Vec<u8>,
    limit: usize,
}

impl Write for Bounded {
    fn write(&mut self, more: &[u8]) -> io::Result<usize> {
        if more.len() > self.limit - self.bytes.len() {
            return Err(io::ErrorKind::FileTooLarge.into());
        }
        self.bytes.extend_from_slice(more);
        Ok(more.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
