//! Results, or an excerpt of them, opened for a response.

use super::Shared;
use super::jobs::unreadable;
use super::pieces::{Kept, Room};
use super::problem::{Kind, Problem};
use crate::jobs::{Job, Opened, Results};
use solution::columnar::{Columns, Members, PART, Skeleton};
use solution::{Excerpt, ExcerptError, Selection, Solution};
use std::io;

/// The whole results, or a part.
pub struct Part {
    /// The columns of the whole results.
    pub columns: Box<dyn Columns>,
    /// The requested rows and fields.
    pub selection: Selection,
    /// The other parts of the solution, with the events of the excerpt and the evidence of the whole.
    pub skeleton: Skeleton,
    /// The room of the columns, if they are the requested values alone, in memory.
    _kept: Option<Kept>,
}

/// The largest number of field names listed in an error message.
const MOST_NAMES: usize = 30;

impl Part {
    /// The part that `excerpt` asks for, verified against the digests of its blocks. If there is `room` for its values, they
    /// are kept: they may be far apart on the disk, and are read once in place of twice.
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

    /// The number of values in the part, those of the table of a sweep included if that is kept apart.
    pub fn numbers(&self) -> usize {
        let of_table =
            |members: &dyn Members| members.parts().saturating_mul(PART).saturating_mul(members.head().columns.len());
        let table = self.columns.members().map_or(0, of_table);
        self.selection.rows.len().saturating_mul(1 + self.selection.fields.len()).saturating_add(table)
    }

    /// The part as a solution in memory.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn solution(&self) -> io::Result<Solution> {
        let table = self.columns.members().map(|members| members.whole()).transpose()?;
        self.skeleton.with(self.selection.block(&*self.columns, self.selection.rows)?, table)
    }
}

/// The problem for a request whose excerpt cannot be given.
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
