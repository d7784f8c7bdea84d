//! The end of a step: what happened in it, whom contacts hold there, and the velocities that the bodies have.

use super::super::constraints::poses;
use super::super::contact::Contact;
use super::super::motion::Motion;
use super::super::touches::Touched;
use super::Simulation;
use super::overlaps::no_gap;
use nalgebra::Vector3;

impl Simulation<'_> {
    /// Notes what happened between bodies, while the impulses of the step before are at hand.
    pub(super) fn follow(&mut self, h: f64) {
        let (mut touches, mut happenings) = (std::mem::take(&mut self.touches), std::mem::take(&mut self.happenings));
        let touched = |contact| Touched {
            contact,
            was_struck: self.kept.contains_key(&contact.key),
            is_closed: self.stays_closed(contact, h),
        };
        happenings.clear();
        let fall = h * self.scene.gravity.norm();
        touches.follow(self.contacts.iter().map(touched), &self.moving, fall, &mut happenings);
        (self.touches, self.happenings) = (touches, happenings);
    }

    /// Notes whom such contacts hold: the bodies that they touch at the end of a step `h`.
    pub(super) fn hold(&mut self, h: f64, such: impl Fn(&Contact) -> bool) {
        let mut held = std::mem::take(&mut self.held);
        held.fill(false);
        let closed = |contact: &&Contact| such(contact) && self.stays_closed(contact, h);
        for body in self.contacts.iter().filter(closed).flat_map(|contact| contact.bodies).flatten() {
            held[body as usize] = true;
        }
        self.held = held;
    }

    /// Finds the velocities at the end of the step. What hangs on a body that is held is taken to be held.
    pub(super) fn arrive(&mut self) {
        let half = self.scene.gravity * (0.5 * self.last);
        let end = |(motion, held): (&Motion, &bool)| if *held { *motion } else { motion.kicked(&half) };
        self.ends.clear();
        self.ends.extend(self.moving.iter().zip(&self.held).map(end));
        let (scene, places, held, ends) = (self.scene, &self.places, &self.held, &mut self.ends);
        for island in self.tasks[..self.islands.len()].iter_mut().filter(|island| !island.joints.is_empty()) {
            let is_held = island.bodies.iter().any(|&body| held[body as usize]);
            let is_pushed = island.bodies.iter().any(|&body| self.pushed[body as usize]);
            island.bodies.iter().for_each(|&body| self.pushed[body as usize] = is_pushed);
            let of = |body: &u32| if is_held { self.moving[*body as usize] } else { ends[*body as usize] };
            island.moving.clear();
            island.moving.extend(island.bodies.iter().map(of));
            if !is_held {
                island.obey_joints(&scene.joints, places);
            }
            for (&body, motion) in island.bodies.iter().zip(&island.moving) {
                ends[body as usize] = *motion;
            }
        }
    }

    /// Measures how far joints are off at the end of the step: positions as a part of the size of their bodies, directions
    /// in radians.
    pub(super) fn measure_joints(&mut self) {
        let (scene, mut rows) = (self.scene, Vec::new());
        for (place, joint) in scene.joints.iter().enumerate() {
            let places = joint.places(&|body| self.places[body]);
            rows.clear();
            joint.rows(poses(places, &self.moving), &mut rows);
            let size = joint.size(&scene.bodies);
            for row in &rows {
                let unit = if row.force == Vector3::zeros() { 1.0 } else { size };
                let drift = row.value.abs() / unit;
                // What is not a number is off by more than anything.
                if drift > self.report.drift || drift.is_nan() {
                    let drift = if drift.is_nan() { f64::INFINITY } else { drift };
                    (self.report.drift, self.report.drifted) = (drift, place);
                }
            }
        }
    }

    /// Whether the bodies still touch at the end of a step `h` with the velocities as they stand.
    fn stays_closed(&self, contact: &Contact, h: f64) -> bool {
        let of = |body: u32| (self.moving[body as usize].velocity, self.moving[body as usize].omega);
        contact.gap + h * contact.velocity(of).x <= no_gap(self.scene, contact)
    }
}
