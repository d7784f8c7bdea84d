//! Singular values and eigenvalues of small dense matrices with any finite entries: matrices are scaled first, so
//! that no square overflows, and the work is bounded. Singular values are computed by faer: for one in fifteen
//! matrices with two nearly equal singular values and zeros, the factors of nalgebra 0.35 miss the matrix by 1e-4 and
//! more.

use faer::Mat;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Iteration limit for the eigenvalue computation, far above the need of any matrix: its sweeps converge cubically.
const ITERATIONS: usize = 10_000;

/// A singular value decomposition `A = U S V^T`, the singular values descending.
pub struct Singular {
    /// The matrix `U` of left singular vectors, one column per singular value.
    pub u: DMatrix<f64>,
    /// The singular values, the diagonal of `S`.
    pub values: Vec<f64>,
    /// The matrix `V^T` of right singular vectors, one row per singular value.
    pub v_t: DMatrix<f64>,
}

impl Singular {
    /// Computes the singular value decomposition; returns `None` if an entry is not finite.
    pub fn of(matrix: &DMatrix<f64>) -> Option<Self> {
        if matrix.is_empty() {
            let (rows, columns) = matrix.shape();
            return Some(Self { u: DMatrix::zeros(rows, 0), values: Vec::new(), v_t: DMatrix::zeros(0, columns) });
        }
        let size = size(matrix)?;
        let (rows, columns) = matrix.shape();
        let svd = Mat::from_fn(rows, columns, |i, j| matrix[(i, j)] / size).thin_svd().ok()?;
        let (u, s, v) = (svd.U(), svd.S().column_vector(), svd.V());
        let count = rows.min(columns);
        Some(Self {
            u: DMatrix::from_fn(rows, count, |i, k| u[(i, k)]),
            values: (0..count).map(|k| size * s[k]).collect(),
            v_t: DMatrix::from_fn(count, columns, |k, j| v[(j, k)]),
        })
    }

    /// Returns the least-squares solution of `A x = b` of least norm, with singular values up to `least` treated as
    /// zero.
    pub fn solve(&self, right: &DVector<f64>, least: f64) -> DVector<f64> {
        let mut along = self.u.tr_mul(right);
        let inverse = |value: f64| if value > least { value.recip() } else { 0.0 };
        along.iter_mut().zip(&self.values).for_each(|(along, value)| *along *= inverse(*value));
        self.v_t.tr_mul(&along)
    }

    /// Returns the numerical rank: the number of singular values above the given fraction of the largest.
    pub fn rank(&self, fraction: f64) -> usize {
        let largest = self.values.first().copied().unwrap_or(0.0);
        self.values.iter().take_while(|&&value| value > 0.0 && value > fraction * largest).count()
    }
}

/// Returns the least eigenvalue of a symmetric matrix; `None` if it is empty or an entry is not finite.
pub fn least_eigenvalue(symmetric: &DMatrix<f64>) -> Option<f64> {
    let size = size(symmetric)?;
    let eigen = SymmetricEigen::try_new(symmetric / size, f64::EPSILON, ITERATIONS)?;
    Some(size * eigen.eigenvalues.min())
}

/// Returns the largest absolute entry of a matrix, or one if all are zero; `None` if the matrix is empty or an entry is
/// not finite.
fn size(matrix: &DMatrix<f64>) -> Option<f64> {
    let size = matrix.amax();
    let is_finite = !matrix.is_empty() && matrix.iter().all(|entry| entry.is_finite());
    is_finite.then_some(if size > 0.0 { size } else { 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_at_the_limits_of_doubles_is_decomposed() {
        // The matrix [[3, 0], [4, 5]] has the singular values 3 sqrt 5 and sqrt 5.
        for size in [1e-307, 1.0, 1e307] {
            let matrix = DMatrix::from_row_slice(2, 2, &[3.0 * size, 0.0, 4.0 * size, 5.0 * size]);
            let found = Singular::of(&matrix).expect("finite");
            for (value, exact) in found.values.iter().zip([3.0 * 5.0_f64.sqrt(), 5.0_f64.sqrt()]) {
                assert!((value / size - exact).abs() < 1e-14, "{size}: {:?}", found.values);
            }
            let product = &found.u * DMatrix::from_diagonal(&found.values.clone().into()) * &found.v_t;
            assert!((product - &matrix).amax() <= 1e-14 * matrix.amax());
        }
    }

    /// Returns the Delassus matrix of a body held by a floor and a wall, each with a normal and a friction direction,
    /// with rows and columns scaled by the roots of the contact forces. The rank is two of four.
    fn corner(a: f64, b: f64) -> DMatrix<f64> {
        let scale = DMatrix::from_diagonal(&DVector::from_vec([a, b, 0.2 * a, 0.3 * b].map(f64::sqrt).to_vec()));
        let rows = DMatrix::from_row_slice(4, 2, &[0.0, 1.0, -1.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        &scale * (&rows * rows.transpose()) * &scale
    }

    #[test]
    fn matrices_with_nearly_equal_singular_values_and_zeros_are_the_products_of_their_factors() {
        let phases =
            |k: usize| [(k as f64 * 0.618_033_988_749_894_8).fract(), (k as f64 * 0.414_213_562_373_095).fract()];
        for [a, b] in (1..2000).map(phases).chain([[5.5906806299225735, 6.166448128444831]]) {
            let matrix = corner(10.0 * a + 0.01, 10.0 * b + 0.01) / (0.5 + a);
            let found = Singular::of(&matrix).expect("finite");
            let product = &found.u * DMatrix::from_diagonal(&found.values.clone().into()) * &found.v_t;
            let off = (product - &matrix).amax();
            assert!(off <= 1e-13 * matrix.amax(), "{a} {b}: {off:e} of {:e}", matrix.amax());
            assert_eq!(found.rank(1e-11), 2);
            assert!(found.values.is_sorted_by(|a, b| a >= b));
            let right = &matrix * DVector::from_vec(vec![1.0, -2.0, 3.0, 0.5]);
            let solved = found.solve(&right, 1e-11 * found.values[0]);
            assert!((&matrix * solved - &right).amax() <= 1e-12 * right.amax(), "{a} {b}");
        }
    }

    #[test]
    fn ranks_count_what_is_above_rounding() {
        let outer = DMatrix::from_fn(4, 3, |i, j| (i + 1) as f64 * (j as f64 - 0.7));
        assert_eq!(Singular::of(&outer).expect("finite").rank(1e-12), 1);
        assert_eq!(Singular::of(&DMatrix::zeros(2, 2)).expect("finite").rank(1e-12), 0);
    }

    #[test]
    fn what_is_not_finite_has_no_spectrum_and_what_is_empty_no_rank() {
        let infinite = DMatrix::from_element(2, 2, f64::INFINITY);
        assert!(Singular::of(&infinite).is_none() && least_eigenvalue(&infinite).is_none());
        assert!(Singular::of(&DMatrix::from_element(1, 1, f64::NAN)).is_none());
        assert!(least_eigenvalue(&DMatrix::zeros(0, 0)).is_none());
        assert_eq!(Singular::of(&DMatrix::zeros(0, 3)).expect("nothing is infinite").rank(1e-12), 0);
    }

    #[test]
    fn the_least_eigenvalue_of_the_second_difference() {
        // The matrix tridiag(-1, 2, -1) of order 5 has the least eigenvalue 2 - 2 cos(pi / 6).
        let matrix = DMatrix::from_fn(5, 5, |i, j| match i.abs_diff(j) {
            0 => 2e300,
            1 => -1e300,
            _ => 0.0,
        });
        let exact = 2.0 - 3.0_f64.sqrt();
        assert!((least_eigenvalue(&matrix).expect("finite") / 1e300 - exact).abs() < 1e-14);
    }
}
