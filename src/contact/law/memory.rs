//! The memory that the law takes for the contacts of an island, known before anything of it is assembled. `W` has a block
//! for every two contacts on one body, so that it grows with the square of the contacts of that body.

use super::{Cone, MOST_FACTORISED};
use nalgebra::{Matrix3, Vector3};

/// What the contacts of one island come to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Size {
    /// How many there are.
    pub contacts: usize,
    /// Blocks of `W`, as they are assembled.
    pub blocks: usize,
    /// The set that friction is taken from, where there is friction.
    pub friction: Option<Cone>,
}

/// A block with its column. `W` is held where it was assembled, by the problem, by the problem in units of its own, and
/// as sweeps read it.
const BLOCK: usize = size_of::<Matrix3<f64>>() + size_of::<usize>();
const COPIES: usize = 4;
/// A block on its way into the matrix.
const ENTRY: usize = size_of::<(usize, usize, Matrix3<f64>)>();
/// Vectors of impulses and velocities: data, iterates, and those that sweeps are accelerated with.
const VECTORS: usize = 40;
/// Dense matrices of Newton's method and of ADMM, each with its factors, and those of complementary pivoting.
const DENSE: usize = 4;
const PIVOTED: usize = 2;

impl Size {
    /// The bytes that solving for the impulses takes.
    pub fn bytes(&self) -> usize {
        let blocks = self.blocks.saturating_mul(COPIES * BLOCK + ENTRY);
        let vectors = self.contacts.saturating_mul(VECTORS * size_of::<Vector3<f64>>());
        blocks.saturating_add(vectors).saturating_add(self.dense_numbers().saturating_mul(size_of::<f64>()))
    }

    fn dense_numbers(&self) -> usize {
        let square = |n: usize| n.saturating_mul(n);
        match self.friction {
            // The impulse along the normal, one to each corner, and the slip.
            Some(Cone::Polyhedral(corners)) => PIVOTED * square(self.contacts.saturating_mul(corners + 2)),
            // A single contact is solved in closed form.
            _ if self.contacts < 2 => 0,
            _ => DENSE * square(3 * self.contacts.min(MOST_FACTORISED)),
        }
    }
}
