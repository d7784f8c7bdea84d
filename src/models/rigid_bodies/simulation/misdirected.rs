//! Estimates of two errors of impacts in time stepping. A step uses the normals and lever arms of contacts at its
//! beginning, although those of curved or rotating bodies have changed when the surfaces meet. And it applies several
//! successive impacts at once.

use super::super::collision::contacts;
use super::super::contact::{Contact, frame};
use super::super::motion::Motion;
use super::MoreauStepping;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

impl MoreauStepping<'_> {
    /// Returns, for each moving body, the changes of its velocity and angular velocity after the impacts of the last
    /// step, of length `h` from the states `starts` on, if each impact happened where the surfaces meet. They are
    /// zero for bodies with joints, for steps divided into parts, and for impacts located in time, which happen where
    /// surfaces meet.
    pub fn misdirected(&self, starts: &[Motion], h: f64) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let mut by = vec![(Vector3::zeros(), Vector3::zeros()); self.moving.len()];
        let Some((starts, h)) = self.time_stepped(starts, h).filter(|_| self.report.parts <= 1) else { return by };
        let is_free = |contact: &&Contact| contact.bodies.iter().flatten().all(|&body| !self.jointed[body as usize]);
        for contact in self.contacts.iter().filter(|contact| contact.strikes()).filter(is_free) {
            let until = contact.closes_after();
            if until >= h {
                continue;
            }
            let Some(there) = self.met(contact, starts, until, h) else { continue };
            // The impulse at the place where the surfaces meet is estimated from that of the step, rotated with the
            // contact normal and scaled with the approach velocity; the applied forces are unchanged.
            let Some(turn) = UnitQuaternion::rotation_between(&normal(contact), &normal(&there)) else { continue };
            let here = contact.velocity(|body| (starts[body as usize].velocity, starts[body as usize].omega)).x;
            let larger = if here < 0.0 { (there.before.x / here).max(0.0) } else { 1.0 };
            for (side, body) in contact.bodies.iter().enumerate() {
                let Some(body) = *body else { continue };
                let (impulse, angular) = contact.wrench(side, &contact.impulse);
                let turned = turn * impulse * larger;
                let motion = &starts[body as usize];
                let (velocity, omega) = &mut by[body as usize];
                *velocity += (turned - impulse) / motion.mass;
                *omega += motion.mobility * (there.arms[side].cross(&turned) - angular);
            }
        }
        // Remove the velocity changes along the normals of bodies that stay in contact, which the following steps
        // correct.
        let stays =
            |contact: &&Contact| contact.impulse.x > 0.0 && contact.stays_closed() && contact.law.restitution == 0.0;
        self.hold_back(self.contacts.iter().filter(stays).map(|contact| (contact, 0, 0.0)), &mut by);
        by
    }

    /// Returns, for each moving body, the changes of its velocity and angular velocity if no restitution had been
    /// reduced in the last step, of length `h` from the states `starts` on. A body between two others that approach
    /// it collides with them alternately, and many times within a step; a step applies all impacts at once, with at
    /// most as much restitution as adds no energy.
    pub fn restituted(&self, starts: &[Motion], h: f64) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let mut by = vec![(Vector3::zeros(), Vector3::zeros()); self.moving.len()];
        let Some((_, h)) = self.time_stepped(starts, h).filter(|_| self.report.is_limited) else { return by };
        let fall = h * self.scene.gravity;
        let mut unit = by.clone();
        for contact in self.contacts.iter().filter(|contact| contact.impulse.x > 0.0 && contact.lacks > 0.0) {
            // Deduct the approach velocity that gravity causes in a step, which contacts at rest have as well.
            let approach = -contact.before.x - fall.dot(&normal(contact)).abs();
            let lacks = contact.lacks.min(contact.law.restitution * approach);
            if lacks <= 0.0 {
                continue;
            }
            self.impel(contact, 0, 1.0, &mut unit);
            let mobility = contact.change(|body| unit[body as usize]).x;
            contact.bodies.iter().flatten().for_each(|&body| unit[body as usize] = Default::default());
            self.impel(contact, 0, lacks / mobility, &mut by);
        }
        by
    }

    /// Returns a contact with its frame and its approach velocity after a time `until` of free motion; `None` if the
    /// surfaces have no contact point of its identity at that time.
    fn met(&self, contact: &Contact, starts: &[Motion], until: f64, h: f64) -> Option<Contact> {
        let drifted = |body: u32| {
            let mut motion = starts[body as usize];
            motion.drift(until);
            motion
        };
        let moved: Vec<Motion> = contact.bodies.iter().flatten().map(|&body| drifted(body)).collect();
        let pair = [contact.key.0, contact.key.1];
        let places = [contact.bodies[0].map(|_| 0), contact.bodies[1].map(|_| moved.len() as u32 - 1)];
        let pose = |side: usize| {
            let body = pair[side] as usize;
            match (places[side], self.given[body].map(|place| &self.prescribed[place as usize])) {
                (Some(place), _) => moved[place as usize].pose,
                // For a body with prescribed motion, the stored pose is that at the end of the step.
                (None, Some(given)) => {
                    let back = until - h;
                    let turned = UnitQuaternion::from_scaled_axis(given.omega * back) * given.pose.rotation;
                    Isometry3::from_parts((given.pose.translation.vector + given.velocity * back).into(), turned)
                }
                (None, None) => self.scene.bodies[body].pose,
            }
        };
        let poses = [pose(0), pose(1)];
        let mut points = Vec::new();
        let collider = |side: usize| &self.scene.bodies[pair[side] as usize].collider;
        contacts((collider(0), &poses[0]), (collider(1), &poses[1]), contact.gap, &mut points);
        let point = points.iter().find(|point| point.id == contact.key.2)?;
        let there = Contact::new(point, frame(&point.normal), places, &moved, contact.law, (pair[0], pair[1]));
        let given = |side: usize| {
            self.given[pair[side] as usize]
                .map_or_else(Vector3::zeros, |place| self.prescribed[place as usize].velocity_at(&point.position))
        };
        Some(there.carried([given(0), given(1)]))
    }
}

fn normal(contact: &Contact) -> Vector3<f64> {
    contact.frame.row(0).transpose()
}
