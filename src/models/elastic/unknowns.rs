//! Where the displacements of a body stand among the unknowns of its equations. The states are `u_I`, then `u_I'`, then
//! with viscosity or friction `u_N`, then the limits of friction; the variables are `u_N`, or with viscosity or friction
//! the forces of contact, then those of friction.

use super::Continuum;

/// Where the value of a displacement is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DisplacementIndex {
    /// Nowhere: it does not change.
    Clamped(f64),
    /// At this place in `(x, z)`, with its velocity at the second.
    Inner(usize, usize),
    /// At this place in `(x, z)`, in contact or near it, without mass; the second counts such displacements.
    Contact(usize, usize),
}

impl DisplacementIndex {
    /// The place in `(x, z)`, if it has one.
    pub fn unknown(self) -> Option<usize> {
        match self {
            Self::Clamped(_) => None,
            Self::Inner(place, _) | Self::Contact(place, _) => Some(place),
        }
    }

    /// The value in `y = (x, z)`.
    pub fn value(self, y: &[f64]) -> f64 {
        match self {
            Self::Clamped(value) => value,
            Self::Inner(place, _) | Self::Contact(place, _) => y[place],
        }
    }
}

/// The numbering of a body's displacements.
#[derive(Clone, Debug)]
pub struct Unknowns {
    /// One place for each displacement.
    pub places: Vec<DisplacementIndex>,
    /// The number of `u_I`.
    pub inner: usize,
    /// The number of `u_N`.
    pub contact: usize,
    /// The number of contacts with friction.
    pub rough: usize,
    /// Whether `u_N` are states, and the forces on them variables: their law has rates, or friction needs the forces.
    pub has_forces: bool,
}

impl Unknowns {
    /// Numbers the displacements, which are these at the start.
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

    /// The number of states.
    pub fn states(&self) -> usize {
        2 * self.inner + if self.has_forces { self.contact } else { 0 } + self.rough
    }

    /// The place of the limit of friction of the contact that is the `k`th with friction.
    pub fn limit(&self, k: usize) -> usize {
        self.states() - self.rough + k
    }
}
