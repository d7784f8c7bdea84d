//! Solves one specification under a deadline, and converts its outcome to the generator's units.

use super::problem::{Field, View};
use dvi::analysis::Uniqueness;
use dvi::problem::Control;
use dvi::solution::{CheckCode, Solution, Status};
use dvi::specification::Specification;
use serde_json::Value;
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

/// Stack size of the solver threads, in bytes.
const STACK_BYTES: usize = 2 << 20;
/// Time after the deadline at which a solve counts as hung.
const LATE: Duration = Duration::from_secs(20);

/// Outcome of solving a specification.
#[derive(Clone, Debug)]
pub enum Outcome {
    /// The specification was rejected, with the error code held.
    Refused(String),
    Panicked,
    /// The run was skipped, since other runs of the problem had exceeded the time limit.
    Skipped,
    /// The solve did not end at its deadline.
    Hung,
    /// A limit stopped the solve, with the error code held.
    Stopped(String),
    Failed(String),
    Answered(Answer),
}

/// A run that reached its end time.
#[derive(Clone, Debug)]
pub struct Answer {
    pub t: Vec<f64>,
    /// Values of the compared fields at the output times, in the generator's units.
    pub columns: Vec<Vec<f64>>,
    /// Times of events, in the generator's units.
    pub events: Vec<f64>,
    pub trusted: bool,
    pub because: Vec<CheckCode>,
    /// Permitted relative error according to the solver's check of local errors; `None` for a run without this check.
    pub permitted: Option<f64>,
    pub is_certified: bool,
    pub is_finite: bool,
}

/// Solves a specification on a separate thread.
pub fn solve(specification: &Value, fields: &[Field], view: &View, time: Duration) -> Outcome {
    let text = specification.to_string();
    let (send, receive) = sync_channel(1);
    let solving = move || {
        let solved = match Specification::from_json(text.as_bytes()) {
            Err(errors) => Err(errors.iter().map(|error| error.code.to_string()).collect::<Vec<_>>().join(" ")),
            Ok(specification) => Ok(dvi::solve(&specification, &Control::with_deadline(Instant::now() + time))),
        };
        // Sending fails if the caller has stopped waiting for the outcome.
        let _ = send.send(solved);
    };
    thread::Builder::new().stack_size(STACK_BYTES).spawn(solving).expect("a thread");
    match receive.recv_timeout(time + LATE) {
        Err(RecvTimeoutError::Timeout) => Outcome::Hung,
        Err(RecvTimeoutError::Disconnected) => Outcome::Panicked,
        Ok(Err(code)) => Outcome::Refused(code),
        Ok(Ok(solution)) => outcome(&solution, fields, view),
    }
}

fn outcome(solution: &Solution, fields: &[Field], view: &View) -> Outcome {
    let code = || solution.error.as_ref().map_or(String::new(), |error| error.code.to_string());
    match solution.status {
        Status::Stopped => return Outcome::Stopped(code()),
        Status::Failed => return Outcome::Failed(code()),
        Status::Completed => {}
    }
    let trajectory = &solution.trajectory;
    let column = |field: &Field| -> Vec<f64> {
        let values = trajectory.field(&field.name).unwrap_or_else(|| panic!("there is no field `{}`", field.name));
        values.iter().map(|value| value * field.unit(view)).collect()
    };
    let columns: Vec<Vec<f64>> = fields.iter().map(column).collect();
    let analysis = solution.diagnostics.analysis.as_ref();
    Outcome::Answered(Answer {
        t: trajectory.t.iter().map(|t| t * view.time).collect(),
        is_finite: trajectory.fields.iter().flat_map(|field| &field.values).all(|value| value.is_finite()),
        columns,
        events: trajectory.events.iter().map(|event| event.t * view.time).collect(),
        trusted: solution.verdict.trusted,
        because: solution.verdict.because.iter().map(|reason| reason.code).collect(),
        permitted: solution.diagnostics.checks.get(CheckCode::LocalError).map(|(_, permitted)| permitted),
        is_certified: analysis.is_some_and(|analysis| analysis.uniqueness == Uniqueness::Unique),
    })
}
