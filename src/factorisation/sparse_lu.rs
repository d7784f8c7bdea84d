//! `P A Q = L U` for a sparse square `A`, with partial pivoting by rows and columns ordered by approximate minimum
//! degree (Davis, Gilbert, Larimore and Ng 2004, COLAMD).

use super::SparseMatrix;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::lu::{LuRef, NumericLu, SymbolicLu, factorize_symbolic_lu};
use faer::traits::ComplexField;
use faer::traits::math_utils::is_finite;
use faer::{Conj, MatMut, Par};
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

/// Nonzeros from which factors may take more than a second: in three dimensions they grow like the square of the rows.
const LARGE: usize = 200_000;

/// The time between two looks at whether to go on.
const GLANCE: Duration = Duration::from_millis(20);

/// The ordering and elimination tree of a pattern, for real and complex matrices alike.
#[derive(Clone, Debug)]
pub struct Analysis(Arc<SymbolicLu<usize>>);

impl Analysis {
    /// Analyses a square pattern; `None` if memory does not suffice.
    pub fn new(pattern: SymbolicSparseColMatRef<'_, usize>) -> Option<Self> {
        factorize_symbolic_lu(pattern, Default::default()).ok().map(|analysis| Self(Arc::new(analysis)))
    }
}

/// LU factors for matrices of one pattern.
pub struct SparseLu<T> {
    analysis: Analysis,
    factors: NumericLu<usize, T>,
    memory: MemBuffer,
    is_factored: bool,
    /// Whether the workspace is with a thread that nobody waits for any more.
    is_given_up: bool,
}

impl<T: ComplexField> SparseLu<T> {
    /// Workspace for the pattern analysed; `None` if memory does not suffice.
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

    /// Factorises a matrix of the pattern analysed; false if it is structurally singular, not finite, or too large, or if
    /// these factors were given up.
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

    /// The same, given up where `stop` says so, which is asked a few times a second: the factors of a large matrix can take
    /// minutes, and the library that computes them does not look up. Those are computed on a thread of their own, which nobody
    /// waits for once they are given up; then there are no factors any more.
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
        let (done, result) = channel();
        let computed = thread::Builder::new().name("dvi-factors".to_owned()).spawn(move || {
            working.factorise(&matrix);
            // Where nobody waits any more there is nobody to tell.
            let _ = done.send(working);
        });
        if computed.is_err() {
            return false;
        }
        loop {
            match result.recv_timeout(GLANCE) {
                Ok(working) => {
                    *self = working;
                    return self.is_factored;
                }
                Err(RecvTimeoutError::Timeout) if !stop() => {}
                Err(_) => return false,
            }
        }
    }

    /// Solves in place; false if there are no factors, or the solution is not finite: the matrix is singular.
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
