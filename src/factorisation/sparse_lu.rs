//! LU factors `P A Q = L U` of a sparse square `A`, with partial pivoting by rows and columns ordered by approximate
//! minimum degree (Davis, Gilbert, Larimore and Ng 2004, COLAMD).

use super::SparseMatrix;
use super::apart::THREADS;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::lu::{LuRef, NumericLu, SymbolicLu, factorize_symbolic_lu};
use faer::traits::ComplexField;
use faer::traits::math_utils::is_finite;
use faer::{Conj, MatMut, Par};
use std::sync::Arc;

/// Number of nonzeros from which a factorisation and its analysis may take more than a second: for grids in three
/// dimensions their cost grows with the square of the number of rows.
const LARGE: usize = 200_000;

/// The ordering and elimination tree of a sparsity pattern, for real and complex matrices alike.
#[derive(Clone, Debug)]
pub struct Analysis(Arc<SymbolicLu<usize>>);

impl Analysis {
    /// Analyses a square sparsity pattern; returns `None` if memory does not suffice.
    pub fn new(pattern: SymbolicSparseColMatRef<'_, usize>) -> Option<Self> {
        factorize_symbolic_lu(pattern, Default::default()).ok().map(|analysis| Self(Arc::new(analysis)))
    }

    /// Analyses a square sparsity pattern; returns `None` once `stop` returns true, as the ordering of a large
    /// pattern takes seconds, or if memory does not suffice.
    pub fn new_unless(pattern: SymbolicSparseColMatRef<'_, usize>, stop: impl Fn() -> bool) -> Option<Self> {
        if pattern.compute_nnz() < LARGE {
            return Self::new(pattern);
        }
        let pattern = pattern.to_owned().ok()?;
        THREADS.compute(move || Self::new(pattern.as_ref()), stop)?
    }
}

/// LU factors for matrices of one sparsity pattern.
pub struct SparseLu<T> {
    analysis: Analysis,
    factors: NumericLu<usize, T>,
    memory: MemBuffer,
    is_factored: bool,
    /// Whether the workspace is owned by an abandoned thread, so that no further factorisation is possible.
    is_given_up: bool,
}

impl<T: ComplexField> SparseLu<T> {
    /// Allocates LU factors for matrices of the analysed sparsity pattern; returns `None` if memory does not suffice.
    pub fn new(analysis: &Analysis) -> Option<Self> {
        let factor = analysis.0.factorize_numeric_lu_scratch::<T>(Par::Seq, Default::default());
        let solve = analysis.0.solve_in_place_scratch::<T>(1, Par::Seq);
        let memory = MemBuffer::try_new(factor.or(solve)).ok()?;
        Some(Self {
            analysis: analysis.clone(),
            factors: NumericLu::new(),
            memory,
            is_factored: false,
            is_given_up: false,
        })
    }

    /// Factorises a matrix with the analysed pattern; returns false if it is structurally singular, not finite, or
    /// too large, or if a former factorisation was abandoned.
    pub fn factorise(&mut self, matrix: &SparseMatrix<T>) -> bool {
        if self.is_given_up {
            return false;
        }
        let stack = MemStack::new(&mut self.memory);
        let symbolic = &self.analysis.0;
        self.is_factored = matrix.val().iter().all(is_finite)
            && symbolic
                .factorize_numeric_lu(&mut self.factors, matrix.as_ref(), Par::Seq, stack, Default::default())
                .is_ok();
        self.is_factored
    }

    /// Factorises a matrix with the analysed pattern unless `stop`, which is polled several times a second, returns
    /// true: the factors of a large matrix can take minutes. After a stop the factors are unusable.
    pub fn factorise_unless(&mut self, matrix: &SparseMatrix<T>, stop: impl Fn() -> bool) -> bool
    where
        T: Send + Sync + 'static,
        SparseMatrix<T>: Clone,
    {
        if self.is_given_up || matrix.val().len() < LARGE {
            return self.factorise(matrix);
        }
        let empty = Self {
            analysis: self.analysis.clone(),
            factors: NumericLu::new(),
            memory: MemBuffer::new(StackReq::EMPTY),
            is_factored: false,
            is_given_up: true,
        };
        let (mut working, matrix) = (std::mem::replace(self, empty), matrix.clone());
        let computing = move || {
            working.factorise(&matrix);
            working
        };
        if let Some(working) = THREADS.compute(computing, stop) {
            *self = working;
        }
        self.is_factored
    }

    /// Solves the linear system in place of its right-hand side `right`; returns false if there are no factors, or the
    /// solution is not finite, as the matrix is then singular.
    pub fn solve(&mut self, right: &mut [T]) -> bool {
        if !self.is_factored {
            return false;
        }
        let n = right.len();
        let stack = MemStack::new(&mut self.memory);
        let columns = MatMut::from_column_major_slice_mut(right, n, 1);
        LuRef::new_unchecked(&self.analysis.0, &self.factors).solve_in_place_with_conj(
            Conj::No,
            columns,
            Par::Seq,
            stack,
        );
        right.iter().all(is_finite)
    }
}
