//! The matrix of an active set method, with products and with solutions of the rows of inactive variables,
//!
//! ```text
//! sum_j A_ij z_j + s_i z_i = r_i  for i inside,    z_i given elsewhere
//! ```

use super::grid::Coarser;
use super::sparse::Sparse;
use super::tridiagonal::Tridiagonal;
use super::{Face, Unsuitable};
use factorisation::SparseMatrix;
use problem::Control;

#[expect(clippy::large_enum_variant, reason = "one of them lives as long as its stepper; a box would only add a hop")]
pub(super) enum Operator {
    Tridiagonal(Tridiagonal),
    Sparse(Sparse),
}

impl Operator {
    /// Builds the operator of a tridiagonal M-matrix; returns `None` for any other suitable matrix.
    pub fn tridiagonal(matrix: &SparseMatrix) -> Result<Option<Self>, Unsuitable> {
        let (rows, columns) = (matrix.nrows(), matrix.ncols());
        if rows != columns {
            return Err(Unsuitable::Shape { rows, columns, expected: rows });
        }
        for row in 0..rows {
            let value = matrix.get(row, row).copied().unwrap_or(0.0);
            if !(value > 0.0 && value < f64::INFINITY) {
                return Err(Unsuitable::Diagonal { row, value });
            }
        }
        Ok(Tridiagonal::of_m_matrix(matrix).map(Self::Tridiagonal))
    }

    /// Builds the operator of a sparse matrix that is not a tridiagonal M-matrix; `below` are the coarser grids, if
    /// its rows are nodes of a grid.
    pub fn sparse(matrix: &SparseMatrix, below: &[Coarser], control: &Control) -> Result<Self, Unsuitable> {
        Ok(Self::Sparse(Sparse::new(matrix, below, control)?))
    }

    pub fn len(&self) -> usize {
        self.inverse_diagonal().len()
    }

    /// Returns the reciprocal of each diagonal entry of the matrix.
    pub fn inverse_diagonal(&self) -> &[f64] {
        match self {
            Self::Tridiagonal(matrix) => &matrix.inverse_diagonal,
            Self::Sparse(matrix) => &matrix.inverse_diagonal,
        }
    }

    /// Writes `w = A z + q` and `terms = |A| |z| + |q|`.
    pub fn apply(&self, q: &[f64], z: &[f64], w: &mut [f64], terms: &mut [f64]) {
        match self {
            Self::Tridiagonal(matrix) => matrix.apply(q, z, w, terms),
            Self::Sparse(matrix) => matrix.apply(q, z, w, terms),
        }
    }

    /// Writes `w = A z + q` and `terms = |A| |z| + |q|` for active variables; other entries are unspecified.
    pub fn inequality(&self, q: &[f64], z: &[f64], face: &[Face], w: &mut [f64], terms: &mut [f64]) {
        match self {
            Self::Tridiagonal(matrix) => matrix.apply_outside(q, z, face, w, terms),
            Self::Sparse(matrix) => matrix.apply(q, z, w, terms),
        }
    }

    /// Adds the transposed product, `out += A^T x`.
    pub fn add_transposed(&self, x: &[f64], out: &mut [f64]) {
        match self {
            Self::Tridiagonal(matrix) => matrix.add_transposed(x, out),
            Self::Sparse(matrix) => matrix.add_transposed(x, out),
        }
    }

    /// Solves the linear system of the active set in place: `z` contains the right-hand side `r` for inactive variables
    /// and given values for the others; `shift` is the diagonal `s`. Returns false if the system is singular, or if
    /// `control` asks to stop.
    pub fn solve(&mut self, face: &[Face], shift: Option<&[f64]>, z: &mut [f64], control: &Control) -> bool {
        match self {
            Self::Tridiagonal(matrix) => matrix.solve(face, shift, z),
            Self::Sparse(matrix) => matrix.solve(face, shift, z, control),
        }
    }
}
