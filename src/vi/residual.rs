//! The relative residual of a point for an affine variational inequality over any set.
//!
//! Components in intervals are judged by the natural map itself. A block combines the units of `z` and `w`, so the
//! natural map is taken with `s w` in place of `w`, where `s = |z| / (|q| + |A| |z|)`, and measured relative to `|z|`:
//!
//! ```text
//! |z - P(z - s w)| <= tolerance |z|
//! ```
//!
//! means that a change of `z` and one of `w`, each within the tolerance of its own size, make `z` a solution.

use super::{Accuracy, AffineVi};
use problem::Workspace;

/// A point below this fraction of the size that the data imply counts as zero.
const NOTHING: f64 = 1e-13;

/// Evaluator of residuals, with its workspace.
#[derive(Debug, Default)]
pub(super) struct Gauge {
    /// `w` at the last point.
    pub w: Vec<f64>,
    terms: Vec<f64>,
    work: Workspace,
}

impl Gauge {
    /// Evaluates the residuals of `z`.
    pub fn measure(&mut self, vi: &AffineVi<'_>, z: &[f64]) -> Accuracy {
        let Self { w, terms, work } = self;
        w.resize(z.len(), 0.0);
        terms.resize(z.len(), 0.0);
        let mut accuracy = vi.measure(z, w, terms);
        for (b, block) in vi.set.blocks().iter().enumerate() {
            let largest = |x: &dyn Fn(usize) -> f64| block.members.iter().fold(0.0_f64, |most, &i| most.max(x(i)));
            let terms = largest(&|i| terms[i]).max(f64::MIN_POSITIVE);
            let matrix = largest(&|i| largest(&|j| vi.matrix[(i, j)].abs()));
            let implied = if matrix > 0.0 { NOTHING * terms / matrix } else { 0.0 };
            let size = largest(&|i| z[i].abs()).max(implied);
            let size = if size > 0.0 { size } else { 1.0 };
            let relative = vi.set.defect(b, z, w, size / terms, work) / size;
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
