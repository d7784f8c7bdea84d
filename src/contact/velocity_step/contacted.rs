//! What contacts did in a step.

use crate::energy::Energy;
use nalgebra::Vector3;
use problem::Energies;

/// Impulses, velocities and losses of the contacts of a system in one step; zero for those that were not near.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contacted {
    /// Impulses, one for each contact of the system; zero where it is open.
    pub r: Vec<Vector3<f64>>,
    /// `u-` of each contact that was near.
    pub before: Vec<Vector3<f64>>,
    /// `u+`.
    pub after: Vec<Vector3<f64>>,
    /// The size of what forces and its own impulse add to `u`.
    pub change: Vec<f64>,
    /// Dissipated by friction.
    pub friction: f64,
    /// Lost in impacts.
    pub impacts: f64,
    /// Lost in impacts where every contact that carried an impulse gives all back.
    pub beyond_restitution: f64,
    /// Work of what drives surfaces and joints.
    pub drives: f64,
    /// The kinetic energy that there would be without contacts.
    pub kinetic: f64,
}

impl Contacted {
    /// No contact of `m` did anything.
    pub fn none(m: usize) -> Self {
        let zero = vec![Vector3::zeros(); m];
        Self { r: zero.clone(), before: zero.clone(), after: zero, change: vec![0.0; m], ..Self::default() }
    }

    /// Books a step of this size, with the energies before and after it.
    pub fn book(&self, h: f64, before: &Energies, after: &Energies, energy: &mut Energy) {
        energy.dissipate(self.friction, self.impacts, before.kinetic.max(after.kinetic).max(self.kinetic));
        energy.lost_beyond_restitution += self.beyond_restitution;
        energy.work(0.5 * h * (before.power + after.power), 0.5 * h * (before.drive + after.drive) + self.drives);
        energy.close(after.kinetic, after.potential);
    }

    /// Takes down contact `k` with its impulse, its velocities before and after, and the size of their change.
    pub(super) fn note(&mut self, k: usize, r: Vector3<f64>, u: (Vector3<f64>, Vector3<f64>), change: f64) {
        (self.r[k], (self.before[k], self.after[k]), self.change[k]) = (r, u, change);
        let mean = 0.5 * (u.0 + u.1);
        self.impacts -= r.x * mean.x;
        self.friction -= r.y * mean.y + r.z * mean.z;
    }
}
