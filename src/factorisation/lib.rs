//! Factorisations of dense and sparse matrices, large ones by faer: the pattern is analysed once, factors are
//! computed many times. No factorisation is relied on to detect a singular matrix; the solution is then not finite.
//! Also singular values and eigenvalues, from which ranks and definiteness are determined.

/// Evaluates an expression in which the given size is a compile-time constant if it is small. The compiler then
/// unrolls loops over a few numbers, whose loop control would take longer than their arithmetic.
#[macro_export]
macro_rules! of_size {
    ($size:expr, |$n:ident| $body:expr) => {
        match $size {
            1 => {
                let $n = 1_usize;
                $body
            }
            2 => {
                let $n = 2_usize;
                $body
            }
            3 => {
                let $n = 3_usize;
                $body
            }
            4 => {
                let $n = 4_usize;
                $body
            }
            $n => $body,
        }
    };
}

mod apart;
mod cholesky;
mod dense_lu;
mod elimination;
mod equilibration;
mod pivoted;
mod sparse_lu;
mod spectrum;
#[cfg(test)]
mod tests;

pub use cholesky::Cholesky;
pub use dense_lu::{DenseLu, Number};
pub use elimination::ComplexLu;
pub use equilibration::{equilibrated, scale_of};
pub use pivoted::Pivoted;
pub use sparse_lu::{Analysis, SparseLu};
pub use spectrum::{Singular, least_eigenvalue};

/// A sparse matrix in compressed column storage.
pub type SparseMatrix<T = f64> = faer::sparse::SparseColMat<usize, T>;
