//! Singular values and eigenvalues of small dense matrices with any finite entries, by nalgebra: scaled first, so that
//! no square overflows, and with bounded work.

use nalgebra::{DMatrix, SVD, SymmetricEigen};

/// Iteration limit, far above the need of any matrix; sweeps converge cubically.
const ITERATIONS: usize = 10_000;

/// `A = U S V^T`, the singular values descending.
pub struct Singular {
    /// `U`, its columns in the order of the values.
    pub u: DMatrix<f64>,
    /// The diagonal of `S`.
    pub values: Vec<f64>,
    /// `V^T`, its rows in the order of the values.
    pub v_t: DMatrix<f64>,
}

impl Singular {
    /// Computes the decomposition; `None` if an entry is not finite.
    pub fn of(matrix: &DMatrix<f64>) -> Option<Self> {
        if matrix.is_empty() {
            let (rows, columns) = matrix.shape();
            return Some(Self { u: DMatrix::zeros(rows, 0), values: Vec::new(), v_t: DMatrix::zeros(0, columns) });
        }
        let size = size(matrix)?;
        let svd = SVD::try_new_unordered(matrix / size, true, true, f64::EPSILON, ITERATIONS)?;
        let (u, v_t) = (svd.u?, svd.v_t?);
        let mut order: Vec<usize> = (0..svd.singular_values.len()).collect();
        order.sort_by(|&i, &j| svd.singular_values[j].total_cmp(&svd.singular_values[i]));
        Some(Self {
            u: u.select_columns(&order),
            values: order.iter().map(|&i| size * svd.singular_values[i]).collect(),
            v_t: v_t.select_rows(&order),
        })
    }

    /// The number of singular values above this fraction of the largest.
    pub fn rank(&self, fraction: f64) -> usize {
        let largest = self.values.first().copied().unwrap_or(0.0);
        self.values.iter().take_while(|&&value| value > 0.0 && value > fraction * largest).count()
    }
}

/// The least eigenvalue of a symmetric matrix; `None` if it is empty or an entry is not finite.
pub fn least_eigenvalue(symmetric: &DMatrix<f64>) -> Option<f64> {
    let size = size(symmetric)?;
    let eigen = SymmetricEigen::try_new(symmetric / size, f64::EPSILON, ITERATIONS)?;
    Some(size * eigen.eigenvalues.min())
}

/// The largest absolute entry, or one if all are zero.
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
        // [[3, 0], [4, 5]] has the singular values 3 sqrt 5 and sqrt 5.
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
        // tridiag(-1, 2, -1) of order 5: 2 - 2 cos(pi / 6).
        let matrix = DMatrix::from_fn(5, 5, |i, j| match i.abs_diff(j) {
            0 => 2e300,
            1 => -1e300,
            _ => 0.0,
        });
        let exact = 2.0 - 3.0_f64.sqrt();
        assert!((least_eigenvalue(&matrix).expect("finite") / 1e300 - exact).abs() < 1e-14);
    }
}
