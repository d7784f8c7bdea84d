//! The active set method for a matrix in dense storage: its zeros are dropped, and the sparse analysis is reused as
//! long as the matrix stays the same.

use super::super::{AffineVi, Report, ViSolver};
use super::ActiveSet;
use factorisation::SparseMatrix;
use faer::sparse::Triplet;
use nalgebra::DMatrix;
use problem::Control;

/// [`ActiveSet`] for dense matrices, behind the interface [`ViSolver`]. Allocates when the matrix changes.
#[derive(Default)]
pub struct DenseActiveSet {
    matrix: DMatrix<f64>,
    /// The active set solver of the matrix; `None` if the method does not suit the matrix.
    solver: Option<ActiveSet>,
    w: Vec<f64>,
    terms: Vec<f64>,
}

impl DenseActiveSet {
    /// Creates a solver for problems of any size.
    pub fn new() -> Self {
        Self::default()
    }

    fn take(&mut self, matrix: &DMatrix<f64>) {
        if self.matrix == *matrix {
            return;
        }
        self.matrix.clone_from(matrix);
        let m = matrix.nrows();
        let entries: Vec<Triplet<usize, usize, f64>> = (0..m * m)
            .map(|place| Triplet::new(place % m, place / m, matrix[place]))
            .filter(|entry| entry.val != 0.0)
            .collect();
        let sparse = SparseMatrix::try_new_from_triplets(m, m, &entries).ok();
        self.solver = sparse.and_then(|sparse| ActiveSet::new(&sparse).ok());
    }
}

impl ViSolver for DenseActiveSet {
    fn name(&self) -> &'static str {
        "active_set"
    }

    fn solve(&mut self, vi: &AffineVi<'_>, z: &mut [f64], control: &Control) -> Report {
        if vi.set.has_blocks() {
            return Report::UNSUITABLE;
        }
        if !vi.is_sound() {
            return Report::BREAKDOWN;
        }
        self.take(vi.matrix);
        let Some(solver) = &mut self.solver else { return Report::UNSUITABLE };
        let report = solver.solve(vi.q, vi.set, z, control);
        self.w.resize(z.len(), 0.0);
        self.terms.resize(z.len(), 0.0);
        vi.measure(z, &mut self.w, &mut self.terms).report(report.outcome, report.iterations)
    }
}
