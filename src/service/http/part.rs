//! Results, or an excerpt of them.

use super::Shared;
use super::jobs::unreadable;
use super::problem::{Kind, Problem};
use crate::jobs::{Job, Opened, Results};
use solution::columnar::{Columns, Skeleton};
use solution::{Excerpt, ExcerptError, Selection, Solution};
use std::io;

/// The whole of results, or a part.
pub struct Part {
    /// The columns of the whole.
    pub columns: Box<dyn Columns>,
    /// What of them is asked for.
    pub selection: Selection,
    /// The rest of the solution, with the events of the part and the evidence of the whole.
    pub skeleton: Skeleton,
}

/// Names that fit into an answer.
const MOST_NAMES: usize = 30;

impl Part {
    /// The part that `excerpt` asks for. All that is to be read of it was found to be as it was written.
    ///
    /// # Errors
    /// It names a field that is not there, or what was stored cannot be read.
    pub fn of(results: &Results, excerpt: Option<&Excerpt>) -> Result<Self, ExcerptError> {
        let Opened { columns, mut skeleton } = results.open()?;
        let selection = match excerpt {
            None => Selection::whole(&*columns),
            Some(excerpt) => {
                skeleton = skeleton.within(&excerpt.times())?;
                excerpt.of(&*columns)?
            }
        };
        selection.verify(&*columns)?;
        Ok(Self { columns, selection, skeleton })
    }

    /// How many numbers there are.
    pub fn numbers(&self) -> usize {
        self.selection.rows.len().saturating_mul(1 + self.selection.fields.len())
    }

    /// All of it in memory.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn solution(&self) -> io::Result<Solution> {
        self.skeleton.with(self.selection.block(&*self.columns, self.selection.rows)?)
    }
}

/// The problem for a client whose excerpt cannot be had.
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
