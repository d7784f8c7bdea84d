//! The results of a job, or an excerpt of them, opened to generate a response.

use super::Shared;
use super::jobs::unreadable;
use super::pieces::{Kept, Room};
use super::problem::{Kind, Problem};
use crate::jobs::{Job, Opened, Results};
use solution::columnar::{Columns, Members, PART, Skeleton};
use solution::{Excerpt, ExcerptError, Selection, Solution};
use std::io;

/// The results of a job, or an excerpt of them.
pub struct Part {
    /// The trajectory as columns: that of the whole results, or that of the excerpt alone if its values were copied
    /// to memory.
    pub columns: Box<dyn Columns>,
    /// The rows (times) and fields of the trajectory that the response contains.
    pub selection: Selection,
    /// The solution without its trajectory, with the events of the excerpt and the diagnostics of the whole solve.
    pub skeleton: Skeleton,
    /// The memory reserved for the values of the excerpt, if they were copied to memory.
    _kept: Option<Kept>,
}

/// The largest number of known field names listed in the error message about an unknown field.
const MOST_NAMES: usize = 30;

impl Part {
    /// Opens the results, or the part selected by `excerpt`, and verifies the digests of the blocks read. If `room`
    /// has memory for the values, they are copied: they may be scattered over the disk, and are then read once
    /// instead of twice.
    ///
    /// # Errors
    /// The excerpt names a field that does not exist, or the stored results cannot be read.
    pub fn of(results: &Results, excerpt: Option<&Excerpt>, room: &Room) -> Result<Self, ExcerptError> {
        let Opened { columns, mut skeleton } = results.open()?;
        let selection = match excerpt {
            None => Selection::whole(&*columns),
            Some(excerpt) => {
                skeleton = skeleton.within(&excerpt.times())?;
                excerpt.of(&*columns)?
            }
        };
        let part = Self { columns, selection, skeleton, _kept: None };
        let is_on_disk = matches!(results, Results::Columns(_)) && part.columns.members().is_none();
        if is_on_disk && let Some(kept) = room.keep(part.numbers().saturating_mul(size_of::<f64>())) {
            let values = part.selection.block(&*part.columns, part.selection.rows)?;
            let selection = Selection::whole(&values);
            return Ok(Self { columns: Box::new(values), selection, _kept: Some(kept), ..part });
        }
        part.selection.verify(&*part.columns)?;
        part.columns.members().map_or(Ok(()), |members| members.verify())?;
        Ok(part)
    }

    /// Returns the number of values in the excerpt, including those of the table of a sweep if it is stored
    /// separately.
    pub fn numbers(&self) -> usize {
        let of_table =
            |members: &dyn Members| members.parts().saturating_mul(PART).saturating_mul(members.head().columns.len());
        let table = self.columns.members().map_or(0, of_table);
        self.selection.rows.len().saturating_mul(1 + self.selection.fields.len()).saturating_add(table)
    }

    /// Reads the excerpt as a solution in memory.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn solution(&self) -> io::Result<Solution> {
        let table = self.columns.members().map(|members| members.whole()).transpose()?;
        self.skeleton.with(self.selection.block(&*self.columns, self.selection.rows)?, table)
    }
}

/// Returns the problem for a request whose excerpt of the results does not exist or cannot be read.
pub async fn no_excerpt(shared: &Shared, job: &Job, error: ExcerptError) -> Box<Problem> {
    match error {
        ExcerptError::NoSuchField(name, known) => {
            let rest = if known.len() > MOST_NAMES { " and more" } else { "" };
            let names: Vec<String> = known.into_iter().take(MOST_NAMES).collect();
            Problem::new(Kind::BadQuery, format!("fields: there is no {name}; there are {}{rest}", names.join(", ")))
        }
        ExcerptError::Unreadable(error) => {
            shared.jobs.found(job, &error).await;
            unreadable(job.id, &error)
        }
    }
}
