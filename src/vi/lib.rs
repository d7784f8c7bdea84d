//! Solvers of one affine variational inequality:
//!
//! ```text
//! z in K,    <w, z~ - z> >= 0  for all z~ in K,    w = A z + q
//! ```
//!
//! Each solver allocates once for a size and is used many times; each reports the natural-map residual of its result.

mod active_set;
mod auto;
mod block_gauss_seidel;
mod certificate;
mod conic;
pub mod coulomb;
mod d_gap;
mod elimination;
mod equilibration;
mod fischer_burmeister;
mod infeasibility;
mod interior_point;
mod josephy_newton;
mod lemke;
mod portfolio;
mod residual;
mod scaled;
mod semismooth_newton;
mod sparse_jacobian;
mod sparse_newton;
mod splitting;
#[cfg(test)]
mod tests;
mod worst;

pub use active_set::{ActiveSet, DenseActiveSet, Unsuitable};
pub use auto::{Attempt, Auto, SolverKind};
pub use block_gauss_seidel::BlockGaussSeidel;
pub use certificate::{Certificate, MOST_VARIABLES, SINGULAR, certificate, least_relative_eigenvalue};
pub use conic::Conic;
pub use josephy_newton::{JosephyNewton, NonlinearVi};
pub use lemke::Lemke;
pub use portfolio::{Found, Portfolio, start};
pub use semismooth_newton::SemismoothNewton;
pub use sparse_jacobian::SparseVi;
pub use sparse_newton::SparseNewton;
pub use worst::{Terms, Worst};

use nalgebra::DMatrix;
use problem::{Control, ConvexSet};

/// Relative tolerance: a point is a solution if its residual is below this fraction of the largest component of
/// `|A| |z| + |q|`. Where the two terms of `w = A z + q` cancel, their sum is at most twice the larger one, so that the
/// residual is below 1e-10 of that term.
const TOLERANCE: f64 = 5e-11;

/// A residual below this fraction of the terms that it is computed from is rounding.
const EXACT: f64 = 1e-14;

/// Number of pivots or steps between two polls of [`Control`], so that reading the clock costs nothing in microsecond
/// solves.
const STEPS_BETWEEN_POLLS: usize = 16;

/// Polls `control` once in `STEPS_BETWEEN_POLLS` steps; returns whether `control` asks to stop.
fn is_interrupted(control: &Control, step: usize) -> bool {
    step % STEPS_BETWEEN_POLLS == STEPS_BETWEEN_POLLS - 1 && control.poll().is_some()
}

/// An affine variational inequality over `K`, of dimension `m = q.len()`.
#[derive(Clone, Copy, Debug)]
pub struct AffineVi<'a> {
    /// The matrix `A`, `m x m`, of any symmetry and rank.
    pub matrix: &'a DMatrix<f64>,
    /// The vector `q`, of length `m`.
    pub q: &'a [f64],
    /// The closed convex set `K`.
    pub set: &'a ConvexSet,
}

/// The natural-map residual of a point, and the size of its terms.
#[derive(Clone, Copy, Debug)]
struct Accuracy {
    /// The natural-map residual `max_i |z_i - P_K(z - w)_i|`.
    residual: f64,
    /// The natural-map residual over the components in intervals only.
    intervals: f64,
    /// The size of the terms, `max_i (|q| + |A| |z|)_i`.
    magnitude: f64,
    /// The largest residual of a component, relative to the component's own terms.
    componentwise: f64,
    /// The largest relative residual of a block of variables, as defined in [`residual`].
    blockwise: f64,
}

impl Accuracy {
    const NOT_A_NUMBER: Self = Self {
        residual: f64::NAN,
        intervals: f64::NAN,
        magnitude: f64::NAN,
        componentwise: f64::NAN,
        blockwise: f64::NAN,
    };

    /// Returns the larger of the relative residual of the components in intervals and that of the worst block.
    fn relative(&self) -> f64 {
        if self.intervals == 0.0 { self.blockwise } else { self.blockwise.max(self.intervals / self.magnitude) }
    }

    fn is_solved(&self) -> bool {
        self.relative() <= TOLERANCE
    }

    /// Whether the componentwise residual is smaller than that of another point; false if it is NaN.
    fn is_closer_than(&self, other: &Self) -> bool {
        self.componentwise < other.componentwise
    }

    /// Whether the point is better than another. If neither is a solution, the residuals are compared, in which all
    /// rows count equally. If both are solutions, the worst componentwise residuals are compared, since the plain
    /// residual does not show an inaccurate row with small terms. Returns false if the residual is NaN.
    fn improves_on(&self, other: &Self) -> bool {
        match (self.is_solved(), other.is_solved()) {
            (true, true) => self.is_closer_than(other),
            (false, false) => self.residual < other.residual,
            (solved, _) => solved,
        }
    }

    fn report(&self, failure: Outcome, iterations: usize) -> Report {
        let outcome = if self.is_solved() { Outcome::Solved } else { failure };
        Report { outcome, residual: self.residual, iterations }
    }
}

impl AffineVi<'_> {
    /// Whether all data of the problem are finite and `K` is nonempty.
    fn is_sound(&self) -> bool {
        self.set.is_nonempty() && self.matrix.iter().chain(self.q).all(|x| x.is_finite())
    }

    /// Computes `w = A z + q`.
    fn product(&self, z: &[f64], w: &mut [f64]) {
        w.copy_from_slice(self.q);
        for (column, z) in self.matrix.as_slice().chunks_exact(z.len().max(1)).zip(z) {
            for (w, a) in w.iter_mut().zip(column) {
                *w += a * z;
            }
        }
    }

    /// Computes scales `S` that give `z` and `S w` one unit: the inverse of the largest entry of `A` within a block,
    /// or within the rows of the block if the block is zero; one if those rows are zero. If `q` alone would move a
    /// point by more than the size of the block, the scale limits the move to that size: a projection from far away
    /// loses its digits.
    fn scales(&self, scale: &mut Vec<f64>) {
        let m = self.q.len();
        let inverse = |largest: f64| if largest > 0.0 { 1.0 / largest } else { 1.0 };
        let row = |i: usize| self.matrix.row(i).iter().fold(0.0_f64, |most, a| most.max(a.abs()));
        scale.clear();
        scale.extend((0..m).map(|i| match (self.matrix[(i, i)].abs(), self.set.block_of(i)) {
            (diagonal, None) if diagonal > 0.0 => 1.0 / diagonal,
            (_, None) => inverse(row(i)),
            _ => 1.0,
        }));
        for block in self.set.blocks() {
            let over = |size: &dyn Fn(usize) -> f64| block.members.iter().fold(0.0_f64, |most, &i| most.max(size(i)));
            let own = over(&|i| over(&|j| self.matrix[(i, j)].abs()));
            let largest = if own > 0.0 { own } else { over(&row) };
            let across = block.shape.size().unwrap_or(if largest > 0.0 { f64::INFINITY } else { 1.0 });
            let force = over(&|i| self.q[i].abs());
            let s = if largest * across > force || force == 0.0 { inverse(largest) } else { across / force };
            block.members.iter().for_each(|&i| scale[i] = s);
        }
    }

    /// Writes `w = A z + q` and `terms = |A| |z| + |q|`, and measures the residual of `z` in the components that lie in
    /// intervals.
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
        let mut accuracy =
            Accuracy { residual: 0.0, intervals: 0.0, magnitude: 0.0, componentwise: 0.0, blockwise: 0.0 };
        for i in (0..m).filter(|&i| self.set.block_of(i).is_none()) {
            let r = (z[i] - self.set.project(i, z[i] - w[i])).abs();
            if r.is_nan() {
                return Accuracy::NOT_A_NUMBER;
            }
            accuracy.residual = accuracy.residual.max(r);
            accuracy.magnitude = accuracy.magnitude.max(terms[i]);
            if r > 0.0 {
                accuracy.componentwise = accuracy.componentwise.max(r / terms[i]);
            }
        }
        accuracy.intervals = accuracy.residual;
        accuracy
    }
}

/// The outcome of a solver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The residual is below the tolerance.
    Solved,
    /// Lemke's path went to infinity: for a copositive-plus matrix no solution exists; for other matrices none was
    /// found.
    Ray,
    /// A limit on the work was reached; the best point so far is returned.
    Limit,
    /// A value is not finite, or a required matrix is singular.
    Breakdown,
    /// The set or the matrix does not suit the method; nothing was tried.
    Unsuitable,
    /// [`Control`] asked to stop; the best point so far is returned.
    Interrupted,
}

impl Outcome {
    /// Returns a stable identifier of the outcome for programs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Solved => "solved",
            Self::Ray => "ray",
            Self::Limit => "limit",
            Self::Breakdown => "breakdown",
            Self::Unsuitable => "unsuitable",
            Self::Interrupted => "interrupted",
        }
    }
}

/// The result of a solver of variational inequalities, without the point `z`.
#[derive(Clone, Copy, Debug)]
pub struct Report {
    /// The outcome of the solve.
    pub outcome: Outcome,
    /// The natural-map residual `max_i |z_i - P_K(z - A z - q)_i|` at the returned point, unscaled.
    pub residual: f64,
    /// The number of pivots or Newton iterations; zero if the start was the solution.
    pub iterations: usize,
}

impl Report {
    /// The report on a problem with values that are not finite, or with empty intervals.
    const BREAKDOWN: Self = Self { outcome: Outcome::Breakdown, residual: f64::NAN, iterations: 0 };

    /// The report on a problem whose set or matrix does not suit the method.
    const UNSUITABLE: Self = Self { outcome: Outcome::Unsuitable, residual: f64::NAN, iterations: 0 };
}

/// A solver of affine variational inequalities.
pub trait ViSolver: Send {
    /// Returns the name of the solver in the setting `vi_solver` and in the diagnostics.
    fn name(&self) -> &'static str;

    /// Solves the variational inequality, starting from `z` if the method uses a start, and writes the result to `z`.
    /// Stops early if `control` asks to stop.
    fn solve(&mut self, vi: &AffineVi<'_>, z: &mut [f64], control: &Control) -> Report;

    /// Returns the solvers tried for the last problem, in order, with their outcomes; empty if there is no choice.
    fn attempts(&self) -> &[Attempt] {
        &[]
    }
}
