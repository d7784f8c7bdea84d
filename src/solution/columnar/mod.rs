//! Trajectories as columns, in memory or on a disk: an excerpt reads only the chunks that it needs.
//!
//! The stored form is
//!
//! ```text
//! columns    the times, then each field: 8 bytes a number, little-endian, in chunks of 1024 rows, the last one shorter
//! members    the table of a sweep, where there is one, in parts of some thousand rows
//! index      JSON: how many rows, the names, a checksum a chunk, and the solution without its columns
//! ```
//!
//! Whoever stores it keeps the length and a digest of the index, and finds the rest from there.

mod checksum;
mod members;
mod pieces;
mod skeleton;
mod stored;

pub(super) use checksum::checksum;
pub use members::{Members, PART, PartsIndex, PartsWriter, StoredMembers, write_parts};
pub use pieces::{JsonPieces, TablePieces, write_whole};
pub use skeleton::Skeleton;
pub use stored::{Source, Stored, write_columns};

use super::Trajectory;
use std::io;

/// Columns of equal length: the times, and fields.
pub trait Columns: Send + Sync {
    /// How many times there are.
    fn rows(&self) -> usize;

    /// The names of the fields.
    fn names(&self) -> Vec<&str>;

    /// The values at those rows of a column: the times are the first one, the fields follow.
    ///
    /// # Errors
    /// Those of the disk; [`io::ErrorKind::InvalidData`] where the column is not as it was written.
    fn values(&self, column: usize, rows: Rows) -> io::Result<Vec<f64>>;

    /// Compares the checksums of the chunks that hold these rows of these columns, numbered as in [`Columns::values`].
    ///
    /// # Errors
    /// As of [`Columns::values`].
    fn verify(&self, columns: &[usize], rows: Rows) -> io::Result<()>;

    /// The first row whose time is not `is_before`; times are ordered, so that all from there on are not.
    ///
    /// # Errors
    /// As of [`Columns::values`].
    fn partition_point(&self, is_before: &dyn Fn(f64) -> bool) -> io::Result<usize>;

    /// The table of a sweep, where it is kept apart from the rest of the solution.
    fn members(&self) -> Option<&dyn Members> {
        None
    }
}

/// Rows from `first` on, before `end`, one in `every`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rows {
    /// The first.
    pub first: usize,
    /// Behind the last.
    pub end: usize,
    /// The distance of one to the next, at least one.
    pub every: usize,
}

impl Rows {
    /// The last of `rows` rows, if there are any.
    pub fn last(rows: usize) -> Self {
        Self { first: rows.saturating_sub(1), end: rows, every: 1 }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.end.saturating_sub(self.first).div_ceil(self.every)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The part that begins with the `next` of them, of at most `count` rows.
    pub fn part(&self, next: usize, count: usize) -> Self {
        let row = |k: usize| self.first.saturating_add(k.saturating_mul(self.every)).min(self.end);
        Self { first: row(next), end: row(next.saturating_add(count)), every: self.every }
    }
}

impl Columns for Trajectory {
    fn rows(&self) -> usize {
        self.t.len()
    }

    fn names(&self) -> Vec<&str> {
        self.fields.iter().map(|field| field.name.as_str()).collect()
    }

    fn values(&self, column: usize, rows: Rows) -> io::Result<Vec<f64>> {
        let values = match column.checked_sub(1) {
            None => Some(&self.t),
            Some(field) => self.fields.get(field).map(|field| &field.values),
        };
        let within = values.and_then(|values| values.get(rows.first..rows.end)).unwrap_or_default();
        Ok(within.iter().copied().step_by(rows.every).collect())
    }

    fn verify(&self, _: &[usize], _: Rows) -> io::Result<()> {
        Ok(())
    }

    fn partition_point(&self, is_before: &dyn Fn(f64) -> bool) -> io::Result<usize> {
        Ok(self.t.partition_point(|t| is_before(*t)))
    }
}
