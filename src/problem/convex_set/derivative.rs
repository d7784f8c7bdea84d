//! An element `V` of the B-subdifferential of the projection onto `K` (a generalised derivative): zero or one for an
//! interval, a symmetric matrix for a block.

use super::{ConvexSet, Workspace};

/// An element `V` of the B-subdifferential of the projection onto `K` at one point, stored by the factors of `K`.
#[derive(Clone, Debug, Default)]
pub struct Derivative {
    /// The diagonal entries of the generalised derivative `V` of the projection onto `K`, for components in intervals:
    /// one in the interior of the interval, zero otherwise.
    intervals: Vec<f64>,
    /// The diagonal blocks of the generalised derivative `V` of the projection onto `K`, for the blocks of `K`:
    /// concatenated matrices, each by columns.
    blocks: Vec<f64>,
}

impl Derivative {
    /// Projects `x` onto `set` in place, and computes the element `V` of the B-subdifferential of the projection at
    /// the original `x`. Allocates only in the first call for a set.
    pub fn linearise(&mut self, set: &ConvexSet, x: &mut [f64], work: &mut Workspace) {
        self.intervals.resize(x.len(), 0.0);
        for (i, (x, v)) in x.iter_mut().zip(&mut self.intervals).enumerate() {
            *v = f64::from(*x > set.lower[i] && *x < set.upper[i]);
            *x = set.project(i, *x);
        }
        self.blocks.resize(set.blocks.iter().map(|block| block.members.len().pow(2)).sum(), 0.0);
        let mut rest = self.blocks.as_mut_slice();
        for block in &set.blocks {
            let (matrix, later) = rest.split_at_mut(block.members.len().pow(2));
            rest = later;
            work.gather(block, x);
            let Workspace { x: from, p, block: inner } = work;
            block.shape.linearise(from, p, matrix, inner);
            block.scatter(p, x);
        }
    }

    /// Computes `out = V x` for a vector `x` and the stored element `V` of the B-subdifferential.
    pub fn apply(&self, set: &ConvexSet, x: &[f64], out: &mut [f64]) {
        for ((out, x), v) in out.iter_mut().zip(x).zip(&self.intervals) {
            *out = v * x;
        }
        let mut rest = self.blocks.as_slice();
        for block in &set.blocks {
            let k = block.members.len();
            let (matrix, later) = rest.split_at(k * k);
            rest = later;
            for (column, &i) in matrix.chunks_exact(k).zip(&block.members) {
                out[i] = column.iter().zip(&block.members).map(|(v, &j)| v * x[j]).sum();
            }
        }
    }
}
