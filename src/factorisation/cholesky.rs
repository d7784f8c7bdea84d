//! Cholesky factors `P A P^T = L L^T` of a sparse symmetric positive definite `A`, ordered by approximate minimum
//! degree (Amestoy, Davis and Duff 1996).

use super::SparseMatrix;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::cholesky::{LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky};
use faer::{Conj, MatMut, Par, Side};

/// Largest number of nonzeros of a Cholesky factor: 2 GiB.
const MOST_VALUES: usize = 1 << 28;

/// A Cholesky factor for matrices of one sparsity pattern.
pub struct Cholesky {
    analysis: SymbolicCholesky<usize>,
    values: Vec<f64>,
    memory: MemBuffer,
    is_regular: bool,
}

impl Cholesky {
    /// Analyses the pattern of a symmetric matrix with both triangles stored; returns `None` if memory does not
    /// suffice.
    pub fn new(matrix: &SparseMatrix) -> Option<Self> {
        let pattern = matrix.symbolic();
        let analysis =
            factorize_symbolic_cholesky(pattern, Side::Lower, SymmetricOrdering::Amd, Default::default()).ok()?;
        if analysis.len_val() > MOST_VALUES {
            return None;
        }
        let factor = analysis.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let solve = analysis.solve_in_place_scratch::<f64>(1, Par::Seq);
        let memory = MemBuffer::try_new(factor.or(solve)).ok()?;
        Some(Self { values: vec![0.0; analysis.len_val()], analysis, memory, is_regular: false })
    }

    /// Factorises a matrix with the analysed pattern; returns false if it is not positive definite.
    pub fn factorise(&mut self, matrix: &SparseMatrix) -> bool {
        let stack = MemStack::new(&mut self.memory);
        self.is_regular = self
            .analysis
            .factorize_numeric_llt(
                &mut self.values,
                matrix.as_ref(),
                Side::Lower,
                Default::default(),
                Par::Seq,
                stack,
                Default::default(),
            )
            .is_ok();
        self.is_regular
    }

    /// Solves the linear system in place of its right-hand side `right`; returns false if there is no factor, or the
    /// solution is not finite.
    pub fn solve(&mut self, right: &mut [f64]) -> bool {
        if !self.is_regular {
            return false;
        }
        let n = right.len();
        let stack = MemStack::new(&mut self.memory);
        let columns = MatMut::from_column_major_slice_mut(right, n, 1);
        LltRef::new(&self.analysis, &self.values).solve_in_place_with_conj(Conj::No, columns, Par::Seq, stack);
        right.iter().all(|x| x.is_finite())
    }
}
