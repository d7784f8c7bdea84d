//! Nonlinear variational inequalities by the Josephy-Newton method: at the iterate `z`, with `J = F'(z)`, the affine
//! problem
//!
//! ```text
//! y in K,    <F(z) + J (y - z), x - y> >= 0  for all x in K
//! ```
//!
//! gives the direction `y - z` (Josephy 1979, *Newton's method for generalized equations*). The full step is taken if
//! it lowers the natural map enough; otherwise Armijo's search on the D-gap function shortens it. The direction is
//! one of descent if `F` is strongly monotone; if it is not a direction of descent, the negative gradient of the
//! D-gap function takes its place (Peng and Fukushima 1999).

use super::auto::SolverKind;
use super::d_gap::Gap;
use super::{AffineVi, Attempt, Outcome, Report, Terms, ViSolver};
use nalgebra::DMatrix;
use problem::{Control, ConvexSet, Workspace};

/// Largest number of Newton steps, each of which solves one affine problem. For an exponential function full Newton
/// steps have length one, and 709 of them lead back from the overflow threshold.
const ITERATIONS: usize = 1000;

/// A full Newton step must lower the norm of the natural map to this fraction of the least value so far.
const DECREASE: f64 = 0.9;

/// Armijo's fraction of the slope, and the largest number of halvings of a step.
const ARMIJO: f64 = 1e-4;
const HALVINGS: usize = 30;

/// If no step lowers the residual, the residual is ascribed to rounding if it is below this fraction of the larger of
/// `|z|` and `|F|`.
const ROUNDING: f64 = 1e-11;

/// A full Newton step shorter than this fraction of `|z|` is rounding, and the iteration ends.
const STILL: f64 = 1e-15;

/// A nonlinear variational inequality, `<F(z), x - z> >= 0` for all `x` in `K`.
pub trait NonlinearVi {
    /// Returns the set `K`, of dimension `m`.
    fn set(&self) -> &ConvexSet;

    /// Writes the function `F(z)`, of length `m`. Undefined components are NaN or infinite.
    fn evaluate(&mut self, z: &[f64], f: &mut [f64]);

    /// Writes the Jacobian `F'(z)`, `m x m`.
    fn jacobian(&mut self, z: &[f64], derivative: &mut DMatrix<f64>);
}

/// The Josephy-Newton method with its solver of affine problems.
pub struct JosephyNewton {
    solver: Box<dyn ViSolver>,
    gap: Gap,
    work: Workspace,
    matrix: DMatrix<f64>,
    f: Vec<f64>,
    q: Vec<f64>,
    /// Workspace: first the solution of the affine problem, then the search direction.
    direction: Vec<f64>,
    gradient: Vec<f64>,
    trial: Vec<f64>,
    trial_f: Vec<f64>,
}

impl JosephyNewton {
    /// Creates a solver for `m` variables, with affine problems solved by a solver of `kind`.
    pub fn new(m: usize, kind: SolverKind) -> Self {
        let vector = || vec![0.0; m];
        Self {
            solver: kind.build(m),
            gap: Gap::default(),
            work: Workspace::default(),
            matrix: DMatrix::zeros(m, m),
            f: vector(),
            q: vector(),
            direction: vector(),
            gradient: vector(),
            trial: vector(),
            trial_f: vector(),
        }
    }

    /// Returns the attempts of the underlying solvers at the last affine problem.
    pub fn attempts(&self) -> &[Attempt] {
        self.solver.attempts()
    }

    /// Solves the variational inequality from `z`, of length `m`, until the residual is below `tolerance`, and writes
    /// the best point to `z`.
    pub fn solve(&mut self, vi: &mut dyn NonlinearVi, tolerance: f64, z: &mut [f64], control: &Control) -> Report {
        vi.set().project_all(z, &mut self.work);
        vi.evaluate(z, &mut self.f);
        // For blocks, residuals are relative to the terms of `F`, whose sizes are computed from the Jacobian.
        let has_blocks = vi.set().has_blocks();
        let mut least = f64::INFINITY;
        for iterations in 0..ITERATIONS {
            if has_blocks {
                vi.jacobian(z, &mut self.matrix);
            }
            let residual = self.residual(vi.set(), z);
            if !residual.is_finite() {
                return Report { iterations, ..Report::BREAKDOWN };
            }
            if residual <= tolerance {
                return Report { outcome: Outcome::Solved, residual, iterations };
            }
            if control.poll().is_some() {
                return Report { outcome: Outcome::Interrupted, residual, iterations };
            }
            if !has_blocks {
                vi.jacobian(z, &mut self.matrix);
            }
            if !self.matrix.iter().all(|a| a.is_finite()) {
                return Report { outcome: Outcome::Breakdown, residual, iterations };
            }
            least = least.min(residual);
            if !self.advance(vi, z, least, control) {
                let size = z.iter().chain(&self.f).fold(1.0_f64, |most, x| most.max(x.abs()));
                let outcome = if residual <= ROUNDING * size { Outcome::Solved } else { Outcome::Limit };
                return Report { outcome, residual, iterations };
            }
        }
        Report { outcome: Outcome::Limit, residual: self.residual(vi.set(), z), iterations: ITERATIONS }
    }

    /// Returns the largest `|z_i - P_K(z - F)_i|` over components in intervals, and for blocks the relative residual
    /// in the unit of `F`, by the last derivative.
    fn residual(&mut self, set: &ConvexSet, z: &[f64]) -> f64 {
        let Self { matrix, f, work, .. } = self;
        let mut largest = 0.0;
        let mut offer = |r: f64| largest = if r > largest || r.is_nan() { r } else { largest };
        for i in (0..z.len()).filter(|&i| set.block_of(i).is_none()) {
            offer((z[i] - set.project(i, z[i] - f[i])).abs());
        }
        if set.has_blocks() {
            let m = z.len();
            let entries = matrix.iter().enumerate().map(|(place, a)| ((place % m, place / m), *a));
            let terms = Terms::of(set, (z, f), entries);
            for number in 0..set.blocks().len() {
                offer(terms.residual_of_block(set, number, (z, f), work).0);
            }
        }
        largest
    }

    /// Makes one Newton step from `z`; returns false if no step lowers the merit function.
    fn advance(&mut self, vi: &mut dyn NonlinearVi, z: &mut [f64], least: f64, control: &Control) -> bool {
        let m = z.len();
        for i in 0..m {
            self.q[i] = self.f[i] - self.matrix.row(i).iter().zip(&*z).map(|(a, z)| a * z).sum::<f64>();
        }
        AffineVi { matrix: &self.matrix, q: &self.q, set: vi.set() }.scales(&mut self.gap.scale);
        let merit = self.gap.value(vi.set(), z, &self.f);
        let matrix = &self.matrix;
        self.gap.gradient(z, |j, v| matrix.column(j).iter().zip(v).map(|(a, v)| a * v).sum(), &mut self.gradient);
        self.direction.copy_from_slice(z);
        let affine = AffineVi { matrix: &self.matrix, q: &self.q, set: vi.set() };
        if self.solver.solve(&affine, &mut self.direction, control).outcome == Outcome::Solved {
            self.direction.iter_mut().zip(&*z).for_each(|(y, z)| *y -= z);
            let size = |x: &[f64]| x.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            if size(&self.direction) <= STILL * size(z) {
                return false;
            }
            self.step(vi, z, 1.0);
            std::mem::swap(&mut self.f, &mut self.trial_f);
            let trial = std::mem::take(&mut self.trial);
            let reached = self.residual(vi.set(), &trial);
            self.trial = trial;
            if reached <= DECREASE * least {
                z.copy_from_slice(&self.trial);
                return true;
            }
            std::mem::swap(&mut self.f, &mut self.trial_f);
            if self.search(vi, z, merit) {
                return true;
            }
        }
        for ((d, g), s) in self.direction.iter_mut().zip(&self.gradient).zip(&self.gap.scale) {
            *d = -s * g;
        }
        self.search(vi, z, merit)
    }

    /// Makes Armijo's line search on the D-gap function along the search direction; returns false if no step lowers
    /// the function enough.
    fn search(&mut self, vi: &mut dyn NonlinearVi, z: &mut [f64], merit: f64) -> bool {
        let slope: f64 = self.gradient.iter().zip(&self.direction).map(|(g, d)| g * d).sum();
        if slope.is_nan() || slope >= 0.0 {
            return false;
        }
        let mut step = 1.0;
        for _ in 0..HALVINGS {
            self.step(vi, z, step);
            if self.gap.value(vi.set(), &self.trial, &self.trial_f) <= merit + ARMIJO * step * slope {
                z.copy_from_slice(&self.trial);
                std::mem::swap(&mut self.f, &mut self.trial_f);
                return true;
            }
            step *= 0.5;
        }
        false
    }

    fn step(&mut self, vi: &mut dyn NonlinearVi, z: &[f64], step: f64) {
        for ((trial, z), d) in self.trial.iter_mut().zip(z).zip(&self.direction) {
            *trial = z + step * d;
        }
        vi.evaluate(&self.trial, &mut self.trial_f);
    }
}
