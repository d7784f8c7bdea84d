//! Cyclic reduction of a tridiagonal system (Hockney 1965): the odd unknowns, which are not bounded by the coarse
//! problem, are eliminated,
//!
//! ```text
//! z_i = -(q_i + A_{i,i-1} z_{i-1} + A_{i,i+1} z_{i+1}) / A_ii,    i odd
//! ```
//!
//! which leaves a tridiagonal system in the even unknowns: their Schur complement, again an M-matrix for any
//! coefficients and spacing of the grid.

use super::tridiagonal::Tridiagonal;
use super::{Face, resting_place};
use problem::ConvexSet;

/// For each even row `2k`, the multiples of rows `2k - 1` (`left`) and `2k + 1` (`right`) that are added to it to
/// eliminate the odd unknowns.
pub(super) struct CyclicReduction {
    left: Vec<f64>,
    right: Vec<f64>,
}

impl CyclicReduction {
    /// Returns the cyclic reduction of a tridiagonal matrix, and the reduced matrix of the even unknowns.
    pub fn new(fine: &Tridiagonal) -> (Self, Tridiagonal) {
        let n = fine.diagonal.len();
        let coarse = n.div_ceil(2);
        let (mut left, mut right) = (vec![0.0; coarse], vec![0.0; coarse]);
        let (mut below, mut diagonal, mut above) = (vec![0.0; coarse], vec![0.0; coarse], vec![0.0; coarse]);
        for k in 0..coarse {
            let i = 2 * k;
            diagonal[k] = fine.diagonal[i];
            if i > 0 {
                left[k] = -fine.below[i] * fine.inverse_diagonal[i - 1];
                diagonal[k] += left[k] * fine.above[i - 1];
                below[k] = left[k] * fine.below[i - 1];
            }
            if i + 1 < n {
                right[k] = -fine.above[i] * fine.inverse_diagonal[i + 1];
                diagonal[k] += right[k] * fine.below[i + 1];
                above[k] = right[k] * fine.above[i + 1];
            }
        }
        (Self { left, right }, Tridiagonal::new(below, diagonal, above))
    }

    pub fn restrict(&self, fine: &[f64], coarse: &mut [f64]) {
        for (k, coarse) in coarse.iter_mut().enumerate() {
            let i = 2 * k;
            let left = if i > 0 { self.left[k] * fine[i - 1] } else { 0.0 };
            let right = if i + 1 < fine.len() { self.right[k] * fine[i + 1] } else { 0.0 };
            *coarse = fine[i] + left + right;
        }
    }

    /// Sets the activity of even nodes to that of the coarse nodes, and that of odd nodes by solving their own row
    /// with given neighbours.
    pub fn guess(
        &self,
        matrix: &Tridiagonal,
        q: &[f64],
        set: &ConvexSet,
        (z, coarse): (&[f64], &[Face]),
        face: &mut [Face],
    ) {
        for (i, face) in face.iter_mut().enumerate() {
            let k = i / 2;
            *face = if i % 2 == 0 {
                coarse[k]
            } else {
                let next = z.get(k + 1).map_or(0.0, |z| matrix.above[i] * z);
                let alone = -(q[i] + matrix.below[i] * z[k] + next) * matrix.inverse_diagonal[i];
                resting_place(alone, set.lower[i], set.upper[i])
            };
        }
    }
}
