//! Block Gauss-Seidel over contacts (NSGS): each contact in turn is [solved exactly](super::solve_contact) with the
//! impulses of the others held (Jean 1999, *The non-smooth contact dynamics method*). A sweep is cheap and a good start
//! is kept; but it converges linearly, and slowly or not at all where contacts outnumber degrees of freedom.

use super::cone::FrictionCone;
use super::{CoulombProblem, solve_contact};
use nalgebra::Vector3;

/// One sweep over all contacts, over-relaxed by `omega` in `(0, 2)` (1: not at all) and kept in the cones.
pub fn sweep(problem: &CoulombProblem, r: &mut [Vector3<f64>], omega: f64) {
    for k in 0..r.len() {
        let (matrix, mu) = (problem.matrix().diagonal(k), problem.mu()[k]);
        let q = problem.velocity(k, r) - matrix * r[k];
        if let Some(exact) = solve_contact(matrix, &q, mu) {
            r[k] = if omega == 1.0 { exact } else { FrictionCone { mu }.project(r[k] + (exact - r[k]) * omega) };
        }
    }
}
