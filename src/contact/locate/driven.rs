//! Contacts that slip however little the force on them exceeds their friction.
//!
//! Their slip in a probe may be far below its changes of velocity by normal forces, which is where a contact counts as
//! sticking. What tells it from rounding is the law itself: friction is at its bound and opposes the slip. Contacts that
//! stick with slack are held as by a joint, and may share the load of others that they determine: feet of one table. The
//! slip of a contact that they leave free, as that of a body on top of another, nothing holds back.

use super::EventDriven;
use super::mode::{Status, held};
use crate::velocity_step::Probed;
use nalgebra::Vector2;

/// The rounding of velocities and impulses of a probe, relative to the largest.
const ROUNDING: f64 = 1e-13;

/// The part of its bound by which friction at the bound may miss it.
const AT_BOUND: f64 = 1e-9;

/// The part of a slip, squared and in the metric of `M`, that is left to it where rows that hold determine it: ranks are
/// known to `1e-11`.
const DETERMINED: f64 = 1e-9;

impl EventDriven<'_> {
    /// Lets those contacts slip that stick in `mode`, but are driven past their friction in a direction that no other
    /// contact holds.
    pub(super) fn release_driven(&mut self, probed: &[Probed], mode: &mut [Status]) {
        let largest = probed.iter().fold(0.0_f64, |most, probed| most.max(probed.change));
        // In a plane, a sign is known from the residual on. Directions of several contacts that err differently push each other
        // aside by their errors, which must be less than the excess of the force: both in units of the force, error and excess are
        // the residual divided by the slip, and the slip.
        let residual = |probed: &Probed| match self.structure.contacts[probed.contact].slips {
            2 if mode.iter().filter(|status| status.is_closed()).count() > 1 => probed.residual.sqrt(),
            _ => probed.residual,
        };
        let is_driven =
            |probed: &&Probed| mode[probed.contact] == Status::Stick && is_driven(probed, residual(probed) * largest);
        let driven: Vec<&Probed> = probed.iter().filter(is_driven).collect();
        if driven.is_empty() {
            return;
        }
        let mut others = mode.to_vec();
        driven.iter().for_each(|probed| others[probed.contact] = Status::Frictionless);
        let rows = held(&self.structure, &others);
        for probed in driven {
            let direction = slip(probed).normalize();
            if self.step.freedom(probed.contact, &direction, &rows) > DETERMINED {
                mode[probed.contact] = Status::Slip(direction);
            }
        }
    }
}

/// Whether a slip is more than rounding and than what the solver of the law leaves, `unsolved`, and opposed by friction at its
/// bound.
fn is_driven(probed: &Probed, unsolved: f64) -> bool {
    let (friction, slip) = (Vector2::new(probed.r.y, probed.r.z), slip(probed));
    let most = probed.mu * probed.r.x;
    let is_bound = most - friction.norm() <= AT_BOUND * most + ROUNDING * probed.r.x;
    is_bound && slip.norm() > (ROUNDING * probed.change).max(unsolved) && friction.dot(&slip) <= 0.0
}

/// The slip at the end of the probe.
fn slip(probed: &Probed) -> Vector2<f64> {
    Vector2::new(probed.after.y, probed.after.z)
}
