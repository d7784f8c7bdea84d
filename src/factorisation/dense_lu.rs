//! `P A = L U` for a dense `A`, with partial pivoting, in blocks (Golub and Van Loan 2013, section 3.4).

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::{factor, solve};
use faer::perm::PermRef;
use faer::traits::ComplexField;
use faer::traits::math_utils::{is_finite, zero};
use faer::{MatMut, MatRef, Par};

/// LU factors of an `n x n` matrix.
pub struct DenseLu<T> {
    /// The matrix column after column, and after [`DenseLu::factorise`] its factors.
    entries: Vec<T>,
    permutation: Vec<usize>,
    inverse: Vec<usize>,
    memory: MemBuffer,
}

impl<T: ComplexField> DenseLu<T> {
    /// Room for `n x n`.
    pub fn new(n: usize) -> Self {
        let factor = factor::lu_in_place_scratch::<usize, T>(n, n, Par::Seq, Default::default());
        let solve = solve::solve_in_place_scratch::<usize, T>(n, 1, Par::Seq);
        Self {
            entries: vec![zero(); n * n],
            permutation: (0..n).collect(),
            inverse: (0..n).collect(),
            memory: MemBuffer::new(factor.or(solve)),
        }
    }

    /// The entries, column after column, to be written before [`DenseLu::factorise`], which overwrites them.
    pub fn entries(&mut self) -> &mut [T] {
        &mut self.entries
    }

    /// Factorises the matrix whose entries were written.
    pub fn factorise(&mut self) {
        let n = self.permutation.len();
        let stack = MemStack::new(&mut self.memory);
        let matrix = MatMut::from_column_major_slice_mut(&mut self.entries, n, n);
        let (permutation, inverse) = (&mut self.permutation, &mut self.inverse);
        factor::lu_in_place(matrix, permutation, inverse, Par::Seq, stack, Default::default());
    }

    /// Solves in place; false if the solution is not finite: the matrix is singular.
    pub fn solve(&mut self, right: &mut [T]) -> bool {
        let n = right.len();
        let stack = MemStack::new(&mut self.memory);
        let permutation = PermRef::new_checked(&self.permutation, &self.inverse, n);
        let columns = MatMut::from_column_major_slice_mut(&mut *right, n, 1);
        let factors = MatRef::from_column_major_slice(&self.entries, n, n);
        solve::solve_in_place(factors, factors, permutation, columns, Par::Seq, stack);
        right.iter().all(is_finite)
    }
}
