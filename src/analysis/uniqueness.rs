//! Existence and uniqueness, as far as the derivatives certify them (Stewart 2011, chapters 4 to 6; Pang and Stewart 2008,
//! Differential variational inequalities; Camlibel, Heemels, Schumacher 2002).
//!
//! - `D` positive semidefinite and `P B = C^T` for a symmetric positive definite `P` (a passive system): for two
//!   solutions `d/dt (dx^T P dx)/2 <= const |dx|^2`, so `x` is unique. With `D = 0` that is `C B` symmetric positive
//!   definite, or semidefinite with the kernels of `B` and `C^T`.
//! - `D` a P-matrix: `z` is a Lipschitz function of `(t, x)`, so both are unique.
//! - `D = 0`, `K` an orthant and `C B` an H-matrix with positive diagonal: the reflection map is Lipschitz (Harrison and
//!   Reiman 1981; Dupuis and Ishii 1991), so `x` is unique.
//! - `D = 0`, `C B` positive definite or a P-matrix but not symmetric: a solution exists; it need not be unique
//!   (Mandelbaum; Bernard and El Kharroubi 1991).

use super::index::Index;
use super::linearisation::{Linearisation, RANK};
use factorisation::{Singular, least_eigenvalue};
use nalgebra::DMatrix;
use serde::Serialize;

/// What is certified.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Uniqueness {
    /// The solution is unique.
    Unique,
    /// A solution exists, but uniqueness is not guaranteed.
    ExistsNotCertified,
    /// Neither is certified.
    NotCertified,
    /// Solutions are not unique in general.
    NotUnique,
    /// Nothing was analysed.
    NotAnalysed,
}

impl std::fmt::Display for Uniqueness {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Unique => "unique",
            Self::ExistsNotCertified => "a solution exists, not certified to be unique",
            Self::NotCertified => "not certified",
            Self::NotUnique => "not unique",
            Self::NotAnalysed => "not analysed",
        })
    }
}

/// Up to this order all principal minors are looked at.
const MOST_MINORS: usize = 12;

/// The verdict and why; `None` if a product of the derivatives overflows.
pub fn uniqueness(problem: &Linearisation, index: &Index) -> Option<(Uniqueness, String)> {
    let m = problem.variables();
    if m == 0 {
        return Some((Uniqueness::Unique, "there are no variables: an ordinary differential equation".into()));
    }
    let place = if problem.is_constant { "" } else { " at this time" };
    if problem.free.iter().all(|&free| free) {
        return Some(match index.value() {
            Some(value) => (
                Uniqueness::Unique,
                format!(
                    "every variable is free, and G differentiated {value} times determines them: a regular \
                     differential-algebraic equation, of differentiation index {}{place}",
                    value + 1
                ),
            ),
            None => (
                Uniqueness::NotUnique,
                format!("no differentiation of G determines {} of the {m} free variables{place}", index.undetermined),
            ),
        });
    }
    if problem.set_moves_with_states {
        let because = "K moves with the states (a quasi-variational inequality): no theorem at hand covers it";
        return Some((Uniqueness::NotCertified, because.into()));
    }
    let cb = &problem.c * &problem.b;
    let (d, figures) = (Figures::of(&problem.d)?, Figures::of(&cb)?);
    if d.least_eigenvalue >= -RANK * d.size && is_passive(problem, &cb, &figures) {
        return Some((
            Uniqueness::Unique,
            format!(
                "D is positive semidefinite (least eigenvalue of its symmetric part {:.3e}) and CB symmetric positive \
                 semidefinite (least eigenvalue {:.3e}) with the kernels of B and C^T{place}: the system is passive and x \
                 is unique",
                d.least_eigenvalue.max(0.0),
                figures.least_eigenvalue.max(0.0)
            ),
        ));
    }
    Some(match index.value() {
        Some(0) => index_zero(problem, &d, place),
        Some(1) if d.size == 0.0 => index_one(&cb, &figures, problem.is_orthant, place),
        Some(value) => (
            Uniqueness::NotCertified,
            format!("the index is {value} by parts {:?}{place}: no theorem at hand covers the mixture", index.levels),
        ),
        None => (
            Uniqueness::NotCertified,
            format!(
                "no differentiation of G determines {} of the {m} variables{place}: where none of them rests on a bound z is \
                 not determined, though x may be",
                index.undetermined
            ),
        ),
    })
}

fn index_zero(problem: &Linearisation, d: &Figures, place: &str) -> (Uniqueness, String) {
    let least = d.least_eigenvalue;
    if least > 0.0 {
        return (
            Uniqueness::Unique,
            format!(
                "G_z is positive definite{place} (least eigenvalue of its symmetric part {least:.3e}): z is a Lipschitz function of (t, x)"
            ),
        );
    }
    match is_p_matrix(&problem.d) {
        Some(true) => (
            Uniqueness::Unique,
            format!(
                "G_z is a P-matrix{place} (its symmetric part has least eigenvalue {least:.3e}): z is a Lipschitz \
                 function of (t, x)"
            ),
        ),
        Some(false) => (
            Uniqueness::NotCertified,
            format!("G_z is regular but no P-matrix{place} (least eigenvalue of its symmetric part {least:.3e})"),
        ),
        None => (
            Uniqueness::NotCertified,
            format!(
                "G_z is regular{place}, its symmetric part has least eigenvalue {least:.3e}; {} variables are too many to test for a P-matrix",
                problem.variables()
            ),
        ),
    }
}

fn index_one(cb: &DMatrix<f64>, figures: &Figures, is_orthant: bool, place: &str) -> (Uniqueness, String) {
    let p = match is_p_matrix(cb) {
        Some(true) => "a P-matrix",
        Some(false) => "no P-matrix",
        None => "too large to test for a P-matrix",
    };
    let &Figures { least_eigenvalue: least, asymmetry, .. } = figures;
    let described = format!(
        "CB{place} is {p}, its symmetric part has least eigenvalue {least:.3e}, its asymmetry |CB - (CB)^T|/|CB| is \
         {asymmetry:.3e}"
    );
    if is_orthant && is_h_matrix(cb) {
        let because =
            "the reflection map of an H-matrix with positive diagonal is Lipschitz, so the solution is unique";
        return (Uniqueness::Unique, format!("{described}: {because}"));
    }
    if least > 0.0 || is_p_matrix(cb) == Some(true) {
        (
            Uniqueness::ExistsNotCertified,
            format!("{described}: a solution exists; uniqueness needs CB symmetric positive definite"),
        )
    } else {
        (
            Uniqueness::NotCertified,
            format!(
                "{described}: solutions need not exist nor be unique; among several, the one on the path of the VI solver from \
                 the last values is taken"
            ),
        )
    }
}

/// Whether the comparison matrix (`|a_ii|` on the diagonal, `-|a_ij|` off it) is a nonsingular M-matrix, and the diagonal
/// positive: then the inverse of the comparison matrix is nonnegative.
fn is_h_matrix(matrix: &DMatrix<f64>) -> bool {
    if matrix.diagonal().iter().any(|&diagonal| diagonal <= 0.0) {
        return false;
    }
    let comparison =
        DMatrix::from_fn(
            matrix.nrows(),
            matrix.ncols(),
            |i, j| {
                if i == j { matrix[(i, j)] } else { -matrix[(i, j)].abs() }
            },
        );
    comparison.try_inverse().is_some_and(|inverse| inverse.iter().all(|&entry| entry >= 0.0))
}

/// Whether `P B = C^T` for some symmetric positive definite `P`: `C B` symmetric positive semidefinite, with the rank of
/// `B` and `C`, and `B` and `C^T` with one kernel.
fn is_passive(problem: &Linearisation, cb: &DMatrix<f64>, figures: &Figures) -> bool {
    // Units of G and of x' may differ by any factor a row: compare what is left with its terms.
    let tolerance = 1e-9;
    if figures.asymmetry > tolerance || figures.least_eigenvalue < -tolerance * figures.size {
        return false;
    }
    let rank_of = |matrix: &DMatrix<f64>| Singular::of(matrix).map(|singular| singular.rank(RANK));
    let n = problem.states();
    let (b, c) = (norm(&problem.b), norm(&problem.c));
    let stacked = DMatrix::from_fn(2 * n, problem.variables(), |i, j| {
        if i < n { problem.b[(i, j)] / b } else { problem.c[(j, i - n)] / c }
    });
    let rank = rank_of(cb);
    rank.is_some() && [&problem.b, &problem.c, &stacked].into_iter().all(|matrix| rank_of(matrix) == rank)
}

fn norm(matrix: &DMatrix<f64>) -> f64 {
    let size = matrix.amax();
    if size > 0.0 { size } else { 1.0 }
}

/// What decides of a square matrix.
struct Figures {
    /// The largest entry.
    size: f64,
    /// The least eigenvalue of the symmetric part.
    least_eigenvalue: f64,
    /// `|A - A^T| / |A|`
    asymmetry: f64,
}

impl Figures {
    /// `None` if an entry is not finite.
    fn of(matrix: &DMatrix<f64>) -> Option<Self> {
        // Halved first: the sum of two large entries need not overflow.
        let symmetric = matrix * 0.5 + matrix.transpose() * 0.5;
        let size = matrix.amax();
        let asymmetry = if size > 0.0 { (matrix / size - matrix.transpose() / size).amax() } else { 0.0 };
        Some(Self { size, least_eigenvalue: least_eigenvalue(&symmetric)?, asymmetry })
    }
}

/// Whether all principal minors are positive; `None` where there are too many of them.
fn is_p_matrix(matrix: &DMatrix<f64>) -> Option<bool> {
    let m = matrix.nrows();
    if m > MOST_MINORS {
        return None;
    }
    Some((1_usize..1 << m).all(|subset| {
        let members: Vec<usize> = (0..m).filter(|i| subset & (1 << i) != 0).collect();
        DMatrix::from_fn(members.len(), members.len(), |i, j| matrix[(members[i], members[j])]).determinant() > 0.0
    }))
}
