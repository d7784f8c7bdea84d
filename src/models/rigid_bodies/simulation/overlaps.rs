//! Bodies that overlap, by what curvature does to a step or from the start, are moved apart without a velocity.

use super::super::contact::Contact;
use super::super::scene::MultibodySystem;
use super::{MoreauStepping, StepFailure};
use nalgebra::Vector3;
use problem::Control;

/// Overlaps that are left alone, and gaps that are none, in parts of the smaller body's size.
pub(super) const OVERLAP: f64 = 5e-7;

/// Rounds of moving bodies apart within a step, and at the start where they may lie in each other.
const ROUNDS: usize = 3;
const ROUNDS_AT_START: usize = 100;

impl MoreauStepping<'_> {
    /// Moves bodies apart that overlap, and gives them the velocities that their joints let them have, by the least change
    /// in the norm of the masses; false if that did not do.
    ///
    /// # Errors
    /// If there is no telling.
    pub fn resolve(&mut self, control: &Control) -> Result<bool, StepFailure> {
        for _ in 0..ROUNDS_AT_START {
            self.detect(0.0, control)?;
            if self.depth(OVERLAP) <= 0.0 {
                self.group();
                self.part();
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

    /// Moves the bodies that overlap at the start of a step `h` apart.
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

    /// The deepest overlap beyond `fraction` of the smaller body.
    pub(super) fn depth(&self, fraction: f64) -> f64 {
        let excess = |contact: &Contact| -contact.gap - fraction * contact.size;
        let surfaces = self.contacts.iter().filter(|contact| fraction > 0.0 || !contact.is_stop());
        surfaces.map(excess).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The deepest overlap as a part of the smaller body's size.
    pub(super) fn overlap(&self) -> f64 {
        self.contacts.iter().map(|contact| -contact.gap / contact.size).fold(0.0, f64::max)
    }

    /// Takes gaps that are rounding for none. More contacts at rest than there are freedoms cannot all close by such gaps
    /// at once: velocities `gap/h` that no motion has would drive impulses up without end.
    pub(super) fn close(&mut self) {
        for contact in &mut self.contacts {
            if contact.gap < contact.no_gap {
                contact.gap = contact.gap.min(0.0);
            }
        }
    }

    /// Moves overlapping bodies apart, by the least displacement in the norm of the masses that opens every gap: the
    /// contact problem without friction whose velocities are displacements and whose free velocities are gaps.
    fn separate(&mut self, control: &Control) -> Result<(), StepFailure> {
        let kept: Vec<(Vector3<f64>, Vector3<f64>)> = self.moving.iter().map(|m| (m.velocity, m.omega)).collect();
        for motion in &mut self.moving {
            (motion.velocity, motion.omega) = Default::default();
        }
        for contact in &mut self.contacts {
            *contact = contact.of_displacements();
        }
        self.group();
        self.part();
        let solved = self.solve_each(|island, mechanism, law| island.displace(mechanism, law, control));
        for (motion, (velocity, omega)) in self.moving.iter_mut().zip(kept) {
            let (by, rotation) = (motion.velocity, motion.omega);
            (motion.velocity, motion.omega) = (velocity, omega);
            motion.displace(&by, &rotation);
        }
        solved.map_err(|_| StepFailure::Joints)
    }
}

/// The size of the smaller of two bodies.
pub(super) fn smaller(scene: &MultibodySystem, a: usize, b: usize) -> f64 {
    let reach = |body: usize| scene.bodies[body].collider.reach();
    reach(a).min(reach(b))
}
