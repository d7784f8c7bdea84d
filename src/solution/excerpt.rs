//! Excerpts of a trajectory: some of its fields, and every `n`-th of the times within an interval.

use super::columnar::{Columns, Rows};
use std::io;
use std::num::NonZeroUsize;
use std::ops::RangeInclusive;

/// The request for an excerpt of a trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct Excerpt {
    /// The names of the fields to include, in this order; `None` for all fields.
    pub fields: Option<Vec<String>>,
    /// The earliest time of the trajectory to include in the excerpt.
    pub from: f64,
    /// The latest time of the trajectory to include in the excerpt.
    pub to: f64,
    /// The number `n` if every `n`-th of the times in the interval is to be included, beginning with the first.
    pub every: NonZeroUsize,
}

impl Default for Excerpt {
    /// The request for the whole trajectory.
    fn default() -> Self {
        Self { fields: None, from: f64::NEG_INFINITY, to: f64::INFINITY, every: NonZeroUsize::MIN }
    }
}

/// The fields and rows of an excerpt, selected from given columns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Selection {
    /// The indices of the selected fields of the trajectory.
    pub fields: Vec<usize>,
    /// The selected rows (times) of the trajectory.
    pub rows: Rows,
}

/// The reasons why an excerpt of a trajectory cannot be made.
#[derive(Debug)]
pub enum ExcerptError {
    /// The requested field, named by the first entry, does not exist; the second entry lists the names of the
    /// existing fields.
    NoSuchField(String, Vec<String>),
    /// The columns of the trajectory cannot be read from the disk.
    Unreadable(io::Error),
}

impl From<io::Error> for ExcerptError {
    fn from(error: io::Error) -> Self {
        Self::Unreadable(error)
    }
}

impl Excerpt {
    /// Selects the fields and rows of the excerpt from `columns`.
    ///
    /// # Errors
    /// A requested field does not exist, or the columns cannot be read.
    pub fn of(&self, columns: &dyn Columns) -> Result<Selection, ExcerptError> {
        let names = columns.names();
        let find = |name: &String| {
            let place = names.iter().position(|known| known == name);
            let known = || names.iter().map(|&known| known.to_owned()).collect();
            place.ok_or_else(|| ExcerptError::NoSuchField(name.clone(), known()))
        };
        let fields = match &self.fields {
            None => (0..names.len()).collect(),
            Some(asked) => asked.iter().map(find).collect::<Result<_, _>>()?,
        };
        let first = columns.partition_point(&|t| t < self.from)?;
        let end = columns.partition_point(&|t| t <= self.to)?.max(first);
        Ok(Selection { fields, rows: Rows { first, end, every: self.every.get() } })
    }

    /// Returns the interval of the times that the excerpt includes.
    pub fn times(&self) -> RangeInclusive<f64> {
        self.from..=self.to
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Field, Trajectory};

    fn trajectory() -> Trajectory {
        let t: Vec<f64> = (0..10).map(f64::from).collect();
        let squares = t.iter().map(|t| t * t).collect();
        let fields =
            vec![Field { name: "x".to_owned(), values: t.clone() }, Field { name: "y".to_owned(), values: squares }];
        Trajectory { t, fields, events: Vec::new() }
    }

    fn part(excerpt: &Excerpt) -> Trajectory {
        let (trajectory, selection) = (trajectory(), excerpt.of(&trajectory()).unwrap());
        selection.block(&trajectory, selection.rows).unwrap()
    }

    #[test]
    fn the_whole_is_the_excerpt_that_asks_for_nothing_less() {
        assert_eq!(part(&Excerpt::default()), trajectory());
    }

    #[test]
    fn rows_are_within_the_interval_ends_included_and_every_nth_from_its_first() {
        let every = NonZeroUsize::new(3).unwrap();
        let third = part(&Excerpt { fields: Some(vec!["y".to_owned()]), from: 1.5, to: 8.0, every });
        assert_eq!(third.t, [2.0, 5.0, 8.0]);
        assert_eq!(third.fields, [Field { name: "y".to_owned(), values: vec![4.0, 25.0, 64.0] }]);
        assert_eq!(part(&Excerpt { from: 7.0, to: 7.0, ..Excerpt::default() }).t, [7.0]);
        assert_eq!(part(&Excerpt { every: NonZeroUsize::MAX, ..Excerpt::default() }).t, [0.0]);
    }

    #[test]
    fn an_interval_without_times_is_empty_and_one_turned_round_is_too() {
        let empty = |from, to| part(&Excerpt { from, to, ..Excerpt::default() });
        assert_eq!((empty(20.0, 30.0).t.len(), empty(5.0, 2.0).t.len()), (0, 0));
        assert!(Excerpt { from: 5.0, to: 2.0, ..Excerpt::default() }.times().is_empty());
    }

    #[test]
    fn a_field_that_is_not_there_is_named() {
        let asked = Excerpt { fields: Some(vec!["x".to_owned(), "z".to_owned()]), ..Excerpt::default() };
        assert!(matches!(asked.of(&trajectory()), Err(ExcerptError::NoSuchField(name, _)) if name == "z"));
    }
}
