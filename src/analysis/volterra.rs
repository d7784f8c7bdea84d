//! Analysis of Volterra inequalities `z in K, <(m * z)(t) + q(t), z~ - z> >= 0` with a kernel `m(t) ~ M t^(a-1)` near
//! `t = 0`. The index is `a` (Stewart 2011, Dynamics with Inequalities, section 5.4):
//!
//! - `a < 1`: `t^(a-1)` has the Laplace transform `Gamma(a) s^-a`, and on the imaginary axis the convolution is as
//!   positive as `cos(pi a/2) S + i sin(pi a/2) N`, with the symmetric part `S` and the skew part `N` of `M`: if this
//!   Hermitian matrix is positive definite, the difference of two solutions is zero;
//! - `a = 1`: `M` symmetric and positive definite is sufficient for uniqueness;
//! - `1 < a <= 2`: solutions exist and need not be unique (Stewart 2014, Nonuniqueness and fractional index
//!   convolution complementarity problems).

use super::{Analysis, MOST_UNKNOWNS, Uniqueness};
use factorisation::least_eigenvalue;
use nalgebra::DMatrix;
use std::f64::consts::FRAC_PI_2;

/// Relative rounding error of eigenvalues of a matrix: those below this fraction of its largest entry are treated as
/// zero.
const ROUNDING: f64 = 1e-12;

/// Returns the analysis of a Volterra inequality whose kernel behaves like `M t^(a-1)` near zero, with the index `a` in
/// `(0, 2]` and the matrix `M`.
pub fn analyse_memory(a: f64, matrix: &DMatrix<f64>) -> Analysis {
    let m = matrix.nrows();
    let levels = if a.fract() == 0.0 { [vec![0; a as usize], vec![m]].concat() } else { Vec::new() };
    let told = |uniqueness, because| Analysis {
        index: Some(a),
        levels: levels.clone(),
        uniqueness,
        because,
        ..Analysis::default()
    };
    if m > MOST_UNKNOWNS {
        let because = format!("the problem has {m} variables, and at most {MOST_UNKNOWNS} are analysed");
        return told(Uniqueness::NotAnalysed, because);
    }
    let symmetric = 0.5 * (matrix + matrix.transpose());
    let skew = 0.5 * (matrix - matrix.transpose());
    let (Some(least), Some(positivity)) = (least_eigenvalue(&symmetric), positivity(a, &symmetric, &skew)) else {
        return told(
            Uniqueness::NotAnalysed,
            "the eigenvalues of the kernel's matrix could not be computed".to_owned(),
        );
    };
    let rounding = ROUNDING * matrix.amax();
    let head = format!("near zero the kernel is M t^(a-1) with a = {a}, the index");
    let definite = format!("(M + M^T)/2 has the least eigenvalue {least:.3e}");
    let is_symmetric = skew.amax() <= rounding;
    if least <= rounding {
        return told(Uniqueness::NotCertified, format!("{head}; {definite}, so that M is not positive definite"));
    }
    if a > 1.0 {
        let because = format!(
            "{head}; {definite}: solutions exist, but above index 1 there are problems with several (Stewart 2014)"
        );
        return told(Uniqueness::ExistsNotCertified, because);
    }
    if a == 1.0 {
        return if is_symmetric {
            told(Uniqueness::Unique, format!("{head}; M is symmetric, its least eigenvalue is {least:.3e}"))
        } else {
            let because = format!("{head}; {definite}, but M is not symmetric, which uniqueness needs at index 1");
            told(Uniqueness::ExistsNotCertified, because)
        };
    }
    let figure = format!("cos(pi a/2) S + i sin(pi a/2) N has the least eigenvalue {positivity:.3e}");
    if positivity > rounding {
        told(Uniqueness::Unique, format!("{head}; {figure}: the convolution is strictly positive"))
    } else {
        told(Uniqueness::ExistsNotCertified, format!("{head}; {definite}, but {figure}: M is too far from symmetric"))
    }
}

/// Computes the least eigenvalue of the Hermitian matrix `cos(pi a/2) S + i sin(pi a/2) N`, where `S` and `N` are the
/// symmetric and the skew part of the kernel's matrix at zero, from a real symmetric matrix of twice the size.
fn positivity(a: f64, symmetric: &DMatrix<f64>, skew: &DMatrix<f64>) -> Option<f64> {
    let m = symmetric.nrows();
    let (sine, cosine) = (FRAC_PI_2 * a).sin_cos();
    let real = DMatrix::from_fn(2 * m, 2 * m, |i, j| match (i < m, j < m) {
        (true, false) => -sine * skew[(i, j - m)],
        (false, true) => sine * skew[(i - m, j)],
        _ => cosine * symmetric[(i % m, j % m)],
    });
    least_eigenvalue(&real)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(a: f64, entries: [f64; 4]) -> Uniqueness {
        analyse_memory(a, &DMatrix::from_row_slice(2, 2, &entries)).uniqueness
    }

    #[test]
    fn symmetric_and_positive_definite_is_unique_up_to_index_one() {
        let matrix = [2.0, 1.0, 1.0, 2.0];
        for (a, expected) in [
            (0.25, Uniqueness::Unique),
            (1.0, Uniqueness::Unique),
            (1.5, Uniqueness::ExistsNotCertified),
            (2.0, Uniqueness::ExistsNotCertified),
        ] {
            assert_eq!(verdict(a, matrix), expected, "index {a}");
        }
        assert_eq!(verdict(0.5, [1.0, 2.0, 2.0, 1.0]), Uniqueness::NotCertified);
    }

    #[test]
    fn the_skew_part_counts_the_more_the_higher_the_index() {
        // For a kernel matrix with the symmetric part `S = I` and the skew part `N = k [[0, 1], [-1, 0]]`, the
        // eigenvalues are `cos(pi a/2) +- k sin(pi a/2)`, so that they are positive for `a < (2/pi) atan(1/k)`.
        let matrix = [1.0, 1.0, -1.0, 1.0];
        assert_eq!(verdict(0.49, matrix), Uniqueness::Unique);
        assert_eq!(verdict(0.51, matrix), Uniqueness::ExistsNotCertified);
        assert_eq!(verdict(1.0, matrix), Uniqueness::ExistsNotCertified);
    }
}
