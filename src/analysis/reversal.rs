//! Detection of reversed signs in a linearised problem: if `D = dG/dz`, or `C B` if `D` vanishes, is negative definite,
//! the variables `z` drive their inequality functions `G` further into violation.

use super::linearisation::Linearisation;
use factorisation::least_eigenvalue;
use nalgebra::DMatrix;

/// The sign in the user's equations that may be wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reversal {
    /// The sign of the inequality functions `G` may be wrong.
    Inequality,
    /// The sign of the inequality functions `G`, or of the terms of their variables `z` in the rates `F`, may be wrong.
    InequalityOrRate,
}

/// Detects a reversed sign in a linearised problem, after elimination of its free variables.
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
