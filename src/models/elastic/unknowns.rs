//! Numbering of the unknowns `(x, z)` of an elastic body. With the displacements `u_N` that may be in contact and all
//! others `u_I`, the states are `u_I`, `u_I'`, with viscosity or friction also `u_N`, and the friction bounds. The
//! variables are `u_N` or, with viscosity or friction, the contact forces and the friction forces.

use super::Continuum;

/// The position of a displacement component in the vector of unknowns `(x, z)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DisplacementIndex {
    /// A clamped displacement component, which is not an unknown, with its constant value.
    Clamped(f64),
    /// A displacement with mass: its index in `(x, z)`, and the index of its velocity in `(x, z)`.
    Inner(usize, usize),
    /// A displacement without mass that may be in contact: its index in `(x, z)`, and its number among the
    /// displacements that may be in contact.
    Contact(usize, usize),
}

impl DisplacementIndex {
    /// Returns the index of the displacement component in `(x, z)`; `None` if it is clamped.
    pub fn unknown(self) -> Option<usize> {
        match self {
            Self::Clamped(_) => None,
            Self::Inner(place, _) | Self::Contact(place, _) => Some(place),
        }
    }

    /// Returns the value of the displacement, given the unknowns `y = (x, z)`.
    pub fn value(self, y: &[f64]) -> f64 {
        match self {
            Self::Clamped(value) => value,
            Self::Inner(place, _) | Self::Contact(place, _) => y[place],
        }
    }
}

/// The numbering of the displacement components of an elastic body in the vector of unknowns `(x, z)`.
#[derive(Clone, Debug)]
pub struct Unknowns {
    /// The position of each displacement component in `(x, z)`.
    pub places: Vec<DisplacementIndex>,
    /// The number of displacement components `u_I` with mass.
    pub inner: usize,
    /// The number of displacement components `u_N` that may be in contact.
    pub contact: usize,
    /// The number of frictional contacts of the body.
    pub rough: usize,
    /// Whether the displacements `u_N` that may be in contact are states and contact forces are variables, as needed
    /// for viscosity or friction.
    pub has_forces: bool,
}

impl Unknowns {
    /// Numbers the displacement components of a body; `displacement` are their initial values.
    pub fn new(continuum: &Continuum, displacement: &[f64]) -> Self {
        let mut is_contact = vec![false; displacement.len()];
        continuum.contacts.iter().for_each(|contact| is_contact[contact.displacement] = true);
        let clamped = &continuum.clamped;
        let count = |of: &dyn Fn(usize) -> bool| (0..displacement.len()).filter(|&d| of(d)).count();
        let mut unknowns = Self {
            places: Vec::with_capacity(displacement.len()),
            inner: count(&|d| !clamped[d] && !is_contact[d]),
            contact: count(&|d| is_contact[d]),
            rough: continuum.contacts.iter().filter(|contact| contact.friction > 0.0).count(),
            has_forces: false,
        };
        unknowns.has_forces = continuum.relaxation > 0.0 || unknowns.rough > 0;
        let first = if unknowns.has_forces { 2 * unknowns.inner } else { unknowns.states() };
        let (mut next, mut contact) = (0, 0);
        for d in 0..displacement.len() {
            unknowns.places.push(if clamped[d] {
                DisplacementIndex::Clamped(displacement[d])
            } else if is_contact[d] {
                contact += 1;
                DisplacementIndex::Contact(first + contact - 1, contact - 1)
            } else {
                next += 1;
                DisplacementIndex::Inner(next - 1, unknowns.inner + next - 1)
            });
        }
        unknowns
    }

    /// Returns the number of states in the equations of the elastic body.
    pub fn states(&self) -> usize {
        2 * self.inner + if self.has_forces { self.contact } else { 0 } + self.rough
    }

    /// Returns the index of the friction bound of the `k`-th frictional contact in `(x, z)`.
    pub fn limit(&self, k: usize) -> usize {
        self.states() - self.rough + k
    }
}
