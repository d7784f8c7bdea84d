//! The sequence of impacts of an event-driven run, by which two runs are compared.

use super::super::super::contact::Contact;
use super::super::super::motion::Motion;
use super::super::MoreauStepping;
use super::Key;
use nalgebra::Vector3;
use rustc_hash::FxHasher;
use std::hash::{Hash, Hasher};

/// The effect of an impact on one of the bodies that it strikes.
#[derive(Clone, Debug)]
pub struct Impact {
    /// The time at which the impact occurs.
    pub t: f64,
    /// The index of the struck body among the moving bodies.
    pub body: usize,
    /// A hash of the closing contacts of the body, independent of their order; zero if the body is struck through
    /// sustained contacts alone.
    pub contacts: u64,
    /// The changes of the body's velocity and angular velocity by the impact.
    pub change: [Vector3<f64>; 2],
    /// The kinetic energy that the body would have with its velocity changes as velocities.
    pub energy: f64,
    motion: Motion,
}

impl Impact {
    /// Returns whether the impact corresponds to an impact of another run: whether their velocity changes differ by
    /// less, in the energy norm, than if one of the two impacts were left out.
    pub fn is_like(&self, other: &Self) -> bool {
        let apart = [0, 1].map(|k| self.change[k] - other.change[k]);
        self.energy_of(apart) < self.energy.min(other.energy)
    }

    /// Returns the kinetic energy of the struck body with the given velocities.
    pub fn energy_of(&self, velocities: [Vector3<f64>; 2]) -> f64 {
        let mut motion = self.motion;
        [motion.velocity, motion.omega] = velocities;
        motion.kinetic_energy()
    }
}

impl MoreauStepping<'_> {
    /// Starts to record the impacts of event-driven steps; has no effect for time stepping.
    pub fn record_impacts(&mut self) {
        if let Some(located) = &mut self.located {
            located.impacts = Some(Vec::new());
        }
    }

    /// Returns the impacts of the last step; empty if impacts are not recorded.
    pub fn impacts(&self) -> &[Impact] {
        self.located.as_ref().and_then(|located| located.impacts.as_deref()).unwrap_or_default()
    }

    /// Records the impacts of the bodies that were struck when the contacts `striking` closed; `before` are the
    /// motions of all bodies before the impact.
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

/// Returns a hash of the identity of a contact.
fn number_of(key: Key) -> u64 {
    let mut hasher = FxHasher::default();
    key.hash(&mut hasher);
    hasher.finish()
}
