//! Passive systems `x' = A x + B z, G = C x + D z`. Let `V = dx^T P dx / 2` for the difference `(dx, dz)` of two
//! solutions. With `<dz, dG> <= 0`,
//!
//! ```text
//! V' <= dx^T P A dx + dz^T (B^T P - C) dx - dz^T D dz
//! ```
//!
//! is at most a multiple of `V`, so that `dx` remains zero, if the terms with `dz` are bounded from above by
//! `|dx|^2`: if `D` is positive semidefinite and `B^T P = C` on the kernel of `D + D^T`. With a basis `N` of that
//! kernel, a symmetric positive definite `P` exists if and only if `N^T C B N` is symmetric positive semidefinite and
//! has the rank and the kernel of `B N` and of `C^T N` (Camlibel and Schumacher 2016, Linear passive systems and
//! maximal monotone mappings; Camlibel, Heemels, Schumacher 2002, On linear passive complementarity systems).
//!
//! A network of resistors, capacitors, inductors and diodes is passive in any of its formulations, with the
//! capacitances and inductances as `P`.

use super::linearisation::{Linearisation, RANK};
use factorisation::{Singular, least_eigenvalue};
use nalgebra::{DMatrix, DVector};
use std::fmt;

/// Rounding error of the entries and eigenvalues of the product `C B` of the linearised problem, relative to its
/// largest entry.
const ROUNDING: f64 = 1e-9;

/// The eigenvalues that certify that the linearised system is passive from `z` to `G`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Passivity {
    /// The least eigenvalue of the symmetric part of `D = dG/dz`.
    of_d: f64,
    /// The least eigenvalue of the symmetric part of `C B` on the kernel of `D + D^T`; `None` if the kernel is zero.
    of_cb: Option<f64>,
}

impl fmt::Display for Passivity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { of_d, of_cb } = self;
        write!(
            f,
            "the system is passive and x is unique: D is positive semidefinite (least eigenvalue of its symmetric \
                   part {of_d:.3e})"
        )?;
        match of_cb {
            Some(least) => write!(
                f,
                " and, on the kernel of D + D^T, CB symmetric positive semidefinite (least eigenvalue {least:.3e}) with the \
                 kernels of B and C^T"
            ),
            None => write!(f, " and D + D^T regular"),
        }
    }
}

/// Returns the eigenvalues that certify that the linearised system is passive from `z` to `G`, up to a shift of `A`;
/// `None` if it is not, or if a product of its matrices overflows.
pub(super) fn passivity(problem: &Linearisation) -> Option<Passivity> {
    let symmetric = &problem.d * 0.5 + problem.d.transpose() * 0.5;
    let of_d = least_eigenvalue(&symmetric)?;
    // Scale each variable `z_i` so that its diagonal entry of `D`, or else of `C B`, is one.
    let cb = &problem.c * &problem.b;
    let size = problem.d.amax();
    let unit = |k: usize| match (symmetric[(k, k)], cb[(k, k)]) {
        (d, _) if d > RANK * size => 1.0 / d.sqrt(),
        (_, cb) if cb > 0.0 => 1.0 / cb.sqrt(),
        _ => 1.0,
    };
    let units = DMatrix::from_diagonal(&DVector::from_fn(problem.variables(), |k, _| unit(k)));
    let scaled = &units * &symmetric * &units;
    if least_eigenvalue(&scaled)? < -RANK * scaled.amax().max(f64::MIN_POSITIVE) {
        return None;
    }
    let singular = Singular::of(&scaled)?;
    let kept: Vec<usize> = (0..singular.values.len()).filter(|&i| singular.values[i] <= RANK * scaled.amax()).collect();
    if kept.is_empty() {
        return Some(Passivity { of_d, of_cb: None });
    }
    let kernel = &units * singular.v_t.select_rows(&kept).transpose();
    if !has_storage(&problem.b * &kernel, kernel.tr_mul(&problem.c)) {
        return None;
    }
    // The eigenvalue of `C B` for the report is that in the user's units if the kernel of `D + D^T` is the whole space.
    let cb = if kept.len() == problem.variables() { cb } else { kernel.tr_mul(&cb) * kernel };
    let of_cb = least_eigenvalue(&(&cb * 0.5 + cb.transpose() * 0.5))?;
    Some(Passivity { of_d: of_d.max(0.0), of_cb: Some(of_cb.max(0.0)) })
}

/// Returns whether the system has a quadratic storage function, `P B = C^T` for some symmetric positive definite `P`:
/// whether `C B` is symmetric positive semidefinite with the rank of `B` and `C`, and `B` and `C^T` have the same
/// kernel.
fn has_storage(mut b: DMatrix<f64>, mut c: DMatrix<f64>) -> bool {
    let n = b.nrows();
    // Scale each state so that its row in `B` and its row in `C^T` have equal norms.
    for i in 0..n {
        let (column, row) = (c.column(i).norm(), b.row(i).norm());
        if column > 0.0 && row > 0.0 {
            let unit = (column / row).sqrt();
            b.row_mut(i).scale_mut(unit);
            c.column_mut(i).unscale_mut(unit);
        }
    }
    let cb = &c * &b;
    let asymmetry = (&cb - cb.transpose()).amax();
    let least = least_eigenvalue(&(&cb * 0.5 + cb.transpose() * 0.5));
    if asymmetry > ROUNDING * cb.amax() || least.is_none_or(|least| least < -ROUNDING * cb.amax()) {
        return false;
    }
    let rank_of = |matrix: &DMatrix<f64>| Singular::of(matrix).map(|singular| singular.rank(RANK));
    let (size_of_b, size_of_c) = (size(&b), size(&c));
    let stacked =
        DMatrix::from_fn(
            2 * n,
            b.ncols(),
            |i, j| {
                if i < n { b[(i, j)] / size_of_b } else { c[(j, i - n)] / size_of_c }
            },
        );
    let rank = rank_of(&cb);
    rank.is_some() && [&b, &c, &stacked].into_iter().all(|matrix| rank_of(matrix) == rank)
}

/// Returns the largest absolute entry of the matrix, or one if all entries are zero.
fn size(matrix: &DMatrix<f64>) -> f64 {
    let size = matrix.amax();
    if size > 0.0 { size } else { 1.0 }
}
