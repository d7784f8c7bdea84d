//! Certificates of a solution of a variational inequality: whether it is unique, isolated, or one of a continuum. On
//! intervals, with `J = G'(z)`, `a` the variables inside their intervals and `b` those at a bound with `G = 0`:
//!
//! - `G` affine and `J` positive definite: unique (Facchinei and Pang 2003, theorem 2.3.3);
//! - `J_aa` regular and the Schur complement `J_bb - J_ba J_aa^-1 J_ab` a P-matrix: isolated (Robinson 1980,
//!   *Strongly regular generalized equations*), and, if `G` is affine and `J` positive semidefinite, so that solutions
//!   form a convex set, unique;
//! - `G` affine, `b` empty and `J_aa` singular: all points `z + s v` with `J_aa v = 0` near `z` are solutions. If `G`
//!   is not affine or `b` is not empty, other solutions may exist along `v`.

use super::worst::sizes_of_variables;
use factorisation::{Singular, equilibrated, least_eigenvalue, scale_of};
use nalgebra::DMatrix;
use problem::ConvexSet;

/// Rank tolerance: singular values or eigenvalues of a matrix of size `m` are zero below `ZERO m` times the largest.
const ZERO: f64 = 1e-11;
/// Relative tolerance for activity: a component is at a bound, or its `G` is zero, to within this fraction of the
/// size of its terms. Degenerate solutions of nonlinear problems are accurate to half of the digits only.
const REST: f64 = 1e-7;
/// Rounding tolerance for activity: a component is at a bound if its distance to the bound is below this fraction of
/// its size.
const ROUNDING: f64 = 1e-14;
/// Number of sweeps that scale a symmetric matrix until the largest entry of each row is one: each sweep takes the
/// square root of the imbalance.
const SWEEPS: usize = 8;
/// Largest number of degenerate variables (at a bound with `G = 0`) for which the P-matrix property is tested, by all
/// principal minors.
const MOST_UNDECIDED: usize = 12;
/// Largest number of variables for which certificates are computed, from singular values and vectors of dense
/// matrices.
pub const MOST_VARIABLES: usize = 400;

/// The reason why nothing is certified if the Jacobian with respect to the inactive variables is singular.
pub const SINGULAR: &str = "the derivative with respect to the inactive variables is singular";

/// What is certified about a solution of a variational inequality: that it is unique, isolated, or one of a continuum.
#[derive(Clone, Debug, PartialEq)]
pub enum Certificate {
    /// The solution is unique: the matrix of an affine `G` is positive definite. Holds the least eigenvalue of its
    /// symmetric part.
    Unique(f64),
    /// The solution is unique: it is isolated, and the matrix of an affine `G` is positive semidefinite.
    UniqueOfConvex,
    /// The solution is isolated. Holds the least singular value of the Jacobian `J_aa` with respect to the inactive
    /// variables, the number of inactive variables, and the number of variables at a bound with `G = 0`.
    Isolated(f64, usize, usize),
    /// The solution is one of a continuum of solutions, whose direction is held.
    Continuum(Vec<f64>),
    /// Nothing is certified, as the Jacobian with respect to the inactive variables is singular: if other solutions
    /// exist nearby, they lie along the direction held.
    Singular(Vec<f64>),
    /// Nothing is certified, for the reason held.
    Nothing(&'static str),
}

/// Computes the certificate of the solution `z` with `g = G(z)` and the Jacobian `J = G'(z)`; `terms` are the sizes
/// of the terms that the components of `g` sum up.
pub fn certificate(
    jacobian: &DMatrix<f64>,
    is_affine: bool,
    (z, g): (&[f64], &[f64]),
    terms: &[f64],
    set: &ConvexSet,
) -> Certificate {
    let m = z.len();
    if m > MOST_VARIABLES {
        return Certificate::Nothing("there are too many variables to compute all singular values");
    }
    let definite = least_relative_eigenvalue(jacobian);
    if is_affine && definite > ZERO * m as f64 {
        let symmetric = (jacobian + jacobian.transpose()) * 0.5;
        return Certificate::Unique(least_eigenvalue(&symmetric).unwrap_or(f64::NAN));
    }
    if set.has_blocks() {
        return Certificate::Nothing("its set couples variables, and G is not certified monotone");
    }
    let (mut inside, mut undecided) = (Vec::new(), Vec::new());
    let places = (0..m).flat_map(|j| (0..m).map(move |i| (i, j)));
    let sizes = sizes_of_variables(terms, places.map(|place| (place, jacobian[place])));
    for i in 0..m {
        let distance = (z[i] - set.lower[i]).abs().min((z[i] - set.upper[i]).abs());
        let distance = distance / (sizes[i].min(1.0) + z[i].abs());
        let is_zero = g[i].abs() <= REST * terms[i].max(f64::MIN_POSITIVE);
        match (distance <= REST, is_zero) {
            _ if set.lower[i] == set.upper[i] => {}
            (false, _) => inside.push(i),
            (true, true) if distance > ROUNDING => {
                return Certificate::Nothing(
                    "a variable is so near to a bound, with G = 0, that it is undecided whether it is at the bound",
                );
            }
            (true, true) => undecided.push(i),
            (true, false) => {}
        }
    }
    let part = |rows: &[usize], columns: &[usize]| jacobian.select_rows(rows).select_columns(columns);
    // Scale rows and columns to a common size, so that entries that are small only in their units do not count as
    // zero.
    let unit = |size: f64| if size > 0.0 && size.is_finite() { size } else { 1.0 };
    let mut own = part(&inside, &inside);
    own.row_iter_mut().zip(&inside).for_each(|(mut row, &i)| row /= unit(terms[i]));
    own.column_iter_mut().zip(&inside).for_each(|(mut column, &i)| column *= unit(sizes[i]));
    let (own, _, of_columns) = equilibrated(own);
    let Some(own) = Singular::of(&own) else {
        return Certificate::Nothing("the singular values of its Jacobian could not be computed");
    };
    let is_regular = own.rank(ZERO * m as f64) == inside.len();
    let is_convex = is_affine && definite >= -ZERO * m as f64;
    if !is_regular {
        let Some(last) = own.v_t.nrows().checked_sub(1) else { return Certificate::Nothing(SINGULAR) };
        let mut direction = vec![0.0; m];
        let along = own.v_t.row(last).into_owned();
        inside
            .iter()
            .zip(along.iter().zip(of_columns))
            .for_each(|(&i, (v, scale))| direction[i] = v * scale * unit(sizes[i]));
        let is_zero = |&i: &usize| {
            let products = inside.iter().map(|&j| jacobian[(i, j)] * direction[j]);
            let (sum, terms) =
                products.fold((0.0, 0.0), |(sum, terms), product| (sum + product, terms + product.abs()));
            f64::abs(sum) <= ZERO * m as f64 * terms
        };
        return match is_affine && undecided.is_empty() && inside.iter().all(is_zero) {
            true => Certificate::Continuum(direction),
            false => Certificate::Singular(direction),
        };
    }
    if undecided.len() > MOST_UNDECIDED {
        return Certificate::Nothing("many variables are at a bound with G = 0");
    }
    let mut schur = part(&undecided, &undecided);
    if !inside.is_empty() && !undecided.is_empty() {
        let Some(correction) = part(&inside, &inside).lu().solve(&part(&inside, &undecided)) else {
            return Certificate::Nothing(SINGULAR);
        };
        schur -= part(&undecided, &inside) * correction;
    }
    if !is_p_matrix(&schur) {
        return Certificate::Nothing("variables at a bound have G = 0, and may leave it in several ways");
    }
    match is_convex {
        true => Certificate::UniqueOfConvex,
        false => {
            let least = Singular::of(&part(&inside, &inside)).and_then(|own| own.values.last().copied());
            Certificate::Isolated(least.unwrap_or(f64::INFINITY), inside.len(), undecided.len())
        }
    }
}

/// Returns the least eigenvalue of `D S D`, where `S` is the symmetric part of a matrix `J` and the diagonal `D`
/// scales the largest entry of each row to one: its sign is that of the least eigenvalue of `S`, in any units.
/// Returns NaN if an entry is not finite.
pub fn least_relative_eigenvalue(matrix: &DMatrix<f64>) -> f64 {
    let mut symmetric = (matrix + matrix.transpose()) * 0.5;
    for _ in 0..SWEEPS {
        let scale: Vec<f64> = symmetric.row_iter().map(|row| scale_of(row.amax()).sqrt()).collect();
        symmetric.row_iter_mut().zip(&scale).for_each(|(mut row, scale)| row *= *scale);
        symmetric.column_iter_mut().zip(&scale).for_each(|(mut column, scale)| column *= *scale);
    }
    least_eigenvalue(&symmetric).unwrap_or(f64::NAN)
}

/// Whether all principal minors of a small matrix are positive.
fn is_p_matrix(matrix: &DMatrix<f64>) -> bool {
    let k = matrix.nrows();
    (1_usize..1 << k).all(|subset| {
        let members: Vec<usize> = (0..k).filter(|i| subset >> i & 1 == 1).collect();
        matrix.select_rows(&members).select_columns(&members).determinant() > 0.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(jacobian: &[f64], is_affine: bool, z: &[f64], g: &[f64]) -> Certificate {
        let m = z.len();
        let jacobian = DMatrix::from_row_slice(m, m, jacobian);
        certificate(&jacobian, is_affine, (z, g), &vec![1.0; m], &ConvexSet::nonnegative(m))
    }

    #[test]
    fn definite_regular_and_singular_matrices_are_told_apart() {
        assert!(matches!(of(&[2.0, 1.0, -1.0, 1.0], true, &[1.0, 1.0], &[0.0, 0.0]), Certificate::Unique(_)));
        assert_eq!(of(&[1.0, 0.0, 0.0, 0.0], true, &[1.0, 0.0], &[0.0, 2.0]), Certificate::UniqueOfConvex);
        // The non-monotone `w = (z2 - 1, z1 - 1)` has the solution (1, 1), and no other near it.
        assert!(matches!(of(&[0.0, 1.0, 1.0, 0.0], true, &[1.0, 1.0], &[0.0; 2]), Certificate::Isolated(_, 2, 0)));
        // The singular problem with `w1 = w2 = z1 + z2 - 2` has the line z1 + z2 = 2 of solutions.
        let Certificate::Continuum(v) = of(&[1.0; 4], true, &[1.5, 0.5], &[0.0; 2]) else { panic!("a continuum") };
        assert!((v[0] + v[1]).abs() < 1e-12 && v[0].abs() > 0.5);
        // Entries of a regular matrix that are small only in their units do not count as zero.
        let small = of(&[1e-9, 2.0, -1.0, 1e-9], true, &[3.0, 2.0], &[0.0; 2]);
        assert!(matches!(small, Certificate::Isolated(_, 2, 0)), "{small:?}");
        let small = of(&[-1e-9, 0.0, 0.0, 1e9], true, &[3.0, 2.0], &[0.0; 2]);
        assert!(matches!(small, Certificate::Isolated(_, 2, 0)), "{small:?}");
        // A variable at its bound with `G = 0` is not certified; with `G > 0` at all bounds the solution is isolated.
        assert!(matches!(of(&[0.0], true, &[0.0], &[0.0]), Certificate::Nothing(_)));
        assert_eq!(of(&[1.0, 2.0, 2.0, 1.0], false, &[0.0; 2], &[3.0; 2]), Certificate::Isolated(f64::INFINITY, 0, 0));
        // For `w = -z` at `z = 0` the matrix is no P-matrix, so that nothing is certified.
        assert!(matches!(of(&[-1.0], true, &[0.0], &[0.0]), Certificate::Nothing(_)));
    }
}
