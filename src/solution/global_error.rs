//! The global error of the states at the end, estimated by a second, more accurate run: the difference of the two runs
//! is the error of the first up to that of the second (reintegration; Skeel 1986, Thirteen ways to estimate global
//! error, section 3).
//!
//! With error control, the second run has a hundredth of the tolerances. With a fixed step it has half the step, and
//! the factor `2^p / (2^p - 1)`, `p = 2s - 1`, corrects for its own error (Richardson extrapolation). Switches and
//! jumps need no special treatment, since both runs have them. The estimate is not valid if the two runs approximate
//! different solutions of a problem with several, if the tolerance is near the rounding errors, or if the first run is
//! too coarse.

use super::integrate::integrate_once;
use super::run::Ended;
use super::{CheckCode, GlobalError, Plan, Status, Warning};
use analysis::Analysis;
use models::DviModel;
use problem::Control;
use radau::{Settings, StageChoice};

/// The factor of the tolerances for the second, more accurate run of an estimate of the global error, and the least
/// relative tolerance, below which rounding errors dominate.
const TIGHTER: f64 = 0.01;
const LEAST_RTOL: f64 = 1e-14;

/// The approximate fraction of the work of both runs of an estimate of the global error, the first one and the more
/// accurate second one, that the first run accounts for.
pub const SHARE: f64 = 0.5;

/// Makes the second, more accurate run and records the estimate of the global error in the diagnostics of the first
/// run, or a warning if the second run does not reach the end.
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
    // If local errors neither grow nor decay, the global error is at most the number of steps times the tolerance.
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

/// Returns the settings of the second, more accurate run, and the factor that converts the difference of the two runs
/// to the error of the first.
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
