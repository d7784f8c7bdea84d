//! LU factors `P A = L U` of a dense `A`, with partial pivoting: small matrices are eliminated in place, larger ones
//! in blocks by faer (Golub and Van Loan 2013, section 3.4).
//!
//! Solves are optimised for many right-hand sides in turn: division by complex pivots would take as long as all other
//! operations, and blocked kernels do not pay for a single right-hand side. The pivots are therefore inverted once, and
//! the substitutions are plain loops over columns.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::factor;
use faer::traits::math_utils::is_finite;
use faer::{MatMut, Par};
use nalgebra::Complex;
use std::fmt;

use super::elimination::eliminate;

/// A real or complex number type of matrix entries.
pub trait Number: nalgebra::ComplexField + faer::traits::ComplexField + From<f64> + Copy {
    /// Largest number of rows for the unblocked elimination, as measured against faer's blocked elimination; zero for
    /// complex numbers, whose small matrices are factorised by [`ComplexLu`](super::ComplexLu).
    const SMALL: usize;

    /// Factorises a matrix of at most `SMALL` rows in place; writes the row permutation and the reciprocals of the
    /// pivots.
    fn eliminate(entries: &mut [Self], permutation: &mut [usize], reciprocals: &mut [Self]);
}

impl Number for f64 {
    const SMALL: usize = 30;

    fn eliminate(entries: &mut [Self], permutation: &mut [usize], reciprocals: &mut [Self]) {
        eliminate(entries, permutation, reciprocals);
    }
}

impl Number for Complex<f64> {
    const SMALL: usize = 0;

    fn eliminate(_: &mut [Self], _: &mut [usize], _: &mut [Self]) {}
}

/// LU factors of a dense `n x n` matrix.
pub struct DenseLu<T> {
    /// The matrix in column-major order; after [`DenseLu::factorise`] its factors.
    entries: Vec<T>,
    /// The row permutation `P`: for each row of the factors, the index of the row of the matrix.
    permutation: Vec<usize>,
    /// The reciprocals of the pivots of the LU factors.
    reciprocals: Vec<T>,
    permuted: Vec<T>,
    blocks: Option<Blocks>,
}

/// Workspace of faer's blocked elimination.
struct Blocks {
    inverse: Vec<usize>,
    memory: MemBuffer,
}

impl<T> fmt::Debug for DenseLu<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DenseLu").field("n", &self.permutation.len()).finish_non_exhaustive()
    }
}

impl<T: Number> DenseLu<T> {
    /// Allocates the factors and the workspace for an `n x n` matrix.
    pub fn new(n: usize) -> Self {
        let blocks = (n > T::SMALL).then(|| Blocks {
            inverse: (0..n).collect(),
            memory: MemBuffer::new(factor::lu_in_place_scratch::<usize, T>(n, n, Par::Seq, Default::default())),
        });
        let zero = T::from(0.0);
        Self {
            entries: vec![zero; n * n],
            permutation: (0..n).collect(),
            reciprocals: vec![zero; n],
            permuted: vec![zero; n],
            blocks,
        }
    }

    /// Returns the number `n` of rows of the matrix.
    pub fn dimension(&self) -> usize {
        self.permutation.len()
    }

    /// Returns the entries of the matrix in column-major order, to be written before [`DenseLu::factorise`], which
    /// overwrites them.
    pub fn entries(&mut self) -> &mut [T] {
        &mut self.entries
    }

    /// Computes the LU factors of the matrix that was written to [`DenseLu::entries`].
    pub fn factorise(&mut self) {
        let n = self.permutation.len();
        match &mut self.blocks {
            Some(Blocks { inverse, memory }) => {
                let stack = MemStack::new(memory);
                let matrix = MatMut::from_column_major_slice_mut(&mut self.entries, n, n);
                factor::lu_in_place(matrix, &mut self.permutation, inverse, Par::Seq, stack, Default::default());
            }
            None => return T::eliminate(&mut self.entries, &mut self.permutation, &mut self.reciprocals),
        }
        for (k, reciprocal) in self.reciprocals.iter_mut().enumerate() {
            *reciprocal = T::from(1.0) / self.entries[k * n + k];
        }
    }

    /// Solves the linear system in place of its right-hand side `right`; returns false if the solution is not finite,
    /// as the matrix is then singular.
    pub fn solve(&mut self, right: &mut [T]) -> bool {
        of_size!(right.len(), |n| self.solve_of(n, right))
    }

    #[inline(always)]
    fn solve_of(&mut self, n: usize, right: &mut [T]) -> bool {
        let right = &mut right[..n];
        let x = &mut self.permuted[..n];
        for (x, &row) in x.iter_mut().zip(&self.permutation[..n]) {
            *x = right[row];
        }
        for k in 0..n {
            let (known, below) = x.split_at_mut(k + 1);
            subtract(below, known[k], &self.entries[k * n + k + 1..(k + 1) * n]);
        }
        for k in (0..n).rev() {
            let (above, rest) = x.split_at_mut(k);
            rest[0] *= self.reciprocals[k];
            subtract(above, rest[0], &self.entries[k * n..k * n + k]);
        }
        right.copy_from_slice(x);
        // Read all entries without early exit, so that the loop is vectorised.
        x.iter().fold(true, |finite, x| finite & is_finite(x))
    }
}

/// Subtracts a multiple of a matrix column from a vector, `x -= factor column`.
#[inline(always)]
fn subtract<T: Number>(x: &mut [T], factor: T, column: &[T]) {
    for (x, &entry) in x.iter_mut().zip(column) {
        *x -= entry * factor;
    }
}
