//! The error of the states at the end, estimated by a second, more accurate run: the difference of the two is the error
//! of the first, but for that of the second (reintegration; Skeel 1986, Thirteen ways to estimate global error, section 3).
//!
//! With a step that follows the error the second run has a hundredth of the tolerances. With a fixed step it has half
//! the step, and `2^p / (2^p - 1)`, `p = 2s - 1`, makes up for what is left of its own error (Richardson). Switches and
//! jumps need no thought, since both runs meet them. Not valid where the two take different solutions of a problem that
//! has several, where the tolerance is near the rounding errors, and between a first run too coarse and the solution.

use super::integrate::integrate_once;
use super::run::Ended;
use super::{CheckCode, GlobalError, Plan, Status, Warning};
use analysis::Analysis;
use models::DviModel;
use problem::Control;
use radau::{Settings, StageChoice};

/// What the tolerances of the second run are multiplied by; below the least there is only rounding.
const TIGHTER: f64 = 0.01;
const LEAST_RTOL: f64 = 1e-14;

/// About the part of the work that the first run is.
pub const SHARE: f64 = 0.5;

/// Runs again, for the rest of the progress, and takes the estimate into the diagnostics of a first run; or a warning
/// where the second does not reach the end.
pub fn estimate(
    model: &DviModel,
    plan: &Plan,
    settings: &Settings,
    analysis: &Analysis,
    control: &Control,
    first: &mut Ended,
) {
    let (tighter, factor) = more_accurate(settings);
    let n = plan.initial.len();
    let reference =
        Plan { times: Some(vec![plan.end]), fields: Vec::new(), reducers: None, interpolants: None, ..plan.clone() };
    let second = control.part(SHARE..1.0, || integrate_once(model, &reference, &tighter, analysis, control));
    let diagnostics = &mut first.solution.diagnostics;
    diagnostics.wall_seconds += second.solution.diagnostics.wall_seconds;
    if second.solution.status != Status::Completed {
        let why = second.solution.error.map_or_else(String::new, |error| format!(": {}", error.message));
        let message = format!("the second, more accurate run for the global error did not reach the end{why}");
        diagnostics.warnings.push(Warning { code: "global_error_unknown", message });
        return;
    }
    let end = &first.x;
    let errors: Vec<f64> = end.iter().zip(&second.x).map(|(x, exact)| factor * (x - exact)).collect();
    let scale = |j: usize| settings.atol[j] + settings.rtol * end[j].abs();
    let largest_scaled = (0..n).map(|j| errors[j].abs() / scale(j)).fold(0.0, f64::max);
    // Errors of the tolerance in every step, which neither grow nor decay, add up to as many.
    let steps = diagnostics.steps.accepted.max(1) as f64;
    diagnostics.checks.record(CheckCode::GlobalError, largest_scaled, steps, || {
        format!("the states at the end are off by {largest_scaled:.1e} times their tolerance after {steps} steps")
    });
    diagnostics.global_error = Some(GlobalError {
        largest_scaled,
        states: plan.names.iter().cloned().zip(errors).collect(),
        reference_steps: second.solution.diagnostics.steps.accepted,
    });
}

/// The settings of the second run, and what its distance to the first is multiplied by.
fn more_accurate(settings: &Settings) -> (Settings, f64) {
    let mut second = settings.clone();
    let tighter = TIGHTER.max(LEAST_RTOL / settings.rtol).min(1.0);
    second.rtol *= tighter;
    second.atol.iter_mut().for_each(|atol| *atol *= tighter);
    let (Some(step), StageChoice::Fixed(s)) = (settings.step, settings.stages) else { return (second, 1.0) };
    second.step = Some(0.5 * step);
    let reduction = 2.0_f64.powi(2 * s as i32 - 1);
    (second, reduction / (reduction - 1.0))
}
