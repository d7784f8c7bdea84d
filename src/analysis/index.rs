//! The index of a differential variational inequality: the number of differentiations of `G` until it determines `z`.
//!
//! The structure algorithm (Silverman 1969) on `x' = A x + B z, G = C x + D z`: rows of `D` that depend on other rows
//! are combined to zero, the remaining `C~ x` of those rows is differentiated to `C~ A x + C~ B z`, and so on until
//! the matrix of `z` is regular. With `D` regular the index is 0, with `D = 0` and `C B` regular 1, with `C B = 0`
//! and `C A B` regular 2; a mixed index is found by blocks.

use super::linearisation::{Linearisation, RANK};
use factorisation::{Singular, equilibrated};
use nalgebra::DMatrix;

/// Maximum number of times that the structure algorithm differentiates the inequality functions `G` in time.
const MOST_DIFFERENTIATIONS: usize = 8;

/// The differentiation index of a linearised problem, computed by the structure algorithm: how many variables `z` each
/// time derivative of `G` determines.
#[derive(Clone, Debug, PartialEq)]
pub struct Index {
    /// The number of variables `z` that each time derivative of `G` determines, `G` itself first.
    pub levels: Vec<usize>,
    /// The number of variables `z` that no time derivative of `G` determines.
    pub undetermined: usize,
}

impl Index {
    /// Returns the differentiation index: the number of time derivatives of `G` after which all variables `z` are
    /// determined; `None` if no number suffices.
    pub fn value(&self) -> Option<usize> {
        (self.undetermined == 0).then(|| self.levels.len().saturating_sub(1))
    }
}

/// Computes the differentiation index of a linearised problem; `None` if a product of its matrices overflows.
pub fn index(linearisation: &Linearisation) -> Option<Index> {
    let m = linearisation.variables();
    let (mut c, mut d) = (linearisation.c.clone(), linearisation.d.clone());
    let size = linearisation.b.amax();
    let mut levels = Vec::new();
    let mut determined = 0;
    while m > 0 && levels.len() <= MOST_DIFFERENTIATIONS {
        equilibrate(&mut c, &mut d);
        let (scaled, of_rows, _) = equilibrated(d.clone());
        let range = Singular::of(&scaled)?;
        let (rank, mut combinations) = (range.rank(RANK), range.u.transpose());
        combinations.column_iter_mut().zip(of_rows).for_each(|(mut column, scale)| column.scale_mut(scale));
        levels.push(rank - determined);
        determined = rank;
        if rank == m {
            break;
        }
        // Rows `rank..` of the rotated inequality functions `G = C x + D z` do not contain `z`: differentiate them in
        // time.
        let rotated = &combinations * &d;
        let mut states = combinations * &c;
        let rest = states.rows(rank, m - rank).into_owned();
        let mut next = rotated.clone();
        let mut product = &rest * &linearisation.b;
        for (i, mut row) in product.row_iter_mut().enumerate() {
            if row.amax() <= RANK * rest.row(i).amax() * size {
                row.fill(0.0);
            }
        }
        next.rows_mut(rank, m - rank).copy_from(&product);
        states.rows_mut(rank, m - rank).copy_from(&(rest * &linearisation.a));
        (c, d) = (states, next);
    }
    while levels.len() > 1 && levels.last() == Some(&0) {
        levels.pop();
    }
    Some(Index { levels, undetermined: m - determined })
}

/// Scales each row of `(C, D)` in `G = C x + D z` by the size of its part in `D`, or in `C` if that in `D` vanishes, so
/// that ranks do not depend on units.
fn equilibrate(c: &mut DMatrix<f64>, d: &mut DMatrix<f64>) {
    for i in 0..d.nrows() {
        let size = if d.row(i).amax() > 0.0 { d.row(i).amax() } else { c.row(i).amax() };
        if size > 0.0 && size.is_finite() {
            c.row_mut(i).unscale_mut(size);
            d.row_mut(i).unscale_mut(size);
        }
    }
}
