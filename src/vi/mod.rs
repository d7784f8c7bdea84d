//! Solvers of one affine variational inequality:
//!
//! ```text
//! z in K,    <w, z~ - z> >= 0  for all z~ in K,    w = A z + q
//! ```
//!
//! Each solver is built once for a size, allocates then, and is used many times; each reports the natural-map
//! residual of what it returns.

mod auto;
pub mod coulomb;
mod elimination;
mod equilibration;
mod fischer_burmeister;
mod lemke;
mod semismooth_newton;
#[cfg(test)]
mod tests;

pub use auto::{Auto, SolverKind};
pub use lemke::Lemke;
pub use semismooth_newton::SemismoothNewton;

use crate::problem::ConvexSet;
use nalgebra::DMatrix;

/// A point is a solution when its residual is below this fraction of the largest of `|q| + |A| |z|`, the terms that
/// cancel in `w`: below 1e-10 of the larger of the two.
const TOLERANCE: f64 = 5e-11;

/// A residual this small against its own terms is rounding.
const EXACT: f64 = 1e-14;

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

/// The natural-map residual of a point, and the size of the terms it is the difference of.
#[derive(Clone, Copy, Debug)]
struct Accuracy {
    /// `max_i |z_i - P_K(z - w)_i|`.
    residual: f64,
    /// `max_i (|q| + |A| |z|)_i`.
    magnitude: f64,
    /// The largest residual of a component over the size of that component's own terms.
    componentwise: f64,
}

impl Accuracy {
    fn is_solved(&self) -> bool {
        self.residual <= TOLERANCE * self.magnitude
    }

    fn report(&self, failure: Outcome, iterations: usize) -> Report {
        let outcome = if self.is_solved() { Outcome::Solved } else { failure };
        Report { outcome, residual: self.residual, iterations }
    }
}

impl AffineVi<'_> {
    /// Writes `w = A z + q`, with `|A| |z| + |q|` beside it, and measures how well `z` solves the problem.
    fn measure(&self, z: &[f64], w: &mut [f64], terms: &mut [f64]) -> Accuracy {
        let m = self.q.len();
        for ((w, terms), &q) in w.iter_mut().zip(terms.iter_mut()).zip(self.q) {
            (*w, *terms) = (q, q.abs());
        }
        for (j, &z) in z.iter().enumerate() {
            if z != 0.0 {
                let column = &self.matrix.as_slice()[j * m..][..m];
                for ((w, terms), &a) in w.iter_mut().zip(terms.iter_mut()).zip(column) {
                    *w += a * z;
                    *terms += (a * z).abs();
                }
            }
        }
        let mut accuracy = Accuracy { residual: 0.0, magnitude: 0.0, componentwise: 0.0 };
        for i in 0..m {
            let r = (z[i] - self.set.project(i, z[i] - w[i])).abs();
            if r.is_nan() {
                return Accuracy { residual: f64::NAN, magnitude: f64::NAN, componentwise: f64::NAN };
            }
            accuracy.residual = accuracy.residual.max(r);
            accuracy.magnitude = accuracy.magnitude.max(terms[i]);
            if r > 0.0 {
                accuracy.componentwise = accuracy.componentwise.max(r / terms[i]);
            }
        }
        accuracy
    }
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
    /// Pivots or Newton iterations; zero where the start was the answer.
    pub iterations: usize,
}

impl Report {
    /// What is said of a problem whose numbers are not finite, or whose intervals are empty.
    const BREAKDOWN: Self = Self { outcome: Outcome::Breakdown, residual: f64::NAN, iterations: 0 };
}

/// A solver of affine variational inequalities.
pub trait ViSolver: Send {
    /// The name users see in `vi_solver` and in the diagnostics.
    fn name(&self) -> &'static str;

    /// Solves, starting from `z` where a start helps, and leaves the answer in `z`.
    fn solve(&mut self, vi: &AffineVi<'_>, z: &mut [f64]) -> Report;
}
