//! A sparse matrix of any pattern, with the rows and columns of active variables replaced by those of the identity,
//! so that the pattern and its analysis are kept. A symmetric matrix stays symmetric, and is factorised by Cholesky,
//! or solved by multigrid if the factors would not be sparse.

use super::grid::Coarser;
use super::multigrid::Multigrid;
use super::{Face, Unsuitable};
use factorisation::{Analysis, Cholesky, SparseLu, SparseMatrix};
use problem::{Control, ConvexSet};

pub(super) struct Sparse {
    matrix: SparseMatrix,
    pub inverse_diagonal: Vec<f64>,
    /// The matrix with rows and columns of active variables replaced by those of the identity.
    restricted: SparseMatrix,
    factors: Factors,
    /// The active set for which the current factors were computed; `None` if a shift was added to the diagonal.
    factored: Option<Vec<Face>>,
}

enum Factors {
    Cholesky(Cholesky),
    Lu(SparseLu<f64>),
    Multigrid(Box<Multigrid>),
}

/// Smallest number of nodes of a grid in two or more dimensions for which multigrid is used.
const MANY: usize = 20_000;

impl Sparse {
    /// Prepares a sparse matrix; `below` are the coarser grids, if its rows are nodes of a grid.
    pub fn new(matrix: &SparseMatrix, below: &[Coarser], control: &Control) -> Result<Self, Unsuitable> {
        control.go_on()?;
        let n = matrix.nrows();
        let inverse_diagonal = (0..n).map(|i| matrix.get(i, i).map_or(f64::INFINITY, |d| 1.0 / d)).collect();
        let factors = if !is_symmetric(matrix) {
            Analysis::new(matrix.symbolic()).and_then(|analysis| SparseLu::new(&analysis)).map(Factors::Lu)
        } else if n >= MANY && below.first().is_some_and(|grid| grid.shape.len() > 1) {
            Some(Factors::Multigrid(Box::new(Multigrid::new(matrix, below, control)?)))
        } else {
            Cholesky::new(matrix).map(Factors::Cholesky)
        };
        Ok(Self {
            matrix: matrix.clone(),
            inverse_diagonal,
            restricted: matrix.clone(),
            factors: factors.ok_or(Unsuitable::Memory)?,
            factored: None,
        })
    }

    pub fn apply(&self, q: &[f64], z: &[f64], w: &mut [f64], terms: &mut [f64]) {
        for ((w, terms), &q) in w.iter_mut().zip(terms.iter_mut()).zip(q) {
            (*w, *terms) = (q, q.abs());
        }
        for (j, &z) in z.iter().enumerate() {
            for (&i, &a) in self.column(j) {
                w[i] += a * z;
                terms[i] += (a * z).abs();
            }
        }
    }

    /// Makes one projected Gauss-Seidel sweep through the variables, forwards or backwards; updates `w = A z + q`.
    pub fn relax(&self, set: &ConvexSet, z: &mut [f64], w: &mut [f64], forwards: bool) {
        let n = z.len();
        for k in 0..n {
            let i = if forwards { k } else { n - 1 - k };
            let new = set.project(i, z[i] - self.inverse_diagonal[i] * w[i]);
            let change = new - z[i];
            if change != 0.0 {
                z[i] = new;
                for (&row, &a) in self.column(i) {
                    w[row] += a * change;
                }
            }
        }
    }

    pub fn add_transposed(&self, x: &[f64], out: &mut [f64]) {
        for (j, out) in out.iter_mut().enumerate() {
            *out += self.column(j).map(|(&i, &a)| a * x[i]).sum::<f64>();
        }
    }

    fn column(&self, j: usize) -> impl Iterator<Item = (&usize, &f64)> {
        self.matrix.symbolic().row_idx_of_col_raw(j).iter().zip(self.matrix.val_of_col(j))
    }

    pub fn solve(&mut self, face: &[Face], shift: Option<&[f64]>, z: &mut [f64], control: &Control) -> bool {
        let at_hand = shift.is_none() && self.factored.as_deref() == Some(face);
        if !at_hand && !self.factorise(face, shift) {
            return false;
        }
        for j in (0..face.len()).filter(|&j| face[j] != Face::Inside) {
            let given = z[j];
            if given != 0.0 {
                for (&i, &a) in self.column(j) {
                    if face[i] == Face::Inside {
                        z[i] -= a * given;
                    }
                }
            }
        }
        match &mut self.factors {
            Factors::Cholesky(factors) => factors.solve(z),
            Factors::Lu(factors) => factors.solve(z),
            Factors::Multigrid(multigrid) => multigrid.solve(z, control),
        }
    }

    fn factorise(&mut self, face: &[Face], shift: Option<&[f64]>) -> bool {
        let mut kept = self.factored.take().unwrap_or_default();
        let inside = |i: usize| face[i] == Face::Inside;
        restrict(&self.matrix, inside, |i| shift.map_or(0.0, |shift| shift[i]), &mut self.restricted);
        let regular = match &mut self.factors {
            Factors::Cholesky(factors) => factors.factorise(&self.restricted),
            Factors::Lu(factors) => factors.factorise(&self.restricted),
            Factors::Multigrid(multigrid) => {
                multigrid.restrict(&self.restricted, face.iter().map(|face| *face == Face::Inside))
            }
        };
        if regular && shift.is_none() {
            kept.clear();
            kept.extend_from_slice(face);
            self.factored = Some(kept);
        }
        regular
    }
}

/// Adds `shift` to the diagonal of the matrix, and replaces the rows and columns of variables that are not inside their
/// intervals by those of the identity.
pub(super) fn restrict(
    matrix: &SparseMatrix,
    inside: impl Fn(usize) -> bool,
    shift: impl Fn(usize) -> f64,
    restricted: &mut SparseMatrix,
) {
    let (symbolic, values) = restricted.parts_mut();
    for j in 0..matrix.ncols() {
        let range = symbolic.col_range(j);
        let rows = &symbolic.row_idx()[range.clone()];
        for ((value, &i), &a) in values[range].iter_mut().zip(rows).zip(matrix.val_of_col(j)) {
            *value = match (inside(i) && inside(j), i == j) {
                (true, true) => a + shift(j),
                (true, false) => a,
                (false, true) => 1.0,
                (false, false) => 0.0,
            };
        }
    }
}

/// Whether a matrix is symmetric up to rounding, as a product `P^T A P` is.
fn is_symmetric(matrix: &SparseMatrix) -> bool {
    let Ok(transposed) = matrix.transpose().to_col_major() else { return false };
    matrix.symbolic().col_ptr() == transposed.symbolic().col_ptr()
        && matrix.symbolic().row_idx() == transposed.symbolic().row_idx()
        && matrix.val().iter().zip(transposed.val()).all(|(a, b)| (a - b).abs() <= 1e-13 * (a.abs() + b.abs()))
}
