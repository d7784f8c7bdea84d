//! Impacts as a sequence, by which two runs can tell whether they take the same ones.

use super::super::super::contact::Contact;
use super::super::MoreauStepping;
use super::{Key, Located};
use nalgebra::{Matrix3, Vector3};
use rustc_hash::FxHasher;
use std::hash::{Hash, Hasher};

/// What a body meets with when contacts strike.
#[derive(Clone, Debug)]
pub struct Impact {
    /// The time.
    pub t: f64,
    /// Its index among the moving bodies.
    pub body: usize,
    /// The contacts of the body that strike, as one number whatever their order; zero if it is struck through those that last alone.
    pub contacts: u64,
    /// The changes of its velocity and its angular velocity.
    pub change: [Vector3<f64>; 2],
    /// The kinetic energy of a body at rest whose velocities change so.
    pub energy: f64,
    /// The mass and the inertia in world axes.
    inertia: (f64, Matrix3<f64>),
}

impl Impact {
    /// Whether it is the same as one of another run: the velocities differ by less after the two than if one of them were left out.
    pub fn is_like(&self, other: &Self) -> bool {
        let [velocity, omega] = [0, 1].map(|k| self.change[k] - other.change[k]);
        self.energy_of([velocity, omega]) < self.energy.min(other.energy)
    }

    /// The kinetic energy of the body with the velocities `change`.
    pub fn energy_of(&self, [velocity, omega]: [Vector3<f64>; 2]) -> f64 {
        let (mass, inertia) = &self.inertia;
        0.5 * (mass * velocity.norm_squared() + omega.dot(&(inertia * omega)))
    }
}

impl MoreauStepping<'_> {
    /// The impacts of the last step, if they are located.
    pub fn impacts(&self) -> &[Impact] {
        self.located.as_ref().map_or(&[], |located| &located.impacts)
    }

    /// The bodies that are about to be struck where the contacts `striking` close, with their velocities so far as changes yet to come.
    pub(super) fn about_to_meet(&self, striking: &[Key]) -> Vec<Impact> {
        let mut met: Vec<Impact> = Vec::new();
        for contact in &self.contacts {
            let by = if striking.contains(&contact.key) { of_key(contact.key) } else { 0 };
            for body in contact.bodies.into_iter().flatten().map(|body| body as usize) {
                match met.iter_mut().find(|impact| impact.body == body) {
                    Some(impact) => impact.contacts = impact.contacts.wrapping_add(by),
                    None => {
                        let motion = &self.moving[body];
                        let change = [motion.velocity, motion.omega];
                        let rotation = motion.pose.rotation.to_rotation_matrix().into_inner();
                        let inertia = (motion.mass, rotation * motion.inertia * rotation.transpose());
                        met.push(Impact { t: self.t, body, contacts: by, change, energy: 0.0, inertia });
                    }
                }
            }
        }
        met
    }

    /// Keeps the impacts of bodies that were about to be struck.
    pub(super) fn keep_impacts(&self, located: &mut Located, met: Vec<Impact>) {
        let is_struck = |contact: &&Contact| contact.impulse.x > 0.0;
        let struck: Vec<u32> =
            self.contacts.iter().filter(is_struck).flat_map(|contact| contact.bodies).flatten().collect();
        for mut impact in met.into_iter().filter(|impact| struck.contains(&(impact.body as u32))) {
            let motion = &self.moving[impact.body];
            let [velocity, omega] = impact.change;
            impact.change = [motion.velocity - velocity, motion.omega - omega];
            impact.energy = impact.energy_of(impact.change);
            located.impacts.push(impact);
        }
    }
}

fn of_key(key: Key) -> u64 {
    let mut hasher = FxHasher::default();
    key.hash(&mut hasher);
    hasher.finish()
}
