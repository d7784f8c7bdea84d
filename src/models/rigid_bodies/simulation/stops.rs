//! The stops of joints, treated as frictionless contacts between the two bodies of a joint.

use super::super::collision::ContactPoint;
use super::super::contact::{Contact, STOPS, frame};
use super::super::drive::Coordinate;
use super::super::scene::Law;
use super::{MoreauStepping, overlaps};
use nalgebra::Vector3;

impl MoreauStepping<'_> {
    /// Adds the stops of all joints with finite limits to the contacts of the step.
    pub(super) fn add_stops(&mut self) {
        for (linkage, carried) in self.mechanism.linkages.iter().zip(&self.carried) {
            for (&place, state) in linkage.joints.iter().zip(&carried.states) {
                let joint = &self.scene.joints[place as usize];
                let Some(drive) = &joint.drive else { continue };
                let bodies = joint.places(&|body| self.places[body]);
                let of = self.frames_of(joint);
                let frames = [&of[0], &of[1]];
                let (arms, apart) = joint.arms(frames);
                let coordinate = drive.value(frames, &apart, state.coordinate);
                let (axis, turns, size) = match drive.coordinate {
                    Coordinate::Angle { second: [along, across], .. } => (of[1].axes * along.cross(&across), true, 1.0),
                    Coordinate::Distance(axis) => (of[1].axes * axis, false, joint.size(&self.scene.bodies)),
                    Coordinate::Length | Coordinate::Product { .. } => continue,
                };
                let law = Law { restitution: drive.limits.restitution, ..Law::default() };
                let pair = (joint.bodies.0 as u32, joint.bodies.1.unwrap_or(joint.bodies.0) as u32);
                let ends = [(coordinate - drive.limits.lower, axis), (drive.limits.upper - coordinate, -axis)];
                for (side, (gap, normal)) in ends.into_iter().enumerate().filter(|(_, (gap, _))| gap.is_finite()) {
                    let id = STOPS | u64::from(2 * place) | side as u64;
                    let point = ContactPoint { position: of[0].at + arms[0], normal, gap, id, feature: 0 };
                    let contact = Contact::new(&point, frame(&normal), [bodies[1], bodies[0]], &self.moving, law, pair);
                    let mut contact = Contact { turns, size, no_gap: overlaps::OVERLAP * size, ..contact };
                    contact.before = contact
                        .velocity(|body| (self.moving[body as usize].velocity, self.moving[body as usize].omega));
                    if let Some(ground) = joint.bodies.1.and_then(|body| self.given[body]) {
                        let ground = &self.prescribed[ground as usize];
                        let surface = if turns { ground.omega } else { ground.velocity_at(&point.position) };
                        contact = contact.carried([surface, Vector3::zeros()]);
                    }
                    self.contacts.push(contact);
                }
            }
        }
    }
}
