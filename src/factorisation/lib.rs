//! Factorisations of dense and sparse matrices, large ones by faer: analysed once, computed many times. No
//! factorisation is relied on to detect a singular matrix; a solution that is not finite shows it. Also the spectra on
//! which ranks and verdicts rest.

/// Evaluates an expression for a size, which is known to the compiler if it is small: loops over a few numbers are then
/// unrolled, whose bookkeeping would take longer than their arithmetic.
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

/// A sparse matrix in compressed columns.
pub type SparseMatrix<T = f64> = faer::sparse::SparseColMat<usize, T>;
