//! Verification of the monodromy matrix, whose eigenvalues are the Floquet multipliers, by differences of runs over a
//! period in one direction. Step sizes are chosen for the orbit and not for its neighbourhood: a constant orbit is
//! exact with any steps, but its derivative is not.

use super::CheckCode;
use super::Plan;
use super::sensitivities::{GOLDEN, MOST_MOVED, POWER, SLACK, generic_parts};
use super::shooting::{Shot, Subject, modulus};
use super::verdict::Checks;
use nalgebra::DVector;
use problem::Control;

/// Largest number of times that the increment of the states is reduced if the result is not a difference quotient:
/// once by the amount that the first difference suggests, and once more in case the first difference was limited by
/// bounds.
const CLOSER: usize = 2;

/// Differences of the end states of runs that begin on either side of an orbit.
struct Differences {
    /// The change of each end state that the monodromy matrix predicts.
    derivative: DVector<f64>,
    near: DVector<f64>,
    /// Half the difference of the end states of runs that begin at twice the distance from the orbit.
    far: DVector<f64>,
    /// The tolerances of the end states in the runs that begin at twice the distance from the orbit.
    scale: Vec<f64>,
}

/// Returns the multipliers of an orbit, and records their check. Multipliers do not depend on the point of the orbit
/// at which the period begins, but the monodromy matrix does: if rates switch at this point, the matrix is only a
/// one-sided derivative, and finite differences do not converge to it. If the check fails, it is repeated for a
/// period that begins at another point of the orbit; the multipliers of that period are returned if it passes there,
/// and if they agree with the first ones or `may_replace` is set.
pub(super) fn find(
    subject: Subject<'_>,
    plan: &Plan,
    shot: &Shot,
    may_replace: bool,
    control: &Control,
    checks: &mut Checks,
) -> Vec<[f64; 2]> {
    let found = shot.multipliers();
    let is_sure = |checks: &Checks| checks.get(CheckCode::Derivatives).is_some_and(|(value, allowed)| value <= allowed);
    let mut at_start = Checks::default();
    check(subject, plan, shot, control, &mut at_start);
    if !is_sure(&at_start)
        && at_start.get(CheckCode::Derivatives).is_some()
        && let Some((plan, later)) = later(subject, plan, shot, control)
    {
        let mut elsewhere = Checks::default();
        check(subject, &plan, &later, control, &mut elsewhere);
        let others = later.multipliers();
        if is_sure(&elsewhere) && (may_replace || is_same(&found, &others, part_of(subject))) {
            checks.absorb(elsewhere);
            return others;
        }
    }
    checks.absorb(at_start);
    found
}

/// Returns the increment of a state for finite differences, relative to the size of the state.
fn part_of(subject: Subject<'_>) -> f64 {
    subject.settings().rtol.powf(POWER).min(MOST_MOVED)
}

/// Whether two lists of multipliers, by decreasing modulus, differ by at most a fraction `part` of the largest
/// multiplier.
fn is_same(some: &[[f64; 2]], others: &[[f64; 2]], part: f64) -> bool {
    let largest = some.first().map_or(0.0, modulus);
    some.len() == others.len()
        && some.iter().zip(others).all(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]) <= part * largest)
}

/// Makes a run over an orbit that begins later by an irrational fraction of the period, since symmetric orbits switch
/// at simple fractions.
fn later(subject: Subject<'_>, plan: &Plan, shot: &Shot, control: &Control) -> Option<(Plan, Shot)> {
    let after = GOLDEN * shot.period;
    let begins = subject.end(plan, (&shot.from, after), control).ok()?;
    let plan = Plan { start: plan.start + after, end: plan.start + after + shot.period, ..plan.clone() };
    let later = subject.shoot(&plan, (&begins.to, shot.period), &[], control).ok()?;
    Some((plan, later))
}

/// Records the check of the monodromy matrix of an orbit against a finite difference of runs.
fn check(subject: Subject<'_>, plan: &Plan, shot: &Shot, control: &Control, checks: &mut Checks) {
    let Ok(monodromy) = &shot.monodromy else { return };
    let settings = subject.settings();
    let part = part_of(subject);
    let tolerances = settings.tolerances(0, &vec![0.0; shot.from.len()]);
    // A state below its absolute tolerance counts as zero; its increment has the scale one.
    let sizes = shot.scale.iter().zip(&tolerances).map(|(scale, atol)| {
        let largest = (scale - atol) / settings.rtol;
        if largest > *atol { largest } else { 1.0 }
    });
    let sizes: Vec<f64> = sizes.collect();
    let mut moved: Vec<f64> = sizes.iter().zip(generic_parts()).map(|(size, generic)| part * generic * size).collect();
    for closer in 0..=CLOSER {
        let Some(Differences { derivative, near, far, scale }) = differences(subject, plan, shot, &moved, control)
        else {
            if closer == 0 {
                let message =
                    "runs from beside the orbit, which its multipliers are compared with, did not last for a period";
                checks.caveat("derivatives_not_checked", message.to_owned());
            }
            return;
        };
        let mut is_quotient = true;
        for (i, row) in monodromy.row_iter().enumerate() {
            // Errors at the start of a run are amplified by the monodromy matrix.
            let noise = scale[i] + row.iter().zip(&shot.scale).map(|(value, scale)| value.abs() * scale).sum::<f64>();
            let apart = (near[i] - far[i]).abs();
            if apart > noise + near[i].abs().max(far[i].abs()) / SLACK {
                is_quotient = false;
                continue;
            }
            // A finite difference has half of the digits of the runs.
            let size: f64 = row.iter().zip(&moved).map(|(value, moved)| (value * moved).abs()).sum();
            let (allowed, distance) = (SLACK * (apart + noise) + part * size, (derivative[i] - near[i]).abs());
            let off = if distance == 0.0 { 0.0 } else { distance / allowed };
            checks.record(CheckCode::Derivatives, off, 1.0, || {
                let name = plan.names.get(i).map_or("a state", String::as_str);
                format!(
                    "the derivative of `{name}` after a period is {:e} in a direction in which the difference of two runs is \
                     {:e}, with an uncertainty of {:.0e}, so that the multipliers are not what they are said to be: the orbit \
                     may begin where the rates switch, or its steps be too long for what is near it (`max_step`)",
                    derivative[i], near[i], apart + noise
                )
            });
        }
        if is_quotient {
            return;
        }
        let gain = near.iter().zip(&sizes).map(|(near, size)| near.abs() / (part * size)).fold(SLACK, f64::max);
        moved.iter_mut().for_each(|moved| *moved /= gain);
    }
    let message = "runs from beside the orbit, which its multipliers are compared with, differ from it by no multiple of how far \
                   from it they begin";
    checks.caveat("derivatives_not_checked", message.to_owned());
}

/// Computes the differences of runs that begin beside the orbit; returns `None` if a run does not reach its end.
fn differences(
    subject: Subject<'_>,
    plan: &Plan,
    shot: &Shot,
    moved: &[f64],
    control: &Control,
) -> Option<Differences> {
    let monodromy = shot.monodromy.as_ref().ok()?;
    let run = |multiple: f64| -> Option<(Vec<f64>, Shot)> {
        let from: Vec<f64> = shot.from.iter().zip(moved).map(|(x, moved)| x + multiple * moved).collect();
        let from = subject.allowed(plan, (&from, shot.period), control);
        let end = subject.end(plan, (&from, shot.period), control).ok()?;
        Some((from, end))
    };
    let [above, below, far_above, far_below] = [1.0, -1.0, 2.0, -2.0].map(run);
    let (above, below, far_above, far_below) = (above?, below?, far_above?, far_below?);
    let half = |a: &[f64], b: &[f64]| DVector::from_iterator(a.len(), a.iter().zip(b).map(|(a, b)| 0.5 * (a - b)));
    let derivative = monodromy * half(&above.0, &below.0);
    let scale = (0..shot.from.len()).map(|i| far_above.1.scale[i].max(far_below.1.scale[i])).collect();
    Some(Differences {
        derivative,
        near: half(&above.1.to, &below.1.to),
        far: half(&far_above.1.to, &far_below.1.to) * 0.5,
        scale,
    })
}
