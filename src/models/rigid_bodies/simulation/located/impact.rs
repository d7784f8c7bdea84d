//! Impacts as a sequence, by which two runs can tell whether they take the same ones.

use super::super::super::contact::Contact;
use super::super::super::motion::Motion;
use super::super::MoreauStepping;
use super::Key;
use nalgebra::Vector3;
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
    motion: Motion,
}

impl Impact {
    /// Whether it is the same as one of another run: the velocities differ by less after the two than if one of them were left out.
    pub fn is_like(&self, other: &Self) -> bool {
        let apart = [0, 1].map(|k| self.change[k] - other.change[k]);
        self.energy_of(apart) < self.energy.min(other.energy)
    }

    /// The kinetic energy of the body with these velocities.
    pub fn energy_of(&self, velocities: [Vector3<f64>; 2]) -> f64 {
        let mut motion = self.motion;
        [motion.velocity, motion.omega] = velocities;
        motion.kinetic_energy()
    }
}

impl MoreauStepping<'_> {
    /// Records the impacts of steps from now on, if they are located.
    pub fn record_impacts(&mut self) {
        if let Some(located) = &mut self.located {
            located.impacts = Some(Vec::new());
        }
    }

    /// The impacts of the last step, if they are recorded.
    pub fn impacts(&self) -> &[Impact] {
        self.located.as_ref().and_then(|located| located.impacts.as_deref()).unwrap_or_default()
    }

    /// Records the impacts of the bodies that were struck where the contacts `striking` closed, with the motions `before`.
    pub(super) fn record_struck(&self, striking: &[Key], before: &[Motion], impacts: &mut Vec<Impact>) {
        let is_struck = |contact: &&Contact| contact.impulse.x > 0.0;
        let mut struck: Vec<u32> =
            self.contacts.iter().filter(is_struck).flat_map(|contact| contact.bodies).flatten().collect();
        struck.sort_unstable();
        struck.dedup();
        impacts.extend(struck.into_iter().map(|body| {
            let own = self.contacts.iter().map(|contact| (contact.key, contact.bodies));
            let own = own.filter(|(key, bodies)| bodies.contains(&Some(body)) && striking.contains(key));
            let contacts = own.fold(0_u64, |sum, (key, _)| sum.wrapping_add(number_of(key)));
            let body = body as usize;
            let (motion, before) = (self.moving[body], &before[body]);
            let change = [motion.velocity - before.velocity, motion.omega - before.omega];
            let mut impact = Impact { t: self.t, body, contacts, change, energy: 0.0, motion };
            impact.energy = impact.energy_of(change);
            impact
        }));
    }
}

/// A number for the identity of a contact.
fn number_of(key: Key) -> u64 {
    let mut hasher = FxHasher::default();
    key.hash(&mut hasher);
    hasher.finish()
}
