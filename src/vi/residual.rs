//! The relative residual of a point for a variational inequality over any set.
//!
//! Components in intervals are judged by the natural map itself. A block combines the units of `z` and `w`, so the
//! natural map of a block is taken with `s w` in place of `w`, where `s = |z| / (|q| + |A| |z|)` is the size of `z`
//! over that of the terms of `w`, and measured relative to `|z|`:
//!
//! ```text
//! |z - P(z - s w)| <= tolerance |z|
//! ```
//!
//! means that a change of `z` and one of `w`, each within the tolerance relative to its own size, make `z` a
//! solution.

use super::{Accuracy, AffineVi};
use problem::{ConvexSet, Workspace};

/// Relative zero tolerance of a point `z`: a point smaller than this fraction of the size that the data imply, `terms
/// / slope`, counts as zero.
const NOTHING: f64 = 1e-13;

/// Returns the relative residual of a point `z` with `w` in one block. `terms` bounds the terms of `w` in the block,
/// and `slope` the entries of the derivative of `w` by the members of the block.
pub(super) fn of_block(
    set: &ConvexSet,
    block: usize,
    (z, w): (&[f64], &[f64]),
    (terms, slope): (f64, f64),
    work: &mut Workspace,
) -> f64 {
    let terms = terms.max(f64::MIN_POSITIVE);
    let implied = if slope > 0.0 { NOTHING * terms / slope } else { 0.0 };
    let size = set.blocks()[block].members.iter().fold(implied, |most, &i| most.max(z[i].abs()));
    let size = if size > 0.0 { size } else { 1.0 };
    set.defect(block, z, w, size / terms, work) / size
}

/// Evaluator of the residuals of affine variational inequalities, with its workspace.
#[derive(Debug, Default)]
pub(super) struct Gauge {
    /// The value `w = A z + q` at the point that was evaluated last.
    pub w: Vec<f64>,
    terms: Vec<f64>,
    work: Workspace,
}

impl Gauge {
    /// Evaluates the residuals of the point `z`.
    pub fn measure(&mut self, vi: &AffineVi<'_>, z: &[f64]) -> Accuracy {
        let Self { w, terms, work } = self;
        w.resize(z.len(), 0.0);
        terms.resize(z.len(), 0.0);
        let mut accuracy = vi.measure(z, w, terms);
        for (b, block) in vi.set.blocks().iter().enumerate() {
            let largest = |x: &dyn Fn(usize) -> f64| block.members.iter().fold(0.0_f64, |most, &i| most.max(x(i)));
            let slope = largest(&|i| largest(&|j| vi.matrix[(i, j)].abs()));
            let relative = of_block(vi.set, b, (z, w), (largest(&|i| terms[i]), slope), work);
            let residual = vi.set.defect(b, z, w, 1.0, work);
            if relative.is_nan() || residual.is_nan() || accuracy.residual.is_nan() {
                return Accuracy::NOT_A_NUMBER;
            }
            accuracy.residual = accuracy.residual.max(residual);
            accuracy.blockwise = accuracy.blockwise.max(relative);
            accuracy.componentwise = accuracy.componentwise.max(relative);
        }
        accuracy
    }
}
