//! The end of a time step: contact events, bodies in sustained contact, velocities, and drift of joints.

use super::super::contact::Contact;
use super::super::frame::Frame;
use super::super::joint::Joint;
use super::super::touches::Touched;
use super::MoreauStepping;
use nalgebra::Vector3;

/// Fraction of the initial error at which the iterative projection of motions onto contact constraints stops: a tenth
/// of the relative accuracy of an error estimate.
const CONFINED: f64 = 1e-2;

/// Maximum number of sweeps over the contacts in the iterative projection of motions onto contact constraints.
const MOST_SWEEPS: usize = 50;

impl MoreauStepping<'_> {
    /// Detects the contact events of the step (impact, stick, slip, lift-off); must be called before the impulses of
    /// the previous step are replaced.
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

    /// Predicts the gaps of all contacts at the end of a step of size `h` with the current velocities.
    pub(super) fn foresee(&mut self, h: f64) {
        let moving = &self.moving;
        let of = |body: u32| (moving[body as usize].velocity, moving[body as usize].omega);
        for contact in &mut self.contacts {
            contact.foresee(h, of);
        }
    }

    /// Marks the bodies in sustained contact: those with a contact that satisfies the predicate `such` and is closed
    /// at the end of the step.
    pub(super) fn hold(&mut self, such: impl Fn(&Contact) -> bool) {
        let mut held = std::mem::take(&mut self.held);
        held.fill(false);
        let closed = |contact: &&Contact| such(contact) && contact.stays_closed();
        for body in self.contacts.iter().filter(closed).flat_map(|contact| contact.bodies).flatten() {
            held[body as usize] = true;
        }
        self.held = held;
    }

    /// Returns, for each moving body, the largest error in time of the impacts on its island in the last step of
    /// length `h`. An impact happens when its gap closes; the step applies it at its beginning, or at its end if the
    /// island is implicit. If the step is divided into parts, the error may be as large as the step.
    pub fn misplaced(&self, h: f64) -> Vec<f64> {
        let mut misplaced = vec![h; self.moving.len()];
        if self.report.parts > 1 {
            return misplaced;
        }
        for island in &self.tasks[..self.islands.len()] {
            let by = |contact: &Contact| {
                // A gap that does not close at the velocities at the beginning of the step is closed by forces or
                // impacts within the step.
                let until = contact.closes_after().min(h);
                if island.is_implicit() { h - until } else { until }
            };
            let longest = island.contacts.iter().filter(|contact| contact.strikes()).map(by).fold(0.0, f64::max);
            island.bodies.iter().for_each(|&body| misplaced[body as usize] = longest);
        }
        misplaced
    }

    /// Projects displacements of the moving bodies in the last step of length `h` (translations and rotations) onto
    /// those that its closed contacts allow: at the end of the step the surfaces touch, whenever they met, except for
    /// the distance by which they have separated again. The projection uses impulses along the normals, contact by
    /// contact.
    pub fn confine(&self, h: f64, by: &mut [(Vector3<f64>, Vector3<f64>)]) {
        let closed = |contact: &&Contact| contact.impulse.x > 0.0 && contact.stays_closed();
        let way = |contact: &Contact| {
            h * contact.velocity(|body| (self.ends[body as usize].velocity, self.ends[body as usize].omega)).x.max(0.0)
        };
        self.hold_back(self.contacts.iter().filter(closed).map(|contact| (contact, 0, way(contact))), by);
    }

    /// Projects changes of the motions of the moving bodies so that each contact changes by the given amount along
    /// one of its axes (by index: the normal or a tangent). The projection uses impulses along the axes, contact by
    /// contact (Gauss-Seidel).
    pub(super) fn hold_back<'c>(
        &self,
        contacts: impl Iterator<Item = (&'c Contact, usize, f64)>,
        by: &mut [(Vector3<f64>, Vector3<f64>)],
    ) {
        let along = |contact: &Contact, axis: usize, by: &[(Vector3<f64>, Vector3<f64>)]| {
            contact.change(|body| by[body as usize])[axis]
        };
        let mut unit = vec![(Vector3::zeros(), Vector3::zeros()); by.len()];
        let mut held = Vec::new();
        for (contact, axis, way) in contacts {
            self.impel(contact, axis, 1.0, &mut unit);
            held.push((contact, axis, along(contact, axis, &unit), way));
            contact.bodies.iter().flatten().for_each(|&body| unit[body as usize] = Default::default());
        }
        let first =
            held.iter().map(|(contact, axis, _, way)| (along(contact, *axis, by) - way).abs()).fold(0.0, f64::max);
        for _ in 0..MOST_SWEEPS {
            let mut left = 0.0_f64;
            for &(contact, axis, mobility, way) in held.iter().filter(|(_, _, mobility, _)| *mobility > 0.0) {
                let beyond = along(contact, axis, by) - way;
                left = left.max(beyond.abs());
                self.impel(contact, axis, -beyond / mobility, by);
            }
            if left <= CONFINED * first {
                break;
            }
        }
    }

    /// Adds to `by` the changes of the motions of a contact's bodies that an impulse of size `amount` along one axis of
    /// the contact frame causes.
    pub(super) fn impel(&self, contact: &Contact, axis: usize, amount: f64, by: &mut [(Vector3<f64>, Vector3<f64>)]) {
        let mut unit = Vector3::zeros();
        unit[axis] = amount;
        for side in [0, 1] {
            let Some(body) = contact.bodies[side] else { continue };
            let (impulse, angular) = contact.wrench(side, &unit);
            let motion = &self.moving[body as usize];
            let (place, turn) = &mut by[body as usize];
            *place += impulse / motion.mass;
            *turn += motion.mobility * angular;
        }
    }

    /// Returns, for each moving body, which of the first `N` components of its velocity and angular velocity are
    /// fixed at the end of the step by contacts with bodies that are fixed or have prescribed motion.
    pub fn held<const N: usize>(&self) -> Vec<[bool; N]> {
        let mut held = vec![[false; N]; self.moving.len()];
        let lasts = |contact: &Contact| match &self.located {
            Some(located) if !self.is_passed() => located.lasts(contact),
            _ => contact.impulse.x > 0.0 && contact.stays_closed(),
        };
        let mut of_body: Vec<Vec<&Contact>> = vec![Vec::new(); self.moving.len()];
        for contact in self.contacts.iter().filter(|contact| lasts(contact) && !contact.turns) {
            if let [Some(body), None] | [None, Some(body)] = contact.bodies {
                of_body[body as usize].push(contact);
            }
        }
        let mut by = vec![(Vector3::zeros(), Vector3::zeros()); self.moving.len()];
        for (body, contacts) in of_body.iter().enumerate().filter(|(_, contacts)| !contacts.is_empty()) {
            for (k, held) in held[body].iter_mut().enumerate() {
                let mut unit = [Vector3::zeros(); 2];
                unit[k / 3][k % 3] = 1.0;
                by[body] = unit.into();
                self.hold_back(contacts.iter().map(|contact| (*contact, 0, 0.0)), &mut by);
                let left: [Vector3<f64>; 2] = std::mem::take(&mut by[body]).into();
                *held = left[k / 3][k % 3].abs() <= 2.0 * CONFINED;
            }
        }
        held
    }

    /// Computes the velocities of all bodies at the end of the step, and extends `pushed` to all bodies of an implicit
    /// island.
    pub(super) fn end_velocities(&mut self) {
        let gravity = self.scene.gravity;
        self.ends.clear();
        self.ends.extend(self.moving.iter().map(|motion| motion.kicked(&(gravity * motion.lag))));
        for island in self.tasks[..self.islands.len()].iter().filter(|island| island.is_implicit()) {
            let is_pushed = island.bodies.iter().any(|&body| self.pushed[body as usize]);
            island.bodies.iter().for_each(|&body| self.pushed[body as usize] = is_pushed);
        }
    }

    /// Returns the current frames of the two bodies of a joint.
    pub(super) fn frames_of(&self, joint: &Joint) -> [Frame; 2] {
        let second = joint.bodies.1.map_or(Frame::WORLD, |body| Frame::of(self.pose(body)));
        [Frame::of(self.pose(joint.bodies.0)), second]
    }

    /// Measures the constraint violation (drift) of joints at the end of the step: positions relative to the size of
    /// the joint's bodies, directions in radians.
    pub(super) fn measure_joints(&mut self) {
        let scene = self.scene;
        for (place, joint) in scene.joints.iter().enumerate() {
            let frames = self.frames_of(joint);
            let size = joint.size(&scene.bodies);
            for row in joint.rows([&frames[0], &frames[1]]) {
                let unit = if row.force == Vector3::zeros() { 1.0 } else { size };
                let drift = row.value.abs() / unit;
                // A joint's constraint violation that is NaN counts as infinite drift.
                if drift > self.report.drift || drift.is_nan() {
                    let drift = if drift.is_nan() { f64::INFINITY } else { drift };
                    (self.report.drift, self.report.drifted) = (drift, place);
                }
            }
        }
    }
}
