//! Resolution of overlaps of bodies, initial or due to curvature within a step, by displacements that do not change
//! velocities.

use super::super::contact::Contact;
use super::super::scene::MultibodySystem;
use super::{MoreauStepping, StepFailure};
use nalgebra::Vector3;
use problem::Control;

/// Tolerance for gaps and penetration, relative to the size of the smaller body.
pub(super) const OVERLAP: f64 = 5e-7;

/// Maximum number of iterations of the resolution of bodies' overlaps within a step.
const ROUNDS: usize = 3;
/// Maximum number of iterations of the resolution of bodies' initial overlaps, which may be deep.
const ROUNDS_AT_START: usize = 100;

impl MoreauStepping<'_> {
    /// Resolves initial overlaps and projects initial velocities onto the joint constraints, both by the smallest
    /// change in the mass norm. Returns whether both succeeded.
    ///
    /// # Errors
    /// If contact detection fails or is interrupted.
    pub fn resolve(&mut self, control: &Control) -> Result<bool, StepFailure> {
        self.ground();
        for _ in 0..ROUNDS_AT_START {
            self.detect(0.0, control)?;
            if self.depth(OVERLAP) <= 0.0 {
                self.group();
                self.partition_into_islands();
                let obeyed = self.solve_each(|island, mechanism, _| island.obey_joints(mechanism)).is_ok();
                self.ends.clone_from(&self.moving);
                return Ok(obeyed);
            }
            let separated = self.separate(control);
            control.go_on()?;
            if separated.is_err() {
                return Ok(false);
            }
        }
        Ok(false)
    }

    /// Resolves overlaps of bodies at the beginning of a step of size `h`.
    pub(super) fn part_overlaps(&mut self, h: f64, control: &Control) -> Result<(), StepFailure> {
        for _ in 0..ROUNDS {
            if self.depth(OVERLAP) <= 0.0 {
                break;
            }
            self.separate(control)?;
            self.detect(h, control)?;
        }
        Ok(())
    }

    /// Returns the deepest penetration of a contact in excess of `fraction` of the smaller body's size; joint stops
    /// count only if `fraction` is positive.
    pub(super) fn depth(&self, fraction: f64) -> f64 {
        let excess = |contact: &Contact| -contact.gap - fraction * contact.size;
        let surfaces = self.contacts.iter().filter(|contact| fraction > 0.0 || !contact.is_stop());
        surfaces.map(excess).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Returns the deepest penetration of a contact, relative to the smaller body's size.
    pub(super) fn overlap(&self) -> f64 {
        self.contacts.iter().map(|contact| -contact.gap / contact.size).fold(0.0, f64::max)
    }

    /// Rounds tiny gaps of contacts to zero. With redundant contacts the normal velocities `-gap/h` that close the gaps
    /// within a step are inconsistent, and impulses would grow without bound.
    pub(super) fn close(&mut self) {
        for contact in &mut self.contacts {
            if contact.gap < contact.no_gap {
                contact.gap = contact.gap.min(0.0);
            }
        }
    }

    /// Resolves overlaps by the smallest displacement of bodies, in the mass norm, that makes all gaps nonnegative: a
    /// frictionless contact problem with displacements in place of velocities and gaps in place of free velocities.
    fn separate(&mut self, control: &Control) -> Result<(), StepFailure> {
        let kept: Vec<(Vector3<f64>, Vector3<f64>)> = self.moving.iter().map(|m| (m.velocity, m.omega)).collect();
        for motion in &mut self.moving {
            (motion.velocity, motion.omega) = Default::default();
        }
        self.contacts.retain(|contact| !contact.is_torque());
        for contact in &mut self.contacts {
            *contact = contact.of_displacements();
        }
        self.group();
        self.partition_into_islands();
        let solved = self.solve_each(|island, mechanism, law| island.displace(mechanism, law, control));
        for (motion, (velocity, omega)) in self.moving.iter_mut().zip(kept) {
            let (by, rotation) = (motion.velocity, motion.omega);
            (motion.velocity, motion.omega) = (velocity, omega);
            motion.displace(&by, &rotation);
        }
        solved.map_err(StepFailure::from)
    }
}

/// Returns the size of the smaller of two bodies.
pub(super) fn smaller(scene: &MultibodySystem, a: usize, b: usize) -> f64 {
    let reach = |body: usize| scene.bodies[body].collider.reach();
    reach(a).min(reach(b))
}
