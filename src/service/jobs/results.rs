//! What a solve leaves behind: its JSON, which is written once, on the worker's thread, so that no connection waits
//! for the encoding of another's result; and the solution, in hand after a solve and read back where it is needed.

use super::digest::Digest;
use solution::{Solution, encodings};
use std::io;
use std::sync::OnceLock;

/// A solution as JSON, and as columns.
#[derive(Debug)]
pub struct Results {
    json: Vec<u8>,
    digest: OnceLock<Digest>,
    solution: OnceLock<Solution>,
}

/// The JSON would be longer than it may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLarge;

impl Results {
    /// Encodes `solution`.
    ///
    /// # Errors
    /// Its JSON is longer than `limit` bytes.
    pub fn of(solution: Solution, limit: usize) -> Result<Self, TooLarge> {
        let mut json = Bounded { bytes: Vec::new(), limit };
        // The only way in which writing to memory fails is the bound.
        encodings::write_json(&solution, &mut json).map_err(|_| TooLarge)?;
        let mut json = json.bytes;
        json.shrink_to_fit();
        Ok(Self { json, digest: OnceLock::new(), solution: solution.into() })
    }

    /// What was encoded before.
    pub fn read(json: Vec<u8>) -> Self {
        Self { json, digest: OnceLock::new(), solution: OnceLock::new() }
    }

    /// What was written to a disk, if it is what its digest was made of.
    ///
    /// # Errors
    /// It is not.
    pub fn vouched(json: Vec<u8>, digest: Digest) -> io::Result<Self> {
        Ok(Self { json: digest.vouch(json)?, digest: digest.into(), solution: OnceLock::new() })
    }

    /// The digest of the JSON.
    pub fn digest(&self) -> Digest {
        *self.digest.get_or_init(|| Digest::of(&self.json))
    }

    /// The whole as one JSON object.
    pub fn json(&self) -> &[u8] {
        &self.json
    }

    /// The columns. The first call on results from a disk reads all of the JSON.
    ///
    /// # Errors
    /// The JSON is not that of a solution.
    pub fn solution(&self) -> io::Result<&Solution> {
        if let Some(solution) = self.solution.get() {
            return Ok(solution);
        }
        let solution = encodings::read_json(&self.json)?;
        Ok(self.solution.get_or_init(|| solution))
    }

    /// Whether the columns are in hand.
    pub fn is_read(&self) -> bool {
        self.solution.get().is_some()
    }

    /// The bytes that keeping it takes.
    pub fn bytes(&self) -> usize {
        let columns = self.solution.get().map_or(0, |solution| {
            (solution.trajectory.fields.len() + 1) * solution.trajectory.t.len() * size_of::<f64>()
        });
        self.json.len() + columns
    }
}

/// Memory that refuses to grow past a limit.
struct Bounded {
    bytes: Vec<u8>,
    limit: usize,
}

impl io::Write for Bounded {
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
