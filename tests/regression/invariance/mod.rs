//! Results must not depend on the units in which a scene is written, nor on how long the run goes on afterwards.

mod horizon;
mod scenes;
mod units;

use crate::computing_time::{self, Ended};
use dvi::solution::{Event, EventKind, Solution, Status};
use serde_json::Value;
use std::collections::BTreeMap;
use std::time::Duration;

/// Computing time after which the solve of a scene is stopped; each solve needs at most a tenth of it.
const ALLOWED: Duration = Duration::from_secs(if cfg!(debug_assertions) { 20 } else { 5 });

/// The results of a scene up to a time, converted to the reference units.
struct Answer {
    /// The compared fields: for each of them, its values at the output times.
    columns: Vec<Vec<f64>>,
    /// The times of the events, by their kind and the variable or contact concerned.
    events: BTreeMap<(String, String), Vec<f64>>,
    /// The reasons for which the verdict (whether the result is to be trusted) doubts the result.
    because: Vec<&'static str>,
    trusted: bool,
}

/// Solves a specification; the error, if any, states why there is no solution.
fn solve(specification: &Value) -> Result<Box<Solution>, String> {
    match computing_time::solve(&specification.to_string(), ALLOWED) {
        Ended::Solved(solution) => Ok(solution),
        Ended::Refused(errors) => Err(format!("refused: {} {}", errors[0].pointer, errors[0].detail)),
        Ended::Deaf => Err("goes on after it was asked to stop".to_owned()),
    }
}

impl Answer {
    /// Collects the results of a solution: values of fields divided by the units of the fields, and times of events
    /// divided by the unit of time.
    fn new(solution: &Solution, units: &[f64], time: f64) -> Self {
        let columns = solution.trajectory.fields.iter().zip(units);
        let columns = columns.map(|(field, unit)| field.values.iter().map(|value| value / unit).collect()).collect();
        let mut events = BTreeMap::<_, Vec<f64>>::new();
        for Event { t, kind, of } in &solution.trajectory.events {
            events.entry((word(*kind), of.clone())).or_default().push(t / time);
        }
        let verdict = &solution.verdict;
        let because = verdict.because.iter().map(|reason| reason.code.name()).collect();
        Self { columns, events, because, trusted: verdict.trusted }
    }

    /// The largest difference between values of the fields in two runs, each relative to the largest value of its
    /// field.
    fn distance(&self, other: &Self) -> f64 {
        let columns = self.columns.iter().zip(&other.columns).map(|(a, b)| {
            let size = a.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
            let apart = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            if a.len() != b.len() { f64::INFINITY } else { apart / size }
        });
        columns.fold(0.0, f64::max)
    }

    /// Returns how the events of two runs differ, if their numbers differ or a time differs by more than `within`.
    fn events_apart(&self, other: &Self, within: f64) -> Option<String> {
        let none = Vec::new();
        self.events.keys().chain(other.events.keys()).find_map(|key| {
            let [a, b] = [self, other].map(|answer| answer.events.get(key).unwrap_or(&none));
            let (kind, of) = key;
            if a.len() != b.len() {
                return Some(format!("{of}: {} times {kind}, not {}", b.len(), a.len()));
            }
            let apart = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            (apart > within).then(|| format!("{of}: {kind} {apart:.1e} too early or too late"))
        })
    }
}

/// The name of a kind of event, as text.
fn word(kind: EventKind) -> String {
    format!("{kind:?}")
}

/// Returns why a solution does not reach the end of the run, if it does not.
fn incomplete(solution: &Solution) -> Option<String> {
    let error = solution.error.as_ref().filter(|_| solution.status != Status::Completed)?;
    Some(format!("{} at t = {:e}", error.code, error.time))
}
