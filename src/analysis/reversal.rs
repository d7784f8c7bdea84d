//! Signs that look reversed: `D`, or where it vanishes `C B`, negative definite, so that the inequality drives its
//! variables away from what it asks for.

use super::linearisation::Linearisation;
use factorisation::least_eigenvalue;
use nalgebra::DMatrix;

/// What may have been written with the wrong sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reversal {
    /// The inequalities.
    Inequality,
    /// The inequalities, or their variables in the rates.
    InequalityOrRate,
}

/// What looks reversed in a problem, seen without its free variables.
pub(super) fn reversal(problem: &Linearisation) -> Option<Reversal> {
    let eliminated = problem.without_free();
    let problem = eliminated.as_ref().unwrap_or(problem);
    if problem.free.contains(&true) {
        return None;
    }
    let is_negative = |matrix: DMatrix<f64>| {
        least_eigenvalue(&(&matrix * -0.5 - matrix.transpose() * 0.5)).is_some_and(|least| least > 0.0)
    };
    if problem.d.amax() > 0.0 {
        is_negative(problem.d.clone()).then_some(Reversal::Inequality)
    } else {
        is_negative(&problem.c * &problem.b).then_some(Reversal::InequalityOrRate)
    }
}
