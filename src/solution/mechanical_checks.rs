//! Checks of the energy balance, joints and gaps of a run with contacts, for the verdict.
//!
//! With tolerances, the permitted defect is the sum over the steps of their permitted errors: velocities accurate to
//! `rtol` keep the energy accurate to `2 rtol`. Fixed steps have no tolerance; the limit is a thousandth of the
//! largest value, which is visible in a plot. A first-order scheme may have a larger defect if its order explains it:
//! up to the sum of the step errors, estimated from forces and velocities, as long as the states stay within the
//! accuracy that first order promises.

use super::{CheckCode, Checks};
use contact::energy::Energy;
use contact::{Grazed, Passed, Screening, Violation, Violations};
use radau::ALLOWED;

/// Largest permitted defect of the energy balance or of a constraint, relative to the largest energy or length,
/// whatever the tolerances.
pub(super) const LARGEST_PART: f64 = 1e-3;

/// Permitted error of the states of a first-order scheme, as a multiple of their motion per step. The errors of steps
/// add up over the periods of an oscillation: a smaller multiple would reject runs over some tens of periods that are
/// correct to first order; a larger one would accept an oscillation that the scheme has damped away.
const STEPS: f64 = 30.0;

/// Largest defect of the energy balance that the order of a scheme may explain, relative to the largest energy. A loss
/// of a twentieth of the energy is a loss of a fortieth of the amplitude, which is visible in a plot.
const MOST_EXCUSED: f64 = 0.05;

/// Relative rounding error of the constraints of joints and of gaps after position corrections.
const ROUNDING: f64 = 1e-9;

/// Permitted error of a collocation polynomial between the stages, in units of the error tolerance at the end of the
/// step.
const BETWEEN_STAGES: f64 = 100.0;

/// Energy lost by rounding in an elastic impact, relative to the largest energy.
const ROUNDING_OF_IMPACTS: f64 = 1e-11;

/// The accuracy that the user requested of a run: fixed steps, or tolerances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Accuracy {
    /// Fixed steps, without a tolerance.
    Fixed,
    /// Steps adapted to a tolerance.
    Tolerance {
        /// The relative tolerance of the run.
        rtol: f64,
        /// Kinetic energy of velocities as large as their absolute tolerances.
        atol: f64,
        /// Work of the forces along displacements as large as their absolute tolerances.
        work: f64,
        /// Number of accepted steps of the run.
        steps: u64,
    },
}

impl Accuracy {
    /// Returns the permitted defect of the energy balance for this accuracy of the run.
    fn of_energy(self, energy: &Energy) -> f64 {
        let (size, most) = (energy.size(), LARGEST_PART * energy.size());
        let permitted = match self {
            Self::Fixed => energy.explained(STEPS).min(MOST_EXCUSED * size).max(most),
            // Bounds `v^T M dv` with `|dv| <= rtol |v| + atol`, by the Cauchy-Schwarz inequality, and `f^T dq`.
            Self::Tolerance { rtol, atol, work, steps } => {
                let steps = steps as f64;
                (2.0 * steps * (rtol * size + (size * atol).sqrt() + atol)).min(most) + steps * work
            }
        };
        permitted + energy.rounding()
    }

    fn remedy(self) -> &'static str {
        match self {
            Self::Fixed => "choose a smaller `step`",
            Self::Tolerance { .. } => "lower `rtol`, or set `max_step`",
        }
    }
}

/// Records the check of the defect of the energy balance against its permitted value.
pub(super) fn check_energy(energy: &Energy, accuracy: Accuracy, checks: &mut Checks) {
    let (allowed, size, remedy) = (accuracy.of_energy(energy), energy.size(), accuracy.remedy());
    let lacking = energy.lacking();
    checks.record(CheckCode::EnergyBalance, lacking, allowed, || {
        format!(
            "the energy balance has a defect of {lacking:.1e} at worst, compared with {size:.1e}, the largest energy, \
             including work and dissipation: the motion gains or loses energy without a source or sink; {remedy}"
        )
    });
    let lost = energy.lost_beyond_restitution;
    // The order of a time-stepping scheme does not excuse an energy defect of impulses, so that its larger limit does
    // not apply.
    let allowed = match accuracy {
        Accuracy::Fixed => LARGEST_PART * size + energy.rounding(),
        Accuracy::Tolerance { .. } => allowed,
    };
    checks.record(CheckCode::EnergyBalance, lost.abs(), allowed, || {
        format!(
            "impacts with restitution 1 changed the energy by {:.1e}, compared with {size:.1e}, the largest \
             energy of the run: they should conserve it; {remedy}, or set `impact_law` to `sequential`",
            -lost
        )
    });
}

/// Records the check of the violations of joints and gaps against their permitted values: a fraction of the length
/// scale of each joint or gap in the run for fixed steps, else the tolerances. `names` are those of the contacts.
pub(super) fn check_violations(violations: &Violations, names: &[String], accuracy: Accuracy, checks: &mut Checks) {
    let allowed = |seen: &Violation| {
        let permitted = match accuracy {
            Accuracy::Fixed => LARGEST_PART * seen.length,
            Accuracy::Tolerance { steps, .. } => {
                let most = (LARGEST_PART * seen.length).max(BETWEEN_STAGES * seen.tolerance);
                (steps.max(1) as f64 * seen.tolerance).min(most)
            }
        };
        permitted + ROUNDING * seen.terms
    };
    let remedy = accuracy.remedy();
    for (k, seen) in violations.joints().iter().enumerate() {
        checks.record(CheckCode::JointDrift, seen.by, allowed(seen), || {
            let Violation { by, t, length, .. } = seen;
            format!(
                "joint {k} (counted from 0) is violated by {by:.1e} at t = {t:?}, compared with {length:.1e}, the \
                 largest length that it met: {remedy}"
            )
        });
    }
    for (name, seen) in names.iter().zip(violations.gaps()) {
        checks.record(CheckCode::ConstraintResidual, seen.by, allowed(seen), || {
            let Violation { by, t, length, .. } = seen;
            format!(
                "the gap of `{name}` is violated by {by:.1e} at t = {t:?}, where it is closed or must not be negative, \
                 compared with {length:.1e}, the largest length that it met: {remedy}"
            )
        });
    }
}

/// Records the check of a grazing contact of which the tolerances cannot decide whether it closes.
pub(super) fn check_grazed(grazed: &Grazed, name: &str, checks: &mut Checks) {
    checks.record(CheckCode::EventsUnproven, grazed.change, ALLOWED, || {
        format!(
            "at t = {:?} `{name}` grazes: its gap reaches zero, within the uncertainty of the tolerances, with hardly \
             any speed, so that the contact may be missed or not; this may change a velocity by {:.1e} times its \
             tolerance, and what follows is accurate only to the square root of `rtol`",
            grazed.t, grazed.change
        )
    });
}

/// Records the check of steps in which an event was missed or may have been missed.
pub(super) fn check_screening(screening: Screening, checks: &mut Checks) {
    let Screening { proven, undecided, missed } = screening;
    checks.record(CheckCode::EventsUnproven, missed as f64, 0.0, || {
        format!(
            "in {missed} steps a gap closes between the points examined, or a closed contact pulls or is held beyond \
             its friction, and the time at which that begins could not be located; a smaller `max_step` may help"
        )
    });
    if undecided > 0 {
        let steps = proven + undecided + missed;
        checks.caveat(
            "events_not_proven",
            format!("{undecided} of {steps} steps are not proven free of events; none was seen at the points examined"),
        );
    }
}

/// Records the check of the energy removed to pass accumulations of impacts against the tolerance; with elastic impacts
/// only rounding is permitted, since they have no accumulation.
pub(super) fn check_passed(passed: &Passed, name: &str, energy: &Energy, rtol: f64, checks: &mut Checks) {
    let part = if energy.size() > 0.0 { passed.energy.abs() / energy.size() } else { 0.0 };
    let allowed = if passed.is_elastic { ROUNDING_OF_IMPACTS } else { rtol.max(ROUNDING_OF_IMPACTS) };
    checks.record(CheckCode::AccumulationPassed, part, allowed, || {
        let why = if passed.is_elastic {
            "its restitution is 1, with which impacts do not accumulate"
        } else {
            "impacts so close together may have ended differently"
        };
        format!(
            "at t = {:?} impacts of `{name}` followed each other so fast that the run replaced them by one without \
             restitution, which removed {part:.1e} of the energy: {why}; shorten the horizon, or set `impacts` to \
             `time_stepping`",
            passed.t
        )
    });
}
