//! Factorisations of dense and sparse matrices, by nalgebra and faer: analysed once, computed many times. No
//! factorisation is relied on to detect a singular matrix; a solution that is not finite shows it. Also the spectra on
//! which ranks and verdicts rest.

mod apart;
mod cholesky;
mod dense_lu;
mod equilibration;
mod sparse_lu;
mod spectrum;
#[cfg(test)]
mod tests;

pub use cholesky::Cholesky;
pub use dense_lu::{DenseLu, Number};
pub use equilibration::{equilibrated, scale_of};
pub use sparse_lu::{Analysis, SparseLu};
pub use spectrum::{Singular, least_eigenvalue};

/// A sparse matrix in compressed columns.
pub type SparseMatrix<T = f64> = faer::sparse::SparseColMat<usize, T>;
