//! Factorisations of dense and of sparse matrices, by nalgebra and faer: analysed once, computed again and again. None of
//! them is trusted to notice a singular matrix; a solution that is not finite shows it. Beside them the spectra that
//! ranks and verdicts rest on.

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
