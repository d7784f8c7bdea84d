//! What the balance of energy, joints and gaps say of a run with contacts, for the verdict.
//!
//! A run with tolerances lacks what its steps may lack together: one that keeps velocities to `rtol` keeps energy to twice
//! that, and errors of steps add up. Steps of one size have no tolerance; a thousandth of what was met is what a picture
//! shows. A scheme of first order may lack more where its order explains it: as much as the errors of its steps, estimated
//! from forces and velocities, add up to, while they leave the states within what first order promises.

use super::{CheckCode, Checks};
use contact::energy::Energy;
use contact::{Grazed, Passed, Screening, Violation, Violations};
use radau::ALLOWED;

/// The part of the largest energy and length met that a run may be off by, whatever its tolerances.
pub(super) const LARGEST_PART: f64 = 1e-3;

/// The steps of motion that states of a scheme of first order may be off by. The errors of steps add up over the periods of
/// an oscillation: with fewer, a few tens of periods are doubted that are right to first order; with more, an oscillation
/// that the scheme has damped away is trusted.
const STEPS: f64 = 30.0;

/// The part of the largest energy that the order of a scheme may excuse. What lost a twentieth of its energy has lost a
/// fortieth of its amplitude, which a picture shows.
const MOST_EXCUSED: f64 = 0.05;

/// Rounding of a joint or a gap, in parts of its terms: what corrections leave.
const ROUNDING: f64 = 1e-9;

/// What a polynomial may be off by between the stages of a step, in units of the tolerance at its end.
const BETWEEN_STAGES: f64 = 100.0;

/// The energy that rounding takes in an elastic impact, in parts of the largest met.
const ROUNDING_OF_IMPACTS: f64 = 1e-11;

/// How exact a run was asked to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Accuracy {
    /// Steps of one size.
    Fixed,
    /// Steps to a tolerance.
    Tolerance {
        /// The relative tolerance.
        rtol: f64,
        /// The energy of velocities as large as their absolute tolerances.
        atol: f64,
        /// The work of the forces over displacements as large as theirs.
        work: f64,
        /// Accepted steps.
        steps: u64,
    },
}

impl Accuracy {
    /// The defect that the balance of energy may have.
    fn of_energy(self, energy: &Energy) -> f64 {
        let (size, most) = (energy.size(), LARGEST_PART * energy.size());
        let permitted = match self {
            Self::Fixed => energy.explained(STEPS).min(MOST_EXCUSED * size).max(most),
            // Of v^T M dv, with |dv| up to rtol |v| + atol, by Cauchy and Schwarz; and of f^T dq.
            Self::Tolerance { rtol, atol, work, steps } => {
                let steps = steps as f64;
                (2.0 * steps * (rtol * size + (size * atol).sqrt() + atol)).min(most) + steps * work
            }
        };
        permitted + energy.rounding()
    }

    fn remedy(self) -> &'static str {
        match self {
            Self::Fixed => "take a smaller `step`",
            Self::Tolerance { .. } => "lower `rtol`, or set `max_step`",
        }
    }
}

/// Compares what the balance of energy lacks with what it may.
pub(super) fn check_energy(energy: &Energy, accuracy: Accuracy, checks: &mut Checks) {
    let (allowed, size, remedy) = (accuracy.of_energy(energy), energy.size(), accuracy.remedy());
    let lacking = energy.lacking();
    checks.record(CheckCode::EnergyBalance, lacking, allowed, || {
        format!(
            "the balance of energy lacks {lacking:.1e} at worst, beside {size:.1e}, the largest energy met with all work and \
             dissipation: the motion gains or loses energy that nothing gives or takes; {remedy}"
        )
    });
    let lost = energy.lost_beyond_restitution;
    // No order of a scheme explains what impulses do.
    let allowed = match accuracy {
        Accuracy::Fixed => LARGEST_PART * size + energy.rounding(),
        Accuracy::Tolerance { .. } => allowed,
    };
    checks.record(CheckCode::EnergyBalance, lost.abs(), allowed, || {
        format!(
            "impacts with restitution 1 changed the energy by {:.1e}, beside {size:.1e}, the largest energy met: they should \
             keep it; {remedy}, or let `impact_law` be `sequential`",
            -lost
        )
    });
}

/// Compares violations of joints and gaps with the lengths met, or with the tolerances. Names are those of the contacts.
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
                "joint {k} (counted from 0) is off by {by:.1e} at t = {t:?}, beside {length:.1e}, the largest length that it \
                 met: {remedy}"
            )
        });
    }
    for (name, seen) in names.iter().zip(violations.gaps()) {
        checks.record(CheckCode::ConstraintResidual, seen.by, allowed(seen), || {
            let Violation { by, t, length, .. } = seen;
            format!(
                "the gap of `{name}` is off by {by:.1e} at t = {t:?}, where it is closed or should not be negative, beside \
                 {length:.1e}, the largest length that it met: {remedy}"
            )
        });
    }
}

/// Tells of a contact of which tolerances do not say whether it was met.
pub(super) fn check_grazed(grazed: &Grazed, name: &str, checks: &mut Checks) {
    checks.record(CheckCode::EventsUnproven, grazed.change, ALLOWED, || {
        format!(
            "at t = {:?} `{name}` grazes: its gap comes to zero, within what the tolerances leave open of it, with hardly any \
             speed, so that a contact may be missed or met; that may change a velocity by {:.1e} times its tolerance, and what \
             follows is right to the root of `rtol` only",
            grazed.t, grazed.change
        )
    });
}

/// Tells of steps in which an event was missed, or may have been.
pub(super) fn check_screening(screening: Screening, checks: &mut Checks) {
    let Screening { proven, undecided, missed } = screening;
    checks.record(CheckCode::EventsUnproven, missed as f64, 0.0, || {
        format!(
            "in {missed} steps a gap closes, or a contact that is held parts, between the points that were looked at, and the \
             time could not be located; a smaller `max_step` may help"
        )
    });
    if undecided > 0 {
        let steps = proven + undecided + missed;
        checks.caveat(
            "events_not_proven",
            format!(
                "{undecided} of {steps} steps are not proven free of events; none was seen at the points looked at"
            ),
        );
    }
}

/// Compares the energy that accumulations of impacts were passed over with, with the tolerance; elastic ones have no limit.
pub(super) fn check_passed(passed: &Passed, name: &str, energy: &Energy, rtol: f64, checks: &mut Checks) {
    let part = if energy.size() > 0.0 { passed.energy.abs() / energy.size() } else { 0.0 };
    let allowed = if passed.is_elastic { ROUNDING_OF_IMPACTS } else { rtol.max(ROUNDING_OF_IMPACTS) };
    checks.record(CheckCode::AccumulationPassed, part, allowed, || {
        let why = if passed.is_elastic {
            "its restitution is 1, with which impacts have no limit"
        } else {
            "impacts that came so close may have had another end"
        };
        format!(
            "at t = {:?} impacts of `{name}` followed each other so fast that the run passed over them by one without \
             restitution, which took {part:.1e} of the energy: {why}; shorten the horizon, or let `impacts` be `time_stepping`",
            passed.t
        )
    });
}
