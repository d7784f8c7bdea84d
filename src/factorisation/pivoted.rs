//! The rank and the Moore-Penrose inverse of small square matrices.

use nalgebra::{DMatrix, Dyn, FullPivLU};

/// A square matrix factorised as `P A Q = L D U` with complete pivoting, which reveals its rank and bounds the
/// entries of `L` and `U` by one.
pub struct Pivoted {
    factors: FullPivLU<f64, Dyn, Dyn>,
}

impl Pivoted {
    /// Factorises a square matrix with complete pivoting.
    pub fn new(matrix: DMatrix<f64>) -> Self {
        Self { factors: matrix.full_piv_lu() }
    }

    /// Returns the numerical rank of the factorised matrix: the number of pivots above the given fraction of the
    /// largest pivot.
    pub fn rank(&self, fraction: f64) -> usize {
        let pivots = self.factors.u().diagonal().abs();
        pivots.iter().filter(|pivot| **pivot > fraction * pivots.max()).count()
    }

    /// Returns the inverse of the factorised matrix; `None` if a pivot is zero.
    pub fn inverse(&self) -> Option<DMatrix<f64>> {
        self.factors.try_inverse()
    }

    /// Returns the solution `X` of `A X = B` with the factorised matrix `A` and `B` given by `right`; `None` if a pivot
    /// is zero.
    pub fn solve(&self, right: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        self.factors.solve(right)
    }

    /// Returns the Moore-Penrose inverse of a matrix of the given rank, by factors of full rank (Ben-Israel and
    /// Greville 2003, *Generalized Inverses*, section 1.6), with `rank` columns of `L` and rows of `U`:
    ///
    /// ```text
    /// A^+ = Q U^T (U U^T)^-1 D^-1 (L^T L)^-1 L^T P
    /// ```
    ///
    /// Returns `None` if an entry is not finite.
    pub fn pseudo_inverse(&self, rank: usize) -> Option<DMatrix<f64>> {
        let (l, u) = (self.factors.l().columns(0, rank).into_owned(), self.factors.u());
        let d = u.diagonal().rows(0, rank).into_owned();
        let mut u = u.rows(0, rank).into_owned();
        u.row_iter_mut().zip(d.iter()).for_each(|(mut row, d)| row /= *d);
        let mut inverse = (l.transpose() * &l).cholesky()?.solve(&l.transpose());
        inverse.row_iter_mut().zip(d.iter()).for_each(|(mut row, d)| row /= *d);
        let mut inverse = u.transpose() * (&u * u.transpose()).cholesky()?.solve(&inverse);
        self.factors.q().inv_permute_rows(&mut inverse);
        self.factors.p().inv_permute_columns(&mut inverse);
        inverse.iter().all(|entry| entry.is_finite()).then_some(inverse)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DVector;

    #[test]
    fn the_pseudo_inverse_of_a_corner_obeys_its_four_laws() {
        // The Delassus matrix of a body held by a floor and a wall, each with a normal and a friction direction. Its
        // rank is two of four; rows and columns are scaled by the roots of the contact forces.
        let scale = DMatrix::from_diagonal(&DVector::from_vec(
            [4.216970718184588, 6.113228723590284, 0.2 * 4.216970718184588, 0.3 * 6.113228723590284]
                .map(f64::sqrt)
                .to_vec(),
        ));
        let rows = DMatrix::from_row_slice(4, 2, &[0.0, 1.0, -1.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        let matrix = &scale * (&rows * rows.transpose()) * &scale;
        let inverse = Pivoted::new(matrix.clone()).pseudo_inverse(2).unwrap();
        let (left, right) = (&matrix * &inverse, &inverse * &matrix);
        let is_near = |a: &DMatrix<f64>, b: &DMatrix<f64>| (a - b).amax() < 1e-14 * b.amax();
        assert!(is_near(&(&left * &matrix), &matrix) && is_near(&(&right * &inverse), &inverse));
        assert!(is_near(&left, &left.transpose()) && is_near(&right, &right.transpose()));
    }

    #[test]
    fn the_pseudo_inverse_of_a_matrix_that_is_not_symmetric_obeys_its_four_laws() {
        let (a, b) = (
            DMatrix::from_fn(6, 3, |i, j| ((i * i + 3 * j * j + i * j) as f64).sin()),
            DMatrix::from_fn(3, 6, |i, j| ((2 * i * i + 5 * j * j + i * j) as f64).cos()),
        );
        let matrix = &a * &b;
        let inverse = Pivoted::new(matrix.clone()).pseudo_inverse(3).unwrap();
        let (left, right) = (&matrix * &inverse, &inverse * &matrix);
        let is_near = |a: &DMatrix<f64>, b: &DMatrix<f64>| (a - b).amax() < 1e-11 * b.amax();
        assert!(is_near(&(&left * &matrix), &matrix) && is_near(&(&right * &inverse), &inverse));
        assert!(is_near(&left, &left.transpose()) && is_near(&right, &right.transpose()));
    }
}
