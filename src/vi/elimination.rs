//! Solution of one dense linear system without allocation, by nalgebra's kernels of Gaussian elimination with partial
//! pivoting; the right-hand side is an additional column.

use nalgebra::{DMatrixViewMut, Dyn, U1};

/// Overwrites the last column of `augmented`, a `k x (k + 1)` matrix, with the solution of the system in the first
/// `k` columns. Returns false if a pivot is zero or not a number.
pub(super) fn solve_augmented(augmented: &mut DMatrixViewMut<'_, f64, U1, Dyn>) -> bool {
    let k = augmented.nrows();
    for i in 0..k {
        let pivot = augmented.view_range(i.., i).icamax() + i;
        let diagonal = augmented[(pivot, i)];
        if diagonal == 0.0 || diagonal.is_nan() {
            return false;
        }
        if pivot == i {
            nalgebra::linalg::gauss_step(augmented, diagonal, i);
        } else {
            nalgebra::linalg::gauss_step_swap(augmented, diagonal, i, pivot);
        }
    }
    let (matrix, mut rhs) = augmented.columns_range_pair_mut(..k, k);
    matrix.solve_upper_triangular_mut(&mut rhs)
}
