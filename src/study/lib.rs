//! Error against run time (work-precision diagrams; Hairer and Wanner 1996, *Solving Ordinary Differential Equations
//! II*, section IV.10): one problem solved at each of a ladder of tolerances or steps, with errors relative to an exact
//! solution or a more accurate run.

pub mod contraction;
pub mod energies;
pub mod linear_stability;
mod page;
pub mod report;
mod solve;
pub mod stability;
mod sweep;

pub use page::{Peer, html};
pub use solve::{solve, solve_on};
pub use sweep::{features, merge, sweep};

use problem::Control;
use solution::pictures::work_precision;
use solution::{Series, Solution, Status, Study, StudyRun, Trajectory};
use solve::solve_once;
use specification::{By, Exact, Model, Rung, Specification, Stages, StudyPlan};

/// Default number of times at which errors of a study are measured.
const TIMES: usize = 33;

/// Runs longer than this many seconds are not repeated, since their times hardly vary.
const LONG: f64 = 1.0;

/// Ratio of the finest tolerance of a study to the tolerance of the reference run.
const TIGHTER: f64 = 100.0;
/// Smallest relative tolerance of a reference run: below it, rounding dominates.
const LEAST_RTOL: f64 = 1e-13;
/// Relative tolerance of the reference run for a study of runs with fixed steps.
const REFERENCE_RTOL: f64 = 1e-12;
/// Ratio of the finest step size of a study to the step size of a reference run with fixed steps.
const FINER: f64 = 32.0;

/// Runs a work-precision study: the error of each run against its run time.
pub fn study(specification: &Specification, plan: &StudyPlan, control: &Control) -> Study {
    let times = times(specification);
    let fields = match &plan.exact {
        Some(exact) => exact.fields.clone(),
        None => (0..specification.model().initial().len()).collect(),
    };
    let runs = plan.rungs.len() * plan.stages.len();
    let share = 1.0 / (runs + 1) as f64;
    let run = |rung: Rung, stages: Stages, k: usize| {
        let variant = specification.variant(rung, stages, times.clone(), fields.clone());
        control.part(k as f64 * share..(k + 1) as f64 * share, || solve_once(&variant, control))
    };
    let (reference, values) = match &plan.exact {
        Some(exact) => ("the exact values".to_owned(), Some(exact_values(exact, &times))),
        None => {
            let (rung, name) = reference(specification.model(), &plan.rungs);
            let solution = run(rung, Stages::Auto, runs);
            match solution.status {
                Status::Completed if solution.verdict.trusted => (name, Some(columns(&solution.trajectory))),
                Status::Completed => (format!("{name}, which is not trusted"), Some(columns(&solution.trajectory))),
                Status::Stopped | Status::Failed => (format!("{name}, which did not reach the end"), None),
            }
        }
    };
    let mut series = Vec::with_capacity(plan.stages.len());
    for (i, &stages) in plan.stages.iter().enumerate() {
        let mut done: Vec<StudyRun> = Vec::with_capacity(plan.rungs.len());
        for (j, &rung) in plan.rungs.iter().enumerate() {
            let mut measured = measure(plan.repeats, || run(rung, stages, i * plan.rungs.len() + j));
            if let (Some(values), Status::Completed) = (&values, measured.0.status) {
                (measured.1.error_at_end, measured.1.largest_error) = errors(&measured.0.trajectory, values);
            }
            let mut measured = measured.1;
            match rung {
                Rung::Tolerance(rtol) => measured.rtol = Some(rtol),
                Rung::Step(step) => measured.step = Some(step),
            }
            measured.order = done.last().and_then(|before| order(before, &measured));
            done.push(measured);
        }
        series.push(Series { method: specification.model().method_name(stages), runs: done });
    }
    let picture = work_precision(&series, specification.label(), &reference);
    Study { reference, series, picture }
}

/// Returns the output times of the specification, or else equally spaced times, always with the end of the horizon.
fn times(specification: &Specification) -> Vec<f64> {
    let time = specification.time();
    let mut times = match specification.output_times() {
        Some(times) => times.to_vec(),
        None => (0..TIMES).map(|k| time.start + (time.end - time.start) * (k as f64 / TIMES as f64)).collect(),
    };
    if times.last().is_none_or(|last| *last < time.end) {
        times.push(time.end);
    }
    times
}

/// Returns the accuracy setting of the reference run, finer than all others in the study, and its description.
fn reference(model: &dyn Model, rungs: &[Rung]) -> (Rung, String) {
    let finest = rungs.iter().fold(f64::INFINITY, |finest, rung| match rung {
        Rung::Tolerance(x) | Rung::Step(x) => finest.min(*x),
    });
    let by_step = matches!(rungs.first(), Some(Rung::Step(_)));
    if by_step && model.varied().reference == By::Step {
        let step = finest / FINER;
        return (Rung::Step(step), format!("a run with the step {step:e}"));
    }
    let rtol = if by_step { REFERENCE_RTOL } else { (finest / TIGHTER).max(LEAST_RTOL) };
    (Rung::Tolerance(rtol), format!("a run with the relative tolerance {rtol:e}"))
}

fn exact_values(exact: &Exact, times: &[f64]) -> Vec<Vec<f64>> {
    let (mut tape, mut row) = (exact.values.clone(), vec![0.0; exact.fields.len()]);
    let mut columns = vec![Vec::with_capacity(times.len()); exact.fields.len()];
    for &t in times {
        tape.evaluate(t, &[], &mut row);
        columns.iter_mut().zip(&row).for_each(|(column, value)| column.push(*value));
    }
    columns
}

fn columns(trajectory: &Trajectory) -> Vec<Vec<f64>> {
    trajectory.fields.iter().map(|field| field.values.clone()).collect()
}

/// Solves `repeats` times, or once if the first solve fails or takes longer than `LONG` seconds. Returns the first
/// solution, and its run in the study with the median of the run times.
fn measure(repeats: usize, solve: impl Fn() -> Solution) -> (Solution, StudyRun) {
    let first = solve();
    let mut times = vec![first.diagnostics.wall_seconds];
    while times.len() < repeats && first.status == Status::Completed && times[0] < LONG {
        times.push(solve().diagnostics.wall_seconds);
    }
    times.sort_by(f64::total_cmp);
    let run = StudyRun {
        rtol: None,
        step: None,
        status: first.status,
        trusted: Some(first.verdict.trusted),
        steps: first.diagnostics.steps.accepted,
        wall_seconds: times[times.len() / 2],
        error_at_end: None,
        largest_error: None,
        order: None,
    };
    (first, run)
}

/// Size of an output column, relative to the largest column, below which the column counts as zero up to rounding.
const ZERO: f64 = 1e-12;

/// Returns the largest errors of a run at the end and at all times, relative to the largest value of each column, or
/// for a zero column to the largest value of all columns.
fn errors(trajectory: &Trajectory, values: &[Vec<f64>]) -> (Option<f64>, Option<f64>) {
    let size_of = |exact: &Vec<f64>| exact.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
    let most = values.iter().map(size_of).fold(0.0, f64::max);
    let most = if most > 0.0 { most } else { 1.0 };
    let (mut at_end, mut largest) = (0.0_f64, 0.0_f64);
    for (field, exact) in trajectory.fields.iter().zip(values) {
        let size = size_of(exact);
        let size = if size > ZERO * most { size } else { most };
        let mut differences = field.values.iter().zip(exact).map(|(x, exact)| (x - exact).abs() / size);
        // Take the maximum of the errors such that it propagates NaN, which must not be reported as an error of zero.
        let worst = differences.clone().fold(0.0, |worst, x| if x > worst || x.is_nan() { x } else { worst });
        largest = if worst > largest || worst.is_nan() { worst } else { largest };
        at_end = at_end.max(differences.next_back().unwrap_or(0.0));
    }
    (Some(at_end).filter(|x| x.is_finite()), Some(largest).filter(|x| x.is_finite()))
}

fn order(before: &StudyRun, run: &StudyRun) -> Option<f64> {
    let rung = |run: &StudyRun| run.rtol.or(run.step);
    let errors = before.error_at_end?.ln() - run.error_at_end?.ln();
    Some(errors / (rung(before)?.ln() - rung(run)?.ln())).filter(|order| order.is_finite())
}
