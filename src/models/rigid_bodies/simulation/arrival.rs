//! The end of a step: events, bodies in sustained contact, velocities, and joint drift.

use super::super::contact::Contact;
use super::super::frame::Frame;
use super::super::joint::Joint;
use super::super::touches::Touched;
use super::MoreauStepping;
use nalgebra::Vector3;

impl MoreauStepping<'_> {
    /// Detects events of contacts; must be called before the impulses of the previous step are replaced.
    pub(super) fn follow(&mut self, h: f64) {
        let (mut touches, mut new_events) = (std::mem::take(&mut self.touches), std::mem::take(&mut self.new_events));
        let touched = |contact| Touched {
            contact,
            was_struck: self.kept.contains_key(&contact.key),
            is_closed: contact.stays_closed(),
        };
        let fall = h * self.scene.gravity.norm();
        touches.follow(
            self.contacts.iter().filter(|contact| !contact.is_torque()).map(touched),
            &self.moving,
            fall,
            &mut new_events,
        );
        (self.touches, self.new_events) = (touches, new_events);
    }

    /// Predicts the gaps at the end of a step `h` with the current velocities.
    pub(super) fn foresee(&mut self, h: f64) {
        let moving = &self.moving;
        let of = |body: u32| (moving[body as usize].velocity, moving[body as usize].omega);
        for contact in &mut self.contacts {
            contact.foresee(h, of);
        }
    }

    /// Marks the bodies in sustained contact: those of contacts that satisfy `such` and are closed at the end of the
    /// step.
    pub(super) fn hold(&mut self, such: impl Fn(&Contact) -> bool) {
        let mut held = std::mem::take(&mut self.held);
        held.fill(false);
        let closed = |contact: &&Contact| such(contact) && contact.stays_closed();
        for body in self.contacts.iter().filter(closed).flat_map(|contact| contact.bodies).flatten() {
            held[body as usize] = true;
        }
        self.held = held;
    }

    /// Computes the velocities at the end of the step, and extends `pushed` to all bodies of an implicit island.
    pub(super) fn end_velocities(&mut self) {
        let gravity = self.scene.gravity;
        self.ends.clear();
        self.ends.extend(self.moving.iter().map(|motion| motion.kicked(&(gravity * motion.lag))));
        for island in self.tasks[..self.islands.len()].iter().filter(|island| island.is_implicit()) {
            let is_pushed = island.bodies.iter().any(|&body| self.pushed[body as usize]);
            island.bodies.iter().for_each(|&body| self.pushed[body as usize] = is_pushed);
        }
    }

    /// The current frames of the bodies of a joint.
    pub(super) fn frames_of(&self, joint: &Joint) -> [Frame; 2] {
        let second = joint.bodies.1.map_or(Frame::WORLD, |body| Frame::of(self.pose(body)));
        [Frame::of(self.pose(joint.bodies.0)), second]
    }

    /// Measures the constraint violation (drift) of joints at the end of the step: positions relative to the size of
    /// their bodies, directions in radians.
    pub(super) fn measure_joints(&mut self) {
        let scene = self.scene;
        for (place, joint) in scene.joints.iter().enumerate() {
            let frames = self.frames_of(joint);
            let size = joint.size(&scene.bodies);
            for row in joint.rows([&frames[0], &frames[1]]) {
                let unit = if row.force == Vector3::zeros() { 1.0 } else { size };
                let drift = row.value.abs() / unit;
                // NaN counts as infinite drift.
                if drift > self.report.drift || drift.is_nan() {
                    let drift = if drift.is_nan() { f64::INFINITY } else { drift };
                    (self.report.drift, self.report.drifted) = (drift, place);
                }
            }
        }
    }
}
