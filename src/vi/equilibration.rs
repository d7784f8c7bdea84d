//! Scaling of an affine variational inequality over intervals by positive diagonal matrices,
//!
//! ```text
//! A' = R A C,    q' = R q,    z' = C^-1 z,    w' = R w,    K' = C^-1 K
//! ```
//!
//! which keeps every sign and therefore the solutions. If the entries of `A` differ widely in size, `R` and `C` bring
//! the largest entry of each row and column near one (Ruiz 2001, *A scaling algorithm to equilibrate both rows and
//! columns norms in matrices*); their entries are powers of two, so that scaling is exact.

use super::AffineVi;

/// Rows and columns whose largest entry is within this factor of one are left unscaled.
const BALANCED: f64 = 64.0;

/// Number of scaling sweeps: each takes the square root of the imbalance, and eight bring 1e-18..1e18 within a factor
/// of two.
const SWEEPS: usize = 8;

/// The diagonal scaling matrices `R` of rows and `C` of columns.
#[derive(Debug)]
pub(super) struct Equilibration {
    /// The diagonal of the row scaling `R`, of length `m`.
    pub row: Vec<f64>,
    /// The diagonal of the column scaling `C`, of length `m`.
    pub column: Vec<f64>,
    /// The diagonal of `C^-1`, exact.
    pub inverse_column: Vec<f64>,
    row_largest: Vec<f64>,
    column_largest: Vec<f64>,
}

impl Equilibration {
    pub fn new(m: usize) -> Self {
        Self {
            row: vec![1.0; m],
            column: vec![1.0; m],
            inverse_column: vec![1.0; m],
            row_largest: vec![0.0; m],
            column_largest: vec![0.0; m],
        }
    }

    pub fn resize(&mut self, m: usize) {
        for vector in
            [&mut self.row, &mut self.column, &mut self.inverse_column, &mut self.row_largest, &mut self.column_largest]
        {
            vector.resize(m, 1.0);
        }
    }

    /// Chooses the scalings `R` and `C`. Returns false if the problem has an entry that is not finite, or an empty
    /// interval.
    pub fn fit(&mut self, vi: &AffineVi<'_>) -> bool {
        self.row.fill(1.0);
        self.column.fill(1.0);
        self.inverse_column.fill(1.0);
        if !vi.set.is_nonempty() || !self.survey(vi) {
            return false;
        }
        for _ in 0..SWEEPS {
            if self.row_largest.iter().chain(&self.column_largest).all(|&x| is_balanced(x)) {
                break;
            }
            for (scale, &largest) in self.row.iter_mut().zip(&self.row_largest) {
                *scale *= inverse_root(largest);
            }
            for (j, &largest) in self.column_largest.iter().enumerate() {
                self.column[j] *= inverse_root(largest);
                self.inverse_column[j] = 1.0 / self.column[j];
            }
            self.survey(vi);
        }
        true
    }

    /// Records the largest entry of each row and column of `R A C`; returns false if an entry is not finite.
    fn survey(&mut self, vi: &AffineVi<'_>) -> bool {
        let m = vi.q.len();
        // Add zero times each entry: the sum is zero unless an entry is infinite or NaN.
        let mut poison = 0.0;
        self.row_largest.fill(0.0);
        for j in 0..m {
            let column = &vi.matrix.as_slice()[j * m..][..m];
            let mut largest = 0.0;
            let scale = self.column[j];
            for ((&a, &r), row_largest) in column.iter().zip(&self.row).zip(&mut self.row_largest) {
                let size = (a * r * scale).abs();
                poison += size * 0.0;
                largest = if size > largest { size } else { largest };
                *row_largest = if size > *row_largest { size } else { *row_largest };
            }
            self.column_largest[j] = largest;
        }
        for &q in vi.q {
            poison += q * 0.0;
        }
        poison == 0.0
    }
}

fn is_balanced(largest: f64) -> bool {
    largest == 0.0 || (1.0 / BALANCED..=BALANCED).contains(&largest)
}

fn inverse_root(largest: f64) -> f64 {
    if largest == 0.0 { 1.0 } else { (-0.5 * largest.log2()).round().exp2() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use problem::ConvexSet;

    #[test]
    fn entries_far_apart_come_near_one_by_powers_of_two() {
        let matrix = DMatrix::from_row_slice(3, 3, &[1e9, 1.0, 0.0, 3.0, 1e-9, 0.0, 0.0, 0.0, 0.0]);
        let set = ConvexSet::nonnegative(3);
        let mut equilibration = Equilibration::new(3);
        assert!(equilibration.fit(&AffineVi { matrix: &matrix, q: &[1.0; 3], set: &set }));
        let (r, c) = (&equilibration.row, &equilibration.column);
        for i in 0..2 {
            let largest = (0..3).map(|j| matrix[(i, j)] * r[i] * c[j]).fold(0.0, f64::max);
            assert!(is_balanced(largest), "row {i} has {largest}");
            assert!(r[i].log2().fract() == 0.0 && c[i].log2().fract() == 0.0);
            assert!(c[i] * equilibration.inverse_column[i] == 1.0);
        }
        assert_eq!((r[2], c[2]), (1.0, 1.0));
    }
}
