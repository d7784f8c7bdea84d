//! Solvers of one affine variational inequality:
//!
//! ```text
//! z in K,    <w, z~ - z> >= 0  for all z~ in K,    w = A z + q
//! ```
//!
//! Each solver is built once for a size, allocates then, and is used many times; each reports the natural-map
//! residual of what it returns.

use crate::problem::ConvexSet;
use nalgebra::DMatrix;

/// An affine variational inequality over `K`; `m = q.len()`.
#[derive(Clone, Copy, Debug)]
pub struct AffineVi<'a> {
    /// `A`, `m x m`, of any symmetry and rank.
    pub matrix: &'a DMatrix<f64>,
    /// `q`, of length `m`.
    pub q: &'a [f64],
    /// `K`.
    pub set: &'a ConvexSet,
}

/// How a solver ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The residual is below the tolerance.
    Solved,
    /// Lemke's path went to infinity: for a copositive-plus matrix there is no solution; otherwise none was found.
    Ray,
    /// A bound on the work was reached; the best point so far is returned.
    Limit,
    /// Numbers ceased to be finite, or a needed matrix was singular.
    Breakdown,
}

/// What a solver did.
#[derive(Clone, Copy, Debug)]
pub struct Report {
    /// How it ended.
    pub outcome: Outcome,
    /// `max_i |z_i - P_K(z - A z - q)_i|` at the returned point, unscaled.
    pub residual: f64,
    /// Pivots or Newton iterations.
    pub iterations: usize,
}

/// A solver of affine variational inequalities.
pub trait ViSolver: Send {
    /// The name users see in `vi_solver` and in the diagnostics.
    fn name(&self) -> &'static str;

    /// Solves, starting from `z` where a start helps, and leaves the answer in `z`.
    fn solve(&mut self, vi: &AffineVi<'_>, z: &mut [f64]) -> Report;
}
