//! A part of a trajectory: some of its fields, the times within an interval, every `n`-th of those.

use super::{Field, Trajectory};
use std::num::NonZeroUsize;

/// What is to be left of a trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct Excerpt {
    /// The fields, in this order; none is all.
    pub fields: Option<Vec<String>>,
    /// The least time.
    pub from: f64,
    /// The greatest time.
    pub to: f64,
    /// One in how many of the times within, the first of them included.
    pub every: NonZeroUsize,
}

impl Default for Excerpt {
    /// The whole.
    fn default() -> Self {
        Self { fields: None, from: f64::NEG_INFINITY, to: f64::INFINITY, every: NonZeroUsize::MIN }
    }
}

/// A field was asked for by this name, and there is none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NoSuchField(pub String);

impl Excerpt {
    /// The part of `trajectory`, with the events within the interval.
    ///
    /// # Errors
    /// A field that is not there.
    pub fn of(&self, trajectory: &Trajectory) -> Result<Trajectory, NoSuchField> {
        let fields: Vec<&Field> = match &self.fields {
            None => trajectory.fields.iter().collect(),
            Some(names) => names.iter().map(|name| find(trajectory, name)).collect::<Result<_, _>>()?,
        };
        let first = trajectory.t.partition_point(|t| *t < self.from);
        let last = trajectory.t.partition_point(|t| *t <= self.to).max(first);
        let rows = |column: &[f64]| -> Vec<f64> {
            column.iter().copied().take(last).skip(first).step_by(self.every.get()).collect()
        };
        let fields = fields.iter().map(|field| Field { name: field.name.clone(), values: rows(&field.values) });
        let events = trajectory.events.iter().filter(|event| (self.from..=self.to).contains(&event.t));
        Ok(Trajectory { t: rows(&trajectory.t), fields: fields.collect(), events: events.cloned().collect() })
    }
}

fn find<'a>(trajectory: &'a Trajectory, name: &str) -> Result<&'a Field, NoSuchField> {
    trajectory.fields.iter().find(|field| field.name == name).ok_or_else(|| NoSuchField(name.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use problem::{Event, EventKind};

    fn trajectory() -> Trajectory {
        let t: Vec<f64> = (0..10).map(f64::from).collect();
        let squares = t.iter().map(|t| t * t).collect();
        let fields =
            vec![Field { name: "x".to_owned(), values: t.clone() }, Field { name: "y".to_owned(), values: squares }];
        let events = [2.5, 7.0].map(|t| Event { t, kind: EventKind::Slip, of: "z".to_owned() }).to_vec();
        Trajectory { t, fields, events }
    }

    #[test]
    fn the_whole_is_the_excerpt_that_asks_for_nothing_less() {
        assert_eq!(Excerpt::default().of(&trajectory()), Ok(trajectory()));
    }

    #[test]
    fn rows_are_within_the_interval_ends_included_and_every_nth_from_its_first() {
        let every = NonZeroUsize::new(3).unwrap();
        let part = Excerpt { fields: Some(vec!["y".to_owned()]), from: 1.5, to: 8.0, every }.of(&trajectory()).unwrap();
        assert_eq!(part.t, [2.0, 5.0, 8.0]);
        assert_eq!(part.fields, [Field { name: "y".to_owned(), values: vec![4.0, 25.0, 64.0] }]);
        assert_eq!(part.events.len(), 2);
        let point = Excerpt { from: 7.0, to: 7.0, ..Excerpt::default() }.of(&trajectory()).unwrap();
        assert_eq!((point.t.as_slice(), point.events.len()), ([7.0].as_slice(), 1));
    }

    #[test]
    fn an_interval_without_times_is_empty_and_one_turned_round_is_too() {
        let empty = |from, to| Excerpt { from, to, ..Excerpt::default() }.of(&trajectory()).unwrap();
        assert_eq!((empty(20.0, 30.0).t.len(), empty(5.0, 2.0).t.len(), empty(5.0, 2.0).events.len()), (0, 0, 0));
    }

    #[test]
    fn a_field_that_is_not_there_is_named() {
        let asked = Excerpt { fields: Some(vec!["x".to_owned(), "z".to_owned()]), ..Excerpt::default() };
        assert_eq!(asked.of(&trajectory()), Err(NoSuchField("z".to_owned())));
    }
}
