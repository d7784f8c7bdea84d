//! The results of a solve: short ones as JSON, long ones as [columns](solution::columnar), so that a response reads
//! only the part that it needs. The JSON of long results is generated once, in the worker, for its length and its
//! digest.

use super::spool::Backing;
use crate::digest::{Digest, Fingerprint, Measure};
use solution::columnar::{Columns, PartsIndex, Skeleton, Source, Stored, write_columns, write_whole};
use solution::{Selection, Solution, encodings};
use std::io::{self, Write};
use std::sync::OnceLock;

/// The largest size of short results as JSON, in bytes; longer results are stored as columns.
pub const SHORT: usize = 64 << 10;

/// The stored form of the results of a job (its solution).
#[derive(Debug)]
pub enum Results {
    /// Short results, stored as JSON.
    Text(Text),
    /// Long results, stored as columns.
    Columns(Long),
}

/// Results as JSON, with their digest once it has been computed.
#[derive(Debug)]
pub struct Text {
    json: Vec<u8>,
    digest: OnceLock<Digest>,
}

/// Results as columns, with the fingerprints that identify them.
#[derive(Debug)]
pub struct Long {
    /// The place where the columns of the results are stored.
    pub backing: Backing,
    /// The fingerprint (length and digest) of the JSON that the columns encode.
    pub json: Fingerprint,
    /// The fingerprint of the index of the columns, which stands at the end of the file.
    pub index: Fingerprint,
}

/// Results opened for reading: the trajectory as columns, and the rest of the solution.
pub struct Opened {
    /// The trajectory as columns, one per field.
    pub columns: Box<dyn Columns>,
    /// The solution without its trajectory.
    pub skeleton: Skeleton,
}

/// The error that the results of a job, as JSON, exceed the size limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLarge;

/// The results of a job (its solution), encoded to be stored.
pub enum Encoded {
    /// Short results, encoded as JSON.
    Text(Vec<u8>),
    /// Long results, to be written as columns: the fingerprint of their JSON, and the solution without its
    /// trajectory.
    Columns(Fingerprint, Skeleton),
}

impl Encoded {
    /// Encodes `solution` as JSON if the JSON is short, and otherwise computes the fingerprint of its JSON.
    ///
    /// # Errors
    /// The JSON is longer than `limit` bytes.
    pub fn of(solution: &Solution, limit: usize) -> Result<Self, TooLarge> {
        let mut json = Bounded { bytes: Vec::new(), limit: limit.min(SHORT) };
        // Writing to memory fails only if the JSON exceeds the size of short results.
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
    /// Encodes `solution` in memory: as JSON if the JSON is short, otherwise as columns.
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

    /// Creates the results of a sweep from its table, which fills `backing`, and the rest of its solution. The table
    /// is never in memory as a whole.
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

    /// Wraps the results of a job that are encoded as JSON already.
    pub fn read(json: Vec<u8>) -> Self {
        Self::Text(Text { json, digest: OnceLock::new() })
    }

    /// Wraps JSON read from the disk, verified against its digest.
    ///
    /// # Errors
    /// The digest differs.
    pub fn vouched(json: Vec<u8>, digest: Digest) -> io::Result<Self> {
        Ok(Self::Text(Text { json: digest.vouch(json)?, digest: digest.into() }))
    }

    /// Returns the length and the digest of the results as JSON.
    pub fn fingerprint(&self) -> Fingerprint {
        match self {
            Self::Text(text) => {
                Fingerprint { bytes: text.json.len(), digest: *text.digest.get_or_init(|| Digest::of(&text.json)) }
            }
            Self::Columns(long) => long.json,
        }
    }

    /// Returns the digest of the results as JSON.
    pub fn digest(&self) -> Digest {
        self.fingerprint().digest
    }

    /// Returns the results as JSON, if they are stored as JSON.
    pub fn text(&self) -> Option<&[u8]> {
        match self {
            Self::Text(text) => Some(&text.json),
            Self::Columns(_) => None,
        }
    }

    /// Opens the results as columns and the rest of the solution. JSON is parsed as a whole.
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

    /// Returns the size of the part of the results that is in memory, in bytes.
    pub fn resident(&self) -> usize {
        match self {
            Self::Text(text) => text.json.len(),
            Self::Columns(long) => long.backing.resident(),
        }
    }

    /// Returns the size of the results as JSON, in bytes.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Text(text) => text.json.len(),
            Self::Columns(long) => long.json.bytes,
        }
    }
}

impl Long {
    /// Opens the columns, and verifies their index.
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
    /// Verifies the digest of every block of the columns.
    ///
    /// # Errors
    /// See [`Long::open`].
    pub fn verify(&self) -> io::Result<()> {
        let columns = self.open()?;
        columns.members().map_or(Ok(()), |members| members.verify())?;
        Selection::whole(&columns).verify(&columns)
    }
}

/// A buffer for the JSON of results that refuses to grow beyond a limit, in bytes.
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
