//! What a solve leaves behind: the solution, and its JSON, which is written once, on the worker's thread, so that no
//! connection waits for the encoding of another's result.

use crate::solution::{Solution, encodings};
use std::io;

/// A solution and its JSON.
#[derive(Debug)]
pub struct Results {
    /// The columns.
    pub solution: Solution,
    /// The whole as one JSON object.
    pub json: Vec<u8>,
}

/// Why there is no solution to show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The solver panicked, which is a fault of ours.
    Panicked,
    /// The JSON would be longer than `limit` bytes.
    TooLarge {
        /// The most bytes a result may have.
        limit: usize,
    },
}

impl Results {
    /// Encodes `solution`.
    ///
    /// # Errors
    /// [`Fault::TooLarge`] if its JSON is longer than `limit` bytes.
    pub fn of(solution: Solution, limit: usize) -> Result<Self, Fault> {
        let mut json = Bounded { bytes: Vec::new(), limit };
        // The only way in which writing to memory fails is the bound.
        encodings::write_json(&solution, &mut json).map_err(|_| Fault::TooLarge { limit })?;
        let mut json = json.bytes;
        json.shrink_to_fit();
        Ok(Self { solution, json })
    }

    /// The bytes that keeping it takes.
    pub fn bytes(&self) -> usize {
        let trajectory = &self.solution.trajectory;
        self.json.len() + (trajectory.fields.len() + 1) * trajectory.t.len() * size_of::<f64>()
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
