//! Memory estimate of the contact law for one island, available before assembly. The Delassus operator `W` has a
//! block for every pair of contacts on one body, so that its size grows with the square of the number of contacts of
//! that body; the size of its factors grows with the number of contacts.

use super::{Cone, MOST_FACTORISED, is_factored};
use nalgebra::{Matrix3, Vector3};
use vi::coulomb::Grip;

/// The size of the contact problem of one island.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Size {
    /// The number of contacts; a contact patch counts twice, by its force and its torque.
    pub contacts: usize,
    /// The number of 3 x 3 blocks of the Delassus operator `W`, if `W` is assembled.
    pub blocks: usize,
    /// Whether all contacts are point contacts coupled through bodies alone, so that a large island needs only the
    /// factors of `W`.
    pub has_factors: bool,
    /// The admissible set of friction impulses; `None` without friction.
    pub friction: Option<Cone>,
}

/// Bytes of a block of `W` with its column index; and the number of copies of `W`: as assembled, in the problem, in
/// the scaled problem, and in the layout of the Gauss-Seidel sweeps.
const BLOCK: usize = size_of::<Matrix3<f64>>() + size_of::<usize>();
const COPIES: usize = 4;
/// Bytes of a block of `W` during assembly, with its row and column index.
const ENTRY: usize = size_of::<(usize, usize, Matrix3<f64>)>();
/// Bytes of the factors of a contact, both as given and as scaled, with its diagonal block of `W`.
const FACTORS: usize = 2 * size_of::<(Grip, [u32; 2])>() + 2 * size_of::<Matrix3<f64>>();
/// Number of vectors of impulses and velocities: data, iterates, and the history of the Anderson acceleration of
/// sweeps.
const VECTORS: usize = 40;
/// Number of dense matrices of Newton's method and of ADMM, each with its factors (`DENSE`); and of complementary
/// pivoting (`PIVOTED`).
const DENSE: usize = 4;
const PIVOTED: usize = 2;

impl Size {
    /// Returns the bytes of memory needed to solve for the contact impulses of the island.
    pub fn bytes(&self) -> usize {
        let in_factors = self.has_factors && is_factored(self.contacts, self.friction);
        let operator = if in_factors {
            self.contacts.saturating_mul(FACTORS)
        } else {
            self.blocks.saturating_mul(COPIES * BLOCK + ENTRY)
        };
        let vectors = self.contacts.saturating_mul(VECTORS * size_of::<Vector3<f64>>());
        let dense = if in_factors { 0 } else { self.dense_numbers().saturating_mul(size_of::<f64>()) };
        operator.saturating_add(vectors).saturating_add(dense)
    }

    fn dense_numbers(&self) -> usize {
        let square = |n: usize| n.saturating_mul(n);
        match self.friction {
            // Unknowns of a contact in complementary pivoting: the normal impulse, one impulse for each corner, and the
            // slip.
            Some(Cone::Polyhedral(corners)) => PIVOTED * square(self.contacts.saturating_mul(corners + 2)),
            // A contact problem of a single contact is solved in closed form.
            _ if self.contacts < 2 => 0,
            _ => DENSE * square(3 * self.contacts.min(MOST_FACTORISED)),
        }
    }
}
