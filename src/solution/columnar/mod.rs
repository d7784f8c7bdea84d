//! Trajectories as columns, in memory or on disk: an excerpt reads only the blocks that it needs.
//!
//! The stored form is
//!
//! ```text
//! columns    the times, then each field, in blocks of 63 rows, the last one shorter: 8 bytes a number, little-endian, and
//!            the checksum of the block
//! members    the table of a sweep, where there is one, in parts of some thousand rows
//! index      JSON: how many rows, the names, and the solution without its columns
//! ```
//!
//! Columns written by earlier versions are in chunks of 1024 rows, with their checksums in the index.
//!
//! The caller stores the length and a digest of the index, from which everything else is found.

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

/// Columns of equal length: the times of a trajectory, then its fields.
pub trait Columns: Send + Sync {
    /// Returns the number of times of the trajectory.
    fn rows(&self) -> usize;

    /// Returns the names of the fields of the trajectory.
    fn names(&self) -> Vec<&str>;

    /// Returns the values of a column at the given rows; column 0 contains the times, and the fields follow.
    ///
    /// # Errors
    /// Errors of the disk; [`io::ErrorKind::InvalidData`] if the column has changed since it was written.
    fn values(&self, column: usize, rows: Rows) -> io::Result<Vec<f64>>;

    /// Verifies the checksums of the blocks that contain the given rows of the given columns, numbered as in
    /// [`Columns::values`].
    ///
    /// # Errors
    /// Same as for [`Columns::values`].
    fn verify(&self, columns: &[usize], rows: Rows) -> io::Result<()>;

    /// Returns the first row whose time does not satisfy `is_before`; the times are sorted, so neither do later ones.
    ///
    /// # Errors
    /// Same as for [`Columns::values`].
    fn partition_point(&self, is_before: &dyn Fn(f64) -> bool) -> io::Result<usize>;

    /// Returns the table of a sweep, if it is stored separately from the rest of the solution.
    fn members(&self) -> Option<&dyn Members> {
        None
    }
}

/// A selection of rows of a trajectory or table: from `first` to before `end`, one in `every`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rows {
    /// The index of the first row of the range.
    pub first: usize,
    /// The index after the last row of the range.
    pub end: usize,
    /// The distance between consecutive rows of the range, at least one.
    pub every: usize,
}

impl Rows {
    /// Returns the range of the last of `rows` rows, or an empty range if `rows` is zero.
    pub fn last(rows: usize) -> Self {
        Self { first: rows.saturating_sub(1), end: rows, every: 1 }
    }

    /// Returns the number of rows of the range.
    pub fn len(&self) -> usize {
        self.end.saturating_sub(self.first).div_ceil(self.every)
    }

    /// Whether the range has no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the subrange of at most `count` rows that begins with row number `next` of the range.
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
