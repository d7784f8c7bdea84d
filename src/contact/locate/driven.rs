//! Contacts that slip although the force on them exceeds their friction only slightly.
//!
//! The slip of such a contact in a probe step may be far below its velocity change by normal forces, below which a
//! contact counts as sticking. The contact law itself tells the slip from rounding: friction is at its bound and
//! opposes the slip. Contacts that stick with slack act as joints, and may take over the load of contacts whose
//! motion they determine: the feet of one table. The slip of a contact whose motion they do not determine, such as
//! that of a body on top of another, is held back by nothing.

use super::EventDriven;
use super::mode::{Status, held};
use crate::velocity_step::Probed;
use nalgebra::Vector2;

/// Rounding error of velocities and impulses of a probe (trial) step, relative to the largest velocity or impulse.
const ROUNDING: f64 = 1e-13;

/// Relative tolerance within which a friction impulse counts as at its bound.
const AT_BOUND: f64 = 1e-9;

/// A slip is free if this share of it (squared, in the metric of `M`) remains after projection onto the rows held by
/// the other contacts: ranks are determined to `1e-11`.
const DETERMINED: f64 = 1e-9;

impl EventDriven<'_> {
    /// Sets contacts that stick in `mode` to slipping if the other forces drive them past their friction bound in a
    /// direction that no other contact holds.
    pub(super) fn release_driven(&mut self, probed: &[Probed], mode: &mut [Status]) {
        let largest = probed.iter().fold(0.0_f64, |most, probed| most.max(probed.change));
        // In a plane, the sign of a slip is known once the slip exceeds the residual. In 3D, the direction errors of
        // several contacts act on one another and must be smaller than the excess of the force over the friction
        // bound. In units of the force, the direction error is the residual divided by the slip, and the excess is
        // the slip: hence the slip must exceed the square root of the residual.
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

/// Whether the slip of a contact at the end of the probe step exceeds both rounding and the error `unsolved` of the
/// solver of the contact law, and is opposed by friction at its bound.
fn is_driven(probed: &Probed, unsolved: f64) -> bool {
    let (friction, slip) = (Vector2::new(probed.r.y, probed.r.z), slip(probed));
    let most = probed.mu * probed.r.x;
    let is_bound = most - friction.norm() <= AT_BOUND * most + ROUNDING * probed.r.x;
    is_bound && slip.norm() > (ROUNDING * probed.change).max(unsolved) && friction.dot(&slip) <= 0.0
}

/// Returns the slip of a contact at the end of the probe step.
fn slip(probed: &Probed) -> Vector2<f64> {
    Vector2::new(probed.after.y, probed.after.z)
}
