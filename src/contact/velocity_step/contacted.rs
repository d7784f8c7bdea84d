//! Impulses, velocities and energy losses of the contacts in one step.

use crate::energy::Energy;
use nalgebra::Vector3;
use problem::Energies;

/// Impulses, velocities and losses of the contacts of a system in one step; zero for inactive contacts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contacted {
    /// Impulse of each contact of the system; zero for open contacts.
    pub r: Vec<Vector3<f64>>,
    /// The velocity `u-` of each active contact at the beginning of the step.
    pub before: Vec<Vector3<f64>>,
    /// The velocity `u+` of each active contact at the end of the step.
    pub after: Vec<Vector3<f64>>,
    /// The velocity scale of each active contact: the size of the changes of `u` by forces and by its own impulse.
    pub change: Vec<f64>,
    /// Energy dissipated by friction in the step.
    pub friction: f64,
    /// Energy lost in the impacts of the step.
    pub impacts: f64,
    /// Energy lost in impacts if every contact with an impulse has restitution 1, in which case none should be lost;
    /// zero otherwise.
    pub beyond_restitution: f64,
    /// Work of the drives of surfaces and joints in the step.
    pub drives: f64,
    /// The kinetic energy that the step would end with if no contact acted.
    pub kinetic: f64,
}

impl Contacted {
    /// Returns the results of a step for `m` inactive contacts.
    pub fn none(m: usize) -> Self {
        let zero = vec![Vector3::zeros(); m];
        Self { r: zero.clone(), before: zero.clone(), after: zero, change: vec![0.0; m], ..Self::default() }
    }

    /// Adds a step of size `h` to the energy balance, given the energies before and after it.
    pub fn book(&self, h: f64, before: &Energies, after: &Energies, energy: &mut Energy) {
        energy.dissipate(self.friction, self.impacts, before.kinetic.max(after.kinetic).max(self.kinetic));
        energy.lost_beyond_restitution += self.beyond_restitution;
        energy.work(0.5 * h * (before.power + after.power), 0.5 * h * (before.drive + after.drive) + self.drives);
        energy.close(after.kinetic, after.potential);
    }

    /// Records contact `k` with its impulse, its velocities before and after the step, and the size of their change.
    pub(super) fn note(&mut self, k: usize, r: Vector3<f64>, u: (Vector3<f64>, Vector3<f64>), change: f64) {
        (self.r[k], (self.before[k], self.after[k]), self.change[k]) = (r, u, change);
        let mean = 0.5 * (u.0 + u.1);
        self.impacts -= r.x * mean.x;
        self.friction -= r.y * mean.y + r.z * mean.z;
    }
}
