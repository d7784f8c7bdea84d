//! Measurement of ladders, series of runs of one method from coarse to fine: each run is solved once for its answer,
//! then again for its run time.

use super::reference::{Reference, switch_times};
use super::{Errors, Ladder, MOST_STEPS, Outcome, ROUNDING, Run, WRONG};
use crate::solve::solve_once;
use problem::Control;
use solution::{Solution, Status};
use specification::{Rung, Specification, Stages};
use std::time::{Duration, Instant};

/// Number of timed solves of each run, after a first solve that warms caches and is not counted.
pub const REPEATS: usize = 5;
/// Run time in seconds above which a run is not repeated: such times hardly vary.
pub const LONG: f64 = 0.5;
/// Time limit of one run of the report.
pub const LONGEST: Duration = Duration::from_secs(20);

/// Measures one ladder: runs of one method at the tolerances or step sizes `rungs`, from coarse to fine. After a run
/// that was stopped at its time limit, no finer run is tried. The rungs `finer` follow only while the error of the
/// last run is still above [`WRONG`].
pub fn ladder(
    method: String,
    specification: &Specification,
    (rungs, finer): (&[Rung], &[Rung]),
    stages: Stages,
    reference: &Reference,
) -> Ladder {
    let mut runs: Vec<Run> = Vec::with_capacity(rungs.len());
    for &rung in rungs.iter().chain(finer) {
        if runs.len() >= rungs.len() && !runs.last().is_some_and(needs_finer) {
            break;
        }
        let mut run = match runs.last() {
            Some(Run { outcome: Outcome::Stopped | Outcome::NotTried, .. }) => Run::not_tried(rung),
            _ => measure(specification, rung, stages, reference),
        };
        run.change = runs.last().and_then(|before| change(before, &run));
        runs.push(run);
    }
    Ladder { method, runs }
}

/// Whether smaller steps than those of a run should be tried: its answer is wrong or missing, but the run was not
/// stopped at its time limit.
fn needs_finer(run: &Run) -> bool {
    let error = run.errors.as_ref().and_then(Errors::of_states);
    !matches!(run.outcome, Outcome::Stopped | Outcome::NotTried) && error.is_none_or(|error| error > WRONG)
}

fn measure(specification: &Specification, rung: Rung, stages: Stages, reference: &Reference) -> Run {
    let fields = (0..reference.names.len()).collect();
    let variant = specification.variant(rung, stages, reference.times.clone(), fields).within_steps(MOST_STEPS);
    let solve = || solve_once(&variant, &Control::with_deadline(Instant::now() + LONGEST));
    let first = solve();
    let mut times = Vec::with_capacity(REPEATS);
    if first.status == Status::Completed && first.diagnostics.wall_seconds < LONG {
        times.extend((0..REPEATS).map(|_| solve().diagnostics.wall_seconds));
    } else {
        times.push(first.diagnostics.wall_seconds);
    }
    let errors = (first.status == Status::Completed).then(|| errors(&first, reference));
    let message = first.error.as_ref().map(|error| format!("{} at t = {:.4e}", error.code, error.time));
    let outcome = match first.status {
        Status::Completed => Outcome::Completed,
        Status::Stopped => Outcome::Stopped,
        Status::Failed => Outcome::Failed,
    };
    let run = Run { outcome, steps: first.diagnostics.steps.accepted, errors, message, ..Run::at(rung) };
    Run { trusted: Some(first.verdict.trusted), ..run.timed(times) }
}

fn errors(solution: &Solution, reference: &Reference) -> Errors {
    let columns: Vec<Option<&[f64]>> =
        solution.trajectory.fields.iter().map(|field| Some(field.values.as_slice())).collect();
    reference.errors(&columns, Some(&switch_times(solution)))
}

/// Returns the observed order of a method between two runs: exponent of the step size, or of the tolerance, with which
/// the error at the end changed; `None` if an error is at the level of rounding.
pub fn change(before: &Run, run: &Run) -> Option<f64> {
    let error = |run: &Run| Some(run.errors.as_ref()?.end.filter(|error| *error > ROUNDING)?.ln());
    let rung = |run: &Run| Some(run.rtol.or(run.step)?.ln());
    Some((error(before)? - error(run)?) / (rung(before)? - rung(run)?)).filter(|power| power.is_finite())
}
