//! Displacements and velocities admitted by the joints of an island, without a time step.

use super::super::super::frame::Frame;
use super::super::super::linkage::Linked;
use super::super::super::midpoint::{apart, twist};
use super::super::{Island, Mechanism, Unsolved};
use super::compliance::{Compliance, respond};
use contact::law::{Delassus, Law};
use nalgebra::{Vector3, Vector6};
use problem::Control;

impl Island {
    /// Computes the displacements of the island's bodies that resolve overlaps and close the joints, with the smallest
    /// change in the mass norm; the displacements are stored as velocities over a unit of time.
    pub fn displace(&mut self, mechanism: &Mechanism<'_>, law: &mut Law, control: &Control) {
        if !self.is_implicit() {
            self.solve(1.0, mechanism, law, control);
            return;
        }
        let (mut linked, homes) = self.linked(mechanism);
        let Some(mut velocities) = self.obeying(&mut linked, mechanism, true) else { return };
        if !self.contacts.is_empty() {
            let Some(compliance) = Compliance::new(&self.contacts, &mut linked, &homes, control) else {
                return;
            };
            let matrix = compliance.symmetric;
            let none = vec![Vector3::zeros(); self.contacts.len()];
            let free = self.free_velocities(&velocities, &matrix, &none);
            let gaps: Vec<f64> = self.contacts.iter().map(|contact| contact.gap).collect();
            let impulses = self.impulses(Delassus::Blocks(&matrix), free, &gaps, false, 1.0, none, law, control);
            respond(&self.contacts, &mut linked, &homes, &impulses);
            linked.iter().for_each(|linked| linked.add(&mut velocities));
        }
        self.take(&velocities);
    }

    /// Projects the velocities of the island's bodies onto the joint constraints, by joint impulses alone.
    pub fn obey_joints(&mut self, mechanism: &Mechanism<'_>) {
        let (mut linked, _) = self.linked(mechanism);
        if let Some(velocities) = self.obeying(&mut linked, mechanism, false) {
            self.take(&velocities);
        }
    }

    fn take(&mut self, velocities: &[Vector6<f64>]) {
        for (motion, velocities) in self.moving.iter_mut().zip(velocities) {
            (motion.velocity, motion.omega) = apart(velocities);
        }
    }

    fn obeying(
        &mut self,
        linked: &mut [Linked<'_>],
        mechanism: &Mechanism<'_>,
        closes: bool,
    ) -> Option<Vec<Vector6<f64>>> {
        let course = mechanism.signals.over(self.t, 0.0);
        let frames: Vec<Frame> = self.moving.iter().map(|motion| Frame::of(&motion.pose)).collect();
        let mut velocities: Vec<Vector6<f64>> = self.moving.iter().map(twist).collect();
        for linked in linked {
            linked.begin(&frames, &course, |k| mechanism.grounding(k, self.t, 0.0));
            if !linked.hold(&frames, &self.moving) {
                self.unsolved = Some(Unsolved::Joints);
                return None;
            }
            linked.project(&frames, &mut velocities, closes);
        }
        Some(velocities)
    }
}
