//! A tridiagonal M-matrix, solved by elimination without pivoting (Thomas 1949), which is stable for it and for every
//! principal submatrix (Funderlic, Neumann and Plemmons 1982). One elimination costs a third of a sparse
//! factorisation and solution by the library, and is the whole cost of a step in one dimension.

use super::Face;
use factorisation::SparseMatrix;

#[derive(Clone, Debug)]
pub(super) struct Tridiagonal {
    /// The subdiagonal `A_{i,i-1}`, zero at 0.
    pub below: Vec<f64>,
    pub diagonal: Vec<f64>,
    /// The superdiagonal `A_{i,i+1}`, zero at `n - 1`.
    pub above: Vec<f64>,
    pub inverse_diagonal: Vec<f64>,
    /// Workspace of a solve: the entries above the diagonal after elimination.
    eliminated: Vec<f64>,
}

impl Tridiagonal {
    /// Builds a tridiagonal M-matrix; returns `None` if the matrix has other diagonals, or a positive off-diagonal
    /// entry.
    pub fn of_m_matrix(matrix: &SparseMatrix) -> Option<Self> {
        let n = matrix.nrows();
        let (mut below, mut diagonal, mut above) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        for triplet in matrix.triplet_iter() {
            let (i, j, value) = (triplet.row, triplet.col, *triplet.val);
            let place = match (i + 1).checked_sub(j) {
                Some(0) => &mut above[i],
                Some(1) => &mut diagonal[i],
                Some(2) => &mut below[i],
                _ => return None,
            };
            *place = value;
        }
        let is_m_matrix = below.iter().chain(&above).all(|&value| value <= 0.0);
        is_m_matrix.then(|| Self::new(below, diagonal, above))
    }

    pub fn new(below: Vec<f64>, diagonal: Vec<f64>, above: Vec<f64>) -> Self {
        let inverse_diagonal = diagonal.iter().map(|d| 1.0 / d).collect();
        let eliminated = vec![0.0; diagonal.len()];
        Self { below, diagonal, above, inverse_diagonal, eliminated }
    }

    fn row(&self, i: usize, q: &[f64], z: &[f64]) -> (f64, f64) {
        let left = if i > 0 { self.below[i] * z[i - 1] } else { 0.0 };
        let right = if i + 1 < z.len() { self.above[i] * z[i + 1] } else { 0.0 };
        let own = self.diagonal[i] * z[i];
        (q[i] + left + own + right, q[i].abs() + left.abs() + own.abs() + right.abs())
    }

    pub fn apply(&self, q: &[f64], z: &[f64], w: &mut [f64], terms: &mut [f64]) {
        for (i, (w, terms)) in w.iter_mut().zip(terms).enumerate() {
            (*w, *terms) = self.row(i, q, z);
        }
    }

    pub fn apply_outside(&self, q: &[f64], z: &[f64], face: &[Face], w: &mut [f64], terms: &mut [f64]) {
        for (i, ((w, terms), &face)) in w.iter_mut().zip(terms).zip(face).enumerate() {
            if face != Face::Inside {
                (*w, *terms) = self.row(i, q, z);
            }
        }
    }

    pub fn add_transposed(&self, x: &[f64], out: &mut [f64]) {
        let n = x.len();
        for i in 0..n {
            out[i] += self.diagonal[i] * x[i];
            if i > 0 {
                out[i - 1] += self.below[i] * x[i];
            }
            if i + 1 < n {
                out[i + 1] += self.above[i] * x[i];
            }
        }
    }

    pub fn solve(&mut self, face: &[Face], shift: Option<&[f64]>, z: &mut [f64]) -> bool {
        let (mut ratio, mut value) = (0.0, 0.0);
        let entries = self.below.iter().zip(&self.diagonal).zip(&self.above);
        let results = self.eliminated.iter_mut().zip(z.iter_mut());
        for (i, ((((&a, &b), &c), &face), (eliminated, z))) in entries.zip(face).zip(results).enumerate() {
            if face == Face::Inside {
                let shifted = shift.map_or(b, |shift| b + shift[i]);
                let inverse = 1.0 / (shifted - a * ratio);
                ratio = c * inverse;
                value = (*z - a * value) * inverse;
            } else {
                (ratio, value) = (0.0, *z);
            }
            (*eliminated, *z) = (ratio, value);
        }
        let mut finite = true;
        let mut next = 0.0;
        for (z, &ratio) in z.iter_mut().zip(&self.eliminated).rev() {
            *z -= ratio * next;
            next = *z;
            finite &= next.is_finite();
        }
        finite
    }
}
