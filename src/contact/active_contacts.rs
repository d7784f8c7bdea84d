//! Active contacts: the contacts of a mechanical system that are near enough to act within a step, in contact
//! coordinates.

use super::delassus::Delassus;
use super::law::{Cone, Contacts};
use nalgebra::Vector3;
use problem::{Constraints, MechanicalStructure};
use vi::coulomb::BlockMatrix;

/// Data of the active contacts for the contact law. Velocities, gaps and the step size are passed with each call.
pub struct ActiveContacts {
    contacts: Vec<usize>,
    /// The Delassus operator `W` of the active contacts.
    pub delassus: BlockMatrix,
    /// The coefficient of restitution of each active contact.
    pub restitution: Vec<f64>,
    mu: Vec<f64>,
    cone: Vec<Cone>,
    zeros: Vec<Vector3<f64>>,
    none: Vec<f64>,
}

impl ActiveContacts {
    /// Computes the Delassus operator `W` of the given contacts; returns `None` if `W` is not finite. The responses
    /// to the joints must be up to date ([`Delassus::hold_joints`]).
    pub fn new(
        structure: &MechanicalStructure,
        constraints: &Constraints,
        delassus: &mut Delassus,
        contacts: &[usize],
    ) -> Option<Self> {
        for &k in contacts {
            for row in rows(structure, k) {
                if !delassus.update_response(constraints, row) {
                    return None;
                }
            }
        }
        let data = || contacts.iter().map(|&k| &structure.contacts[k]);
        Some(Self {
            delassus: delassus.blocks(structure, constraints, contacts)?,
            restitution: data().map(|contact| contact.restitution).collect(),
            mu: data().map(|contact| contact.mu).collect(),
            cone: data()
                .map(|contact| match (contact.facets, contact.slips) {
                    (_, 0 | 1) => Cone::Polyhedral(2),
                    (Some(facets), _) => Cone::Polyhedral(facets),
                    (None, _) => Cone::Quadratic,
                })
                .collect(),
            zeros: vec![Vector3::zeros(); contacts.len()],
            none: vec![0.0; contacts.len()],
            contacts: contacts.to_vec(),
        })
    }

    /// Returns the coefficient of friction of each active contact.
    pub fn friction(&self) -> &[f64] {
        &self.mu
    }

    /// Sets the coefficient of friction of each active contact.
    pub fn set_friction(&mut self, mu: Vec<f64>) {
        self.mu = mu;
    }

    /// Returns the input of the contact law, with the contact velocities that the step ends with if no contact
    /// impulse acts (`free`) and those at its beginning (`before`).
    pub fn contacts<'a>(
        &'a self,
        free: &'a [Vector3<f64>],
        before: &'a [Vector3<f64>],
        gap: &'a [f64],
        restitution: &'a [f64],
        h: f64,
    ) -> Contacts<'a> {
        let Self { delassus, mu, cone, .. } = self;
        let delassus = crate::law::Delassus::Blocks(delassus);
        Contacts { delassus, free, before, gap, mu, restitution, cone, roles: &[], h }
    }

    /// Returns the input of the contact law for the contact velocities `free` without impulses, with friction,
    /// restitution and gaps set to zero.
    pub fn without_friction<'a>(&'a self, free: &'a [Vector3<f64>]) -> Contacts<'a> {
        let Self { delassus, cone, zeros, none, .. } = self;
        let delassus = crate::law::Delassus::Blocks(delassus);
        Contacts { delassus, free, before: zeros, gap: none, mu: none, restitution: none, cone, roles: &[], h: 1.0 }
    }

    /// Returns the relative velocity `u` of each active contact for generalised velocities `v`.
    pub fn velocities(
        &self,
        structure: &MechanicalStructure,
        constraints: &Constraints,
        v: &[f64],
    ) -> Vec<Vector3<f64>> {
        let velocity = |&k: &usize| {
            let mut u = Vector3::zeros();
            for (u, row) in u.iter_mut().zip(rows(structure, k)) {
                *u = constraints.velocity(row, v);
            }
            u
        };
        self.contacts.iter().map(velocity).collect()
    }

    /// Returns the velocity scale of contact `i`, `|du_free| + tr(W_ii) |r_i|`, where `du_free` is the change of its
    /// velocity by forces alone and `r_i` its impulse.
    pub fn change(&self, i: usize, by_forces: &Vector3<f64>, r: &Vector3<f64>) -> f64 {
        by_forces.norm() + self.delassus.diagonal(i).trace() * r.norm()
    }

    /// Finds a contact with the Painleve paradox: its friction at velocities `u` drives it into the surface it slides
    /// on, `W_nn - mu W_nt u_t / |u_t| < 0` (Painleve 1895; Stewart 2000, section 1.4). Contacts whose slip is below
    /// `rounding` are skipped.
    pub fn painleve(&self, u: &[Vector3<f64>], rounding: &[f64]) -> Option<usize> {
        (0..u.len()).find(|&i| {
            let (w, slip) = (self.delassus.diagonal(i), u[i].y.hypot(u[i].z));
            slip > rounding[i] && w[(0, 0)] - self.mu[i] * (w[(0, 1)] * u[i].y + w[(0, 2)] * u[i].z) / slip < 0.0
        })
    }

    /// Adds the response to the contact impulses `r` to the velocities: `v += Y r`, with the columns `Y = H J^T` of
    /// [`Delassus`].
    pub fn apply(&self, structure: &MechanicalStructure, delassus: &Delassus, r: &[Vector3<f64>], v: &mut [f64]) {
        for (&k, r) in self.contacts.iter().zip(r) {
            for (&r, row) in r.iter().zip(rows(structure, k)) {
                v.iter_mut().zip(delassus.response(row)).for_each(|(v, response)| *v += response * r);
            }
        }
    }
}

/// Returns the rows of the constraint Jacobian `J` that belong to contact `k`: the normal, then the slip directions.
pub(super) fn rows(structure: &MechanicalStructure, k: usize) -> impl Iterator<Item = usize> {
    std::iter::once(structure.normal(k)).chain(structure.tangents(k))
}
