//! Existence and uniqueness of solutions of `x' = A x + B z, G = C x + D z`, as far as the matrices certify them
//! (Stewart 2011, chapters 4 to 6; Pang and Stewart 2008, Differential variational inequalities; Camlibel, Heemels,
//! Schumacher 2002).
//!
//! - `D` positive semidefinite and `P B N = C^T N` for a symmetric positive definite `P` and a basis `N` of the
//!   kernel of `D + D^T` (a system that is passive up to a shift; Camlibel and Schumacher 2016, Linear passive
//!   systems and maximal monotone mappings): `x` is unique, see [`passivity`](super::passivity).
//! - `D` a P-matrix: `z` is a Lipschitz function of `(t, x)`, so both `x` and `z` are unique.
//! - `D = 0`, `K` an orthant and `C B` an H-matrix with positive diagonal: the reflection map is Lipschitz (Harrison
//!   and Reiman 1981; Dupuis and Ishii 1991), so `x` is unique.
//! - `D = 0`, `C B` positive definite or a P-matrix but not symmetric: a solution exists; it need not be unique
//!   (Mandelbaum; Bernard and El Kharroubi 1991).

use super::index::Index;
use super::linearisation::Linearisation;
use super::passivity::passivity;
use factorisation::least_eigenvalue;
use nalgebra::DMatrix;
use serde::Serialize;

/// The verdict on existence and uniqueness of the solution, as far as the analysis certifies it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Uniqueness {
    /// The solution of the problem is unique.
    Unique,
    /// The solution of the problem is unique until it reaches a point where the equations are not Lipschitz.
    LocallyUnique,
    /// A solution of the problem exists, but its uniqueness is not guaranteed.
    ExistsNotCertified,
    /// The analysis certifies neither existence nor uniqueness.
    NotCertified,
    /// Solutions of the problem are not unique in general.
    NotUnique,
    /// The problem was not analysed: it is too large, or its matrices are not finite or overflow.
    #[default]
    NotAnalysed,
}

impl Uniqueness {
    /// Returns whether the verdict certifies that the solution is unique, at least for a finite time.
    pub fn is_certified(self) -> bool {
        matches!(self, Self::Unique | Self::LocallyUnique)
    }
}

impl std::fmt::Display for Uniqueness {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Unique => "unique",
            Self::LocallyUnique => "locally unique",
            Self::ExistsNotCertified => "a solution exists, not certified to be unique",
            Self::NotCertified => "not certified",
            Self::NotUnique => "not unique",
            Self::NotAnalysed => "not analysed",
        })
    }
}

/// Maximum order of a matrix for which all principal minors are computed, to decide whether it is a P-matrix.
const MOST_MINORS: usize = 12;

/// Returns the verdict on existence and uniqueness of a linearised problem and its reason; `None` if a product of the
/// matrices overflows.
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
        let because = "K moves with the states (a quasi-variational inequality): no theorem applied here covers it";
        return Some((Uniqueness::NotCertified, because.into()));
    }
    // Eliminate linear invariants and free variables first, so that the verdict on uniqueness does not depend on the
    // formulation.
    let differing = problem.without_invariants();
    let problem = differing.as_ref().unwrap_or(problem);
    let eliminated = problem.without_free();
    let (problem, index) = match &eliminated {
        Some(reduced) => (reduced, &super::index(reduced)?),
        None => (problem, index),
    };
    let m = problem.variables();
    let (d, cb) = (Figures::of(&problem.d)?, &problem.c * &problem.b);
    let figures = Figures::of(&cb)?;
    if let Some(passivity) = passivity(problem) {
        return Some((Uniqueness::Unique, passivity.to_string() + place));
    }
    Some(match index.value() {
        Some(0) => index_zero(problem, &d, place),
        Some(1) if d.size == 0.0 => {
            index_one(&cb, &figures, problem.is_orthant && !problem.free.contains(&true), place)
        }
        Some(value) if value > 1 && index.levels[..value].iter().all(|&determined| determined == 0) => (
            Uniqueness::NotCertified,
            format!("the index is {value}{place}: no theorem applied here covers an index above one"),
        ),
        Some(value) => (
            Uniqueness::NotCertified,
            format!(
                "the index is {value}, by blocks {:?}{place}: no theorem applied here covers mixed indices",
                index.levels
            ),
        ),
        None => (
            Uniqueness::NotCertified,
            format!(
                "no differentiation of G determines {} of the {m} variables{place}: while none of them is at a bound, \
                 z is not determined, though x may be",
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
        Some(true) if !problem.is_box => (
            Uniqueness::NotCertified,
            format!(
                "G_z is a P-matrix{place}, which suffices for intervals only, and is not positive definite (least \
                 eigenvalue of its symmetric part {least:.3e})"
            ),
        ),
        Some(true) => (
            Uniqueness::Unique,
            format!(
                "G_z is a P-matrix{place} (its symmetric part has least eigenvalue {least:.3e}): z is a Lipschitz \
                 function of (t, x)"
            ),
        ),
        Some(false) => (
            Uniqueness::NotCertified,
            format!("G_z is regular but not a P-matrix{place} (least eigenvalue of its symmetric part {least:.3e})"),
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
        Some(false) => "not a P-matrix",
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
                "{described}: solutions may not exist or not be unique; of several, the VI solver selects the one that \
                 it reaches from the previous values"
            ),
        )
    }
}

/// Returns whether the matrix is an H-matrix with positive diagonal: whether its comparison matrix (`|a_ii|` on the
/// diagonal, `-|a_ij|` off it) is a nonsingular M-matrix, which has a nonnegative inverse.
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

/// The properties of a square matrix `A` on which the verdict on uniqueness rests.
struct Figures {
    /// The largest absolute entry of the matrix `A`.
    size: f64,
    /// The least eigenvalue of the symmetric part of the matrix `A`.
    least_eigenvalue: f64,
    /// The relative asymmetry `|A - A^T| / |A|` of the matrix `A`, in the norm of the largest entry.
    asymmetry: f64,
}

impl Figures {
    /// Computes the size, the least eigenvalue and the asymmetry of a matrix; `None` if an entry is not finite.
    fn of(matrix: &DMatrix<f64>) -> Option<Self> {
        // Halve the matrix and its transpose before they are added: the sum of two large entries may overflow.
        let symmetric = matrix * 0.5 + matrix.transpose() * 0.5;
        let size = matrix.amax();
        let asymmetry = if size > 0.0 { (matrix / size - matrix.transpose() / size).amax() } else { 0.0 };
        Some(Self { size, least_eigenvalue: least_eigenvalue(&symmetric)?, asymmetry })
    }
}

/// Returns whether the matrix is a P-matrix (all principal minors are positive); `None` if it is too large to compute
/// them.
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
