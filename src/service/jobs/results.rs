//! What a solve leaves behind: short results as JSON, long ones as [columns](solution::columnar), so that an answer reads what
//! it needs. Their JSON is written once, on the worker's side, for its length and its digest.

use super::spool::Backing;
use crate::digest::{Digest, Fingerprint, Measure};
use solution::columnar::{Columns, Skeleton, Source, Stored, write_columns};
use solution::{Selection, Solution, encodings};
use std::io::{self, Write};
use std::sync::OnceLock;

/// The most bytes of the JSON of short results.
pub const SHORT: usize = 64 << 10;

/// A solution as it is kept.
#[derive(Debug)]
pub enum Results {
    /// As JSON.
    Text(Text),
    /// As columns.
    Columns(Long),
}

/// JSON, and its digest once somebody has asked for it.
#[derive(Debug)]
pub struct Text {
    json: Vec<u8>,
    digest: OnceLock<Digest>,
}

/// Columns, and what they are known by.
#[derive(Debug)]
pub struct Long {
    /// Where they are.
    pub backing: Backing,
    /// Of the JSON that they stand for.
    pub json: Fingerprint,
    /// Of their index, which is at the end.
    pub index: Fingerprint,
}

/// Columns that are read, and the rest of their solution.
pub struct Opened {
    /// The columns.
    pub columns: Box<dyn Columns>,
    /// The rest.
    pub skeleton: Skeleton,
}

/// The JSON would be longer than it may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLarge;

/// A solution in the form in which it is kept.
pub enum Encoded {
    /// JSON.
    Text(Vec<u8>),
    /// To be written as columns.
    Columns(Fingerprint, Skeleton),
}

impl Encoded {
    /// The JSON of `solution` if it is short, and else its fingerprint.
    ///
    /// # Errors
    /// The JSON is longer than `limit` bytes.
    pub fn of(solution: &Solution, limit: usize) -> Result<Self, TooLarge> {
        let mut json = Bounded { bytes: Vec::new(), limit: limit.min(SHORT) };
        // The only way in which writing to memory fails is the bound.
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
    /// Its JSON is longer than `limit` bytes.
    pub fn of(solution: &Solution, limit: usize) -> Result<Self, TooLarge> {
        match Encoded::of(solution, limit)? {
            Encoded::Text(json) => Ok(Self::read(json)),
            Encoded::Columns(json, skeleton) => {
                let mut bytes = Vec::new();
                let index = write_columns(&solution.trajectory, &skeleton, &mut bytes).map_err(|_| TooLarge)?;
                let (backing, index) = (Backing::memory(bytes), Fingerprint::of(&index));
                Ok(Self::Columns(Long { backing, json, index }))
            }
        }
    }

    /// JSON that was encoded before.
    pub fn read(json: Vec<u8>) -> Self {
        Self::Text(Text { json, digest: OnceLock::new() })
    }

    /// JSON that was written to a disk, if it is what its digest was made of.
    ///
    /// # Errors
    /// It is not.
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

    /// The JSON, where it is in hand.
    pub fn text(&self) -> Option<&[u8]> {
        match self {
            Self::Text(text) => Some(&text.json),
            Self::Columns(_) => None,
        }
    }

    /// The columns and the rest. Text is read as a whole.
    ///
    /// # Errors
    /// Those of the disk; [`io::ErrorKind::InvalidData`] where what was stored is damaged.
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

    /// The bytes of its JSON.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Text(text) => text.json.len(),
            Self::Columns(long) => long.json.bytes,
        }
    }
}

impl Long {
    /// The columns, once the index is known to be what was written.
    ///
    /// # Errors
    /// Those of the disk; [`io::ErrorKind::InvalidData`] where it is not.
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
    /// That all of it is as it was written.
    ///
    /// # Errors
    /// As of [`Long::open`].
    pub fn verify(&self) -> io::Result<()> {
        let columns = self.open()?;
        Selection::whole(&columns).verify(&columns)
    }
}

/// Memory that refuses to grow past a limit.
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
