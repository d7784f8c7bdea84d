//! `P A = L U` for a dense `A`, with partial pivoting, in blocks (Golub and Van Loan 2013, section 3.4).

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::{factor, solve};
use faer::perm::PermRef;
use faer::traits::ComplexField;
use faer::traits::math_utils::{is_finite, zero};
use faer::{Mat, Par};

/// LU factors of an `n x n` matrix.
pub struct DenseLu<T> {
    /// The matrix, and after [`DenseLu::factorise`] its factors.
    matrix: Mat<T>,
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
            matrix: Mat::from_fn(n, n, |_, _| zero()),
            permutation: (0..n).collect(),
            inverse: (0..n).collect(),
            memory: MemBuffer::new(factor.or(solve)),
        }
    }

    /// Factorises the matrix whose columns, stored one after the other, are `columns`.
    pub fn factorise(&mut self, columns: impl Iterator<Item = T>) {
        let n = self.matrix.nrows();
        for (place, value) in columns.enumerate().take(n * n) {
            self.matrix[(place % n, place / n)] = value;
        }
        let stack = MemStack::new(&mut self.memory);
        let (permutation, inverse) = (&mut self.permutation, &mut self.inverse);
        factor::lu_in_place(self.matrix.as_mut(), permutation, inverse, Par::Seq, stack, Default::default());
    }

    /// Solves in place; false if the solution is not finite: the matrix is singular.
    pub fn solve(&mut self, right: &mut [T]) -> bool {
        let n = right.len();
        let stack = MemStack::new(&mut self.memory);
        let permutation = PermRef::new_checked(&self.permutation, &self.inverse, n);
        let columns = faer::MatMut::from_column_major_slice_mut(&mut *right, n, 1);
        let factors = self.matrix.as_ref();
        solve::solve_in_place(factors, factors, permutation, columns, Par::Seq, stack);
        right.iter().all(is_finite)
    }
}
