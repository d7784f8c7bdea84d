//! Proof of infeasibility by a single row of an affine variational inequality: `w_i < 0` for every `z` in `K`
//! although `z_i` has no upper bound, or `w_i > 0` for every `z` in `K` although `z_i` has no lower bound.

use super::AffineVi;
use problem::Workspace;

/// Margin above rounding errors by which `w_i` must miss zero, relative to `|q_i|`.
const MARGIN: f64 = 1e-10;

impl AffineVi<'_> {
    /// Returns the first variable whose row proves that the variational inequality has no solution, if any.
    pub fn contradiction(&self) -> Option<usize> {
        let mut work = Workspace::default();
        let mut row = vec![0.0; self.q.len()];
        (0..self.q.len()).filter(|&i| self.set.block_of(i).is_none()).find(|&i| {
            let mut largest = |sign: f64| {
                row.iter_mut().zip(self.matrix.row(i).iter()).for_each(|(d, a)| *d = sign * a);
                self.set.support(&row, &mut work) + sign * self.q[i]
            };
            let margin = -MARGIN * self.q[i].abs();
            (self.set.upper[i] == f64::INFINITY && largest(1.0) < margin)
                || (self.set.lower[i] == f64::NEG_INFINITY && largest(-1.0) < margin)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use problem::ConvexSet;

    fn found(matrix: &[f64], q: &[f64], set: &ConvexSet) -> Option<usize> {
        let matrix = DMatrix::from_row_slice(q.len(), q.len(), matrix);
        AffineVi { matrix: &matrix, q, set }.contradiction()
    }

    #[test]
    fn a_push_that_only_presses_harder_is_named() {
        let orthant = ConvexSet::nonnegative(2);
        // For z >= 0, w2 = -z1 - z2 - 1 is always negative, which proves infeasibility; with a positive entry in the
        // row it is no proof.
        assert_eq!(found(&[1.0, 0.0, -1.0, -1.0], &[1.0, -1.0], &orthant), Some(1));
        assert_eq!(found(&[1.0, 0.0, 1e-9, -1.0], &[1.0, -1.0], &orthant), None);
        // If the variable has an upper bound, a negative w is no proof: the variable may be at that bound.
        let boxed = ConvexSet::intervals(vec![0.0; 2], vec![f64::INFINITY, 3.0]);
        assert_eq!(found(&[1.0, 0.0, -1.0, -1.0], &[1.0, -1.0], &boxed), None);
        // A row with w > 0 for every z proves infeasibility if the variable has no lower bound.
        let below = ConvexSet::intervals(vec![f64::NEG_INFINITY], vec![0.0]);
        assert_eq!(found(&[-1.0], &[2.0], &below), Some(0));
        assert_eq!(found(&[1.0], &[2.0], &below), None);
    }
}
