//! Scaled variational inequalities over intervals: with positive diagonal matrices `R` and `C`, the problem
//!
//! ```text
//! F'(z') = R F(C z'),    K' = C^-1 K
//! ```
//!
//! has the solutions `C^-1 z`. `R` brings the terms of each row to one; `C` is chosen such that a unit change of a
//! scaled variable changes some row by its terms and no row by more. A row of small terms, such as of costs beside a
//! row of vehicle numbers, is thus solved as accurately as the others. The entries of both are powers of two, so that
//! scaling is exact.

use super::SparseVi;
use super::sparse_jacobian::evaluated;
use super::worst::sizes_of_variables;
use problem::ConvexSet;

/// Rows, or columns, whose sizes differ by less than this factor are left unscaled, at the price of this factor in
/// the tolerance.
const BALANCED: f64 = 64.0;

/// The sizes of the terms of each row of `F` at a point, and the entries of the Jacobian at that point.
pub(super) struct Sizes {
    rows: Vec<f64>,
    derivatives: Vec<f64>,
}

impl Sizes {
    pub fn at(vi: &mut dyn SparseVi, z: &[f64]) -> Self {
        let (_, derivatives, terms) = evaluated(vi, z);
        Self { rows: terms.sizes, derivatives }
    }

    /// Whether no row of `F` has terms that are much smaller than its terms at another point.
    pub fn keep(&self, others: &Self) -> bool {
        self.rows.iter().zip(&others.rows).all(|(size, other)| *size >= other / BALANCED)
    }

    /// Returns the scales of rows and variables that bring all terms to one size; `None` if the terms are balanced
    /// already, or not finite.
    pub fn scales(&self, pattern: &[(usize, usize)]) -> Option<Scales> {
        let Self { rows: sizes, derivatives } = self;
        let columns = sizes_of_variables(sizes, pattern.iter().copied().zip(derivatives.iter().copied()));
        let is_known = |size: f64| size > 0.0 && size.is_finite();
        let spread = |sizes: &[f64]| {
            let known = sizes.iter().copied().filter(|size| is_known(*size));
            known.clone().fold(0.0, f64::max) / known.fold(f64::INFINITY, f64::min)
        };
        let is_uneven = spread(sizes) > BALANCED || spread(&columns) > BALANCED;
        let unit = |size: &f64| if is_known(*size) { size.log2().round().exp2() } else { 1.0 };
        let rows: Vec<f64> = sizes.iter().map(|size| unit(size).recip()).collect();
        let columns: Vec<f64> = columns.iter().map(unit).collect();
        let are_finite = rows.iter().chain(&columns).all(|scale| is_known(*scale));
        (is_uneven && are_finite).then_some(Scales { rows, columns })
    }
}

/// The diagonals of the scaling matrices `R` (rows) and `C` (columns).
#[derive(Clone, Debug)]
pub(super) struct Scales {
    rows: Vec<f64>,
    columns: Vec<f64>,
}

/// A variational inequality in scaled units.
pub(super) struct ScaledVi<'a> {
    vi: &'a mut dyn SparseVi,
    scales: Scales,
    set: ConvexSet,
    z: Vec<f64>,
}

impl<'a> ScaledVi<'a> {
    pub fn new(vi: &'a mut dyn SparseVi, scales: Scales) -> Self {
        let mut set = vi.set().clone();
        for (j, scale) in scales.columns.iter().enumerate() {
            set.lower[j] /= scale;
            set.upper[j] /= scale;
        }
        let z = vec![0.0; scales.columns.len()];
        Self { vi, scales, set, z }
    }

    /// Converts a point of the problem to scaled units.
    pub fn scale(&self, z: &mut [f64]) {
        z.iter_mut().zip(&self.scales.columns).for_each(|(z, scale)| *z /= scale);
    }

    /// Converts a point in scaled units back to the units of the problem.
    pub fn unscale(&self, z: &mut [f64]) {
        z.iter_mut().zip(&self.scales.columns).for_each(|(z, scale)| *z *= scale);
    }

    fn take(&mut self, z: &[f64]) {
        let products = z.iter().zip(&self.scales.columns).map(|(z, scale)| z * scale);
        self.z.iter_mut().zip(products).for_each(|(own, z)| *own = z);
    }
}

impl SparseVi for ScaledVi<'_> {
    fn set(&self) -> &ConvexSet {
        &self.set
    }

    fn pattern(&self) -> &[(usize, usize)] {
        self.vi.pattern()
    }

    fn is_affine(&self) -> bool {
        self.vi.is_affine()
    }

    fn evaluate(&mut self, z: &[f64], f: &mut [f64]) {
        self.take(z);
        self.vi.evaluate(&self.z, f);
        f.iter_mut().zip(&self.scales.rows).for_each(|(f, scale)| *f *= scale);
    }

    fn derivatives(&mut self, z: &[f64], values: &mut [f64]) {
        self.take(z);
        self.vi.derivatives(&self.z, values);
        let Scales { rows, columns } = &self.scales;
        values.iter_mut().zip(self.vi.pattern()).for_each(|(value, &(i, j))| *value *= rows[i] * columns[j]);
    }
}
