//! Semismooth Newton for nonlinear variational inequalities over intervals with sparse Jacobians,
//!
//! ```text
//! z in [l, u],    <F(z), x - z> >= 0  for all x in [l, u]
//! ```
//!
//! Rows are scaled by `S`, the inverse of the diagonal of `F'` if it is large enough. The Newton step of the natural
//! map `z - P(z - S F)` is taken if it lowers `|psi|`, the norm of the Fischer-Burmeister equations of all
//! components, enough; otherwise the Newton step of `psi` is taken, with Armijo's line search and a proximal term
//! that vanishes with `|psi|`, so that singular Jacobians, as of problems whose solutions form a set, have directions
//! too; otherwise that of steepest descent (De Luca, Facchinei and Kanzow 1996; Facchinei and Pang 2003, sections
//! 8.3, 9.1 and 12.1). The factors have one sparsity pattern, which is analysed once.

use super::fischer_burmeister::psi;
use super::sparse_jacobian::SparseJacobian;
use super::{Outcome, Report, SparseVi, Worst};
use problem::{Control, ConvexSet};

/// Largest number of Newton steps; practical problems take ten to sixty.
const ITERATIONS: usize = 500;

/// Convergence is fast if a Newton step lowers the residual to this fraction.
const FAST: f64 = 0.1;

/// A Newton step of the natural map is accepted if it lowers the norm of the Fischer-Burmeister function `psi` to
/// this fraction.
const NATURAL_DECREASE: f64 = 0.9;

/// Condition on a direction of descent, with the Fischer-Burmeister function `psi`: the slope of `1/2 |psi|^2` along
/// the direction is at most `-DESCENT |psi|^2`; along an exact Newton direction the slope is `-|psi|^2`.
const DESCENT: f64 = 1e-4;

/// Armijo's fraction of the slope, and the largest number of halvings of a step.
const ARMIJO: f64 = 1e-4;
const HALVINGS: usize = 40;

/// Weights of the proximal term in Newton steps of the Fischer-Burmeister function `psi`, relative to `|psi|`. They
/// are tried in turn until a step lowers `|psi|` to the fraction `SUFFICIENT_DECREASE`.
const PROXIMAL: [f64; 4] = [0.0, 1e-6, 1e-3, 1e-1];
const SUFFICIENT_DECREASE: f64 = 0.9;

/// Weights of the proximal term in Newton steps of the natural map, tried in turn: zero, or so small that regular
/// systems keep their accuracy.
const REGULARISED: [f64; 2] = [0.0, 1e-9];

/// A residual below this fraction of the terms that it is computed from is rounding.
const EXACT: f64 = 1e-15;

/// The semismooth Newton method for problems of one sparsity pattern.
pub struct SparseNewton {
    jacobian: SparseJacobian,
    scale: Vec<f64>,
    /// The function `F` at the iterate and at a trial point.
    f: Vec<f64>,
    trial_f: Vec<f64>,
    psi: Vec<f64>,
    by_z: Vec<f64>,
    by_w: Vec<f64>,
    gradient: Vec<f64>,
    direction: Vec<f64>,
    trial: Vec<f64>,
    best: Vec<f64>,
    best_f: Vec<f64>,
}

impl SparseNewton {
    /// Allocates the workspace for `m` variables and a sparsity pattern; returns `None` if the factors do not fit into
    /// memory, or `control` asks to stop.
    pub fn new(m: usize, pattern: &[(usize, usize)], control: &Control) -> Option<Self> {
        let vector = || vec![0.0; m];
        Some(Self {
            jacobian: SparseJacobian::new(m, pattern, control)?,
            scale: vec![1.0; m],
            f: vector(),
            trial_f: vector(),
            psi: vector(),
            by_z: vector(),
            by_w: vector(),
            gradient: vector(),
            direction: vector(),
            trial: vector(),
            best: vector(),
            best_f: vector(),
        })
    }

    /// Solves from `z` until the natural-map residual relative to its terms is below `tolerance`, and further as long
    /// as steps converge fast; leaves the best point in `z`. The set must be a product of intervals. If `searches` is
    /// false, the iteration ends once a natural-map step does not lower `|psi|` enough.
    pub fn solve(
        &mut self,
        vi: &mut dyn SparseVi,
        tolerance: f64,
        z: &mut [f64],
        searches: bool,
        control: &Control,
    ) -> Report {
        if vi.set().has_blocks() {
            return Report::UNSUITABLE;
        }
        for (i, z) in z.iter_mut().enumerate() {
            *z = vi.set().project(i, if z.is_finite() { *z } else { 0.0 });
        }
        vi.evaluate(z, &mut self.f);
        let mut before = f64::INFINITY;
        for iterations in 0..ITERATIONS {
            if !self.linearise(vi, z) {
                let outcome = Outcome::Breakdown;
                return Report { outcome, residual: self.fit(vi.set(), z).largest, iterations };
            }
            let fit = self.fit(vi.set(), z);
            if fit.largest.is_nan() {
                return Report { iterations, ..Report::BREAKDOWN };
            }
            let report = |outcome| Report { outcome, residual: fit.largest, iterations };
            let is_solved = fit.relative() <= tolerance;
            if is_solved && (fit.relative() <= EXACT || fit.relative() > FAST * before) {
                return report(Outcome::Solved);
            }
            before = fit.relative();
            if control.poll().is_some() {
                return report(Outcome::Interrupted);
            }
            let norm = norm(&self.psi);
            let stepped = REGULARISED.iter().any(|&proximal| {
                self.natural_step(vi, z, proximal, control) && self.norm_at_trial(vi) <= NATURAL_DECREASE * norm
            });
            if stepped {
                z.copy_from_slice(&self.trial);
                std::mem::swap(&mut self.f, &mut self.trial_f);
            } else if !searches || !self.descend(vi, z, norm, control) {
                return report(if is_solved { Outcome::Solved } else { Outcome::Limit });
            }
        }
        let fit = self.fit(vi.set(), z);
        let outcome = if fit.relative() <= tolerance { Outcome::Solved } else { Outcome::Limit };
        Report { outcome, residual: fit.largest, iterations: ITERATIONS }
    }

    /// Returns the component of the iterate with the largest relative residual.
    fn fit(&self, set: &ConvexSet, z: &[f64]) -> Worst {
        self.jacobian.worst(set, (z, &self.f))
    }

    /// Evaluates the Jacobian `F'`, the row scales, and the Fischer-Burmeister function `psi` with its derivatives at
    /// the iterate; returns false if a number is not finite.
    #[expect(clippy::needless_range_loop, reason = "one index for what belongs to a component")]
    fn linearise(&mut self, vi: &mut dyn SparseVi, z: &[f64]) -> bool {
        if !self.jacobian.evaluate(vi, z) || !self.f.iter().all(|f| f.is_finite()) {
            return false;
        }
        self.jacobian.scales(&mut self.scale);
        let set = vi.set();
        for i in 0..z.len() {
            let at = psi(z[i], self.scale[i] * self.f[i], set.lower[i], set.upper[i]);
            (self.psi[i], self.by_z[i], self.by_w[i]) = (at.value, at.by_z, at.by_w);
        }
        true
    }

    /// Computes the Newton step of the natural map from the iterate, and writes its end point to `trial`. Returns
    /// false if the linear system of the step is singular.
    fn natural_step(&mut self, vi: &mut dyn SparseVi, z: &[f64], proximal: f64, control: &Control) -> bool {
        let set = vi.set();
        let mut is_inside = vec![false; z.len()];
        for i in 0..z.len() {
            let moved = z[i] - self.scale[i] * self.f[i];
            is_inside[i] = moved > set.lower[i] && moved < set.upper[i];
            self.direction[i] = if is_inside[i] { -self.scale[i] * self.f[i] } else { set.project(i, moved) - z[i] };
        }
        let scale = &self.scale;
        let row = |i: usize| if is_inside[i] { (scale[i], proximal) } else { (0.0, 1.0) };
        let is_solved = self.jacobian.factorise(row, control) && self.jacobian.solve(&mut self.direction);
        if is_solved {
            let set = vi.set();
            for (i, trial) in self.trial.iter_mut().enumerate() {
                let moved = z[i] + self.direction[i];
                // Put active variables exactly on their bounds.
                *trial = if is_inside[i] { moved } else { set.project(i, moved) };
            }
            vi.evaluate(&self.trial, &mut self.trial_f);
        }
        is_solved
    }

    /// Returns the norm of the Fischer-Burmeister function `psi` at the trial point, where `F` has been evaluated.
    fn norm_at_trial(&self, vi: &dyn SparseVi) -> f64 {
        let set = vi.set();
        let values = (0..self.trial.len())
            .map(|i| psi(self.trial[i], self.scale[i] * self.trial_f[i], set.lower[i], set.upper[i]).value);
        values.map(|value| value * value).sum::<f64>().sqrt()
    }

    /// Makes a step of Armijo's line search along a Newton direction of the Fischer-Burmeister function `psi`, or
    /// along the steepest descent of `1/2 |psi|^2`. Returns false if no step lowers `|psi|`.
    fn descend(&mut self, vi: &mut dyn SparseVi, z: &mut [f64], norm: f64, control: &Control) -> bool {
        let weighted: Vec<f64> =
            self.psi.iter().zip(&self.by_w).zip(&self.scale).map(|((psi, by_w), s)| psi * by_w * s).collect();
        for (j, gradient) in self.gradient.iter_mut().enumerate() {
            *gradient =
                self.by_z[j] * self.psi[j] + self.jacobian.column(j).map(|(&i, a)| a * weighted[i]).sum::<f64>();
        }
        let mut reached = norm;
        for proximal in PROXIMAL {
            if reached <= SUFFICIENT_DECREASE * norm {
                break;
            }
            let mu = proximal * norm.min(1.0);
            self.direction.iter_mut().zip(&self.psi).for_each(|(d, psi)| *d = -psi);
            let [by_z, by_w, scale] = [&self.by_z, &self.by_w, &self.scale];
            let row = |i: usize| (by_w[i] * scale[i], by_z[i] + mu * by_w[i]);
            let is_solved = self.jacobian.factorise(row, control) && self.jacobian.solve(&mut self.direction);
            let slope: f64 = self.gradient.iter().zip(&self.direction).map(|(g, d)| g * d).sum();
            if is_solved && slope <= -DESCENT * norm * norm {
                reached = self.search(vi, z, norm, slope, reached);
            }
            if control.poll().is_some() {
                break;
            }
        }
        if reached == norm {
            self.direction.iter_mut().zip(&self.gradient).for_each(|(d, g)| *d = -g);
            let slope = -self.gradient.iter().map(|g| g * g).sum::<f64>();
            reached = self.search(vi, z, norm, slope, reached);
        }
        if reached < norm {
            z.copy_from_slice(&self.best);
            std::mem::swap(&mut self.f, &mut self.best_f);
        }
        reached < norm
    }

    /// Makes Armijo's line search from the iterate, at which the Fischer-Burmeister function `psi` has the given
    /// norm. Keeps the point found if its norm is below `record`, and returns the smaller of the two norms.
    fn search(&mut self, vi: &mut dyn SparseVi, z: &[f64], norm: f64, slope: f64, record: f64) -> f64 {
        let mut step = 1.0;
        for _ in 0..HALVINGS {
            for ((trial, z), d) in self.trial.iter_mut().zip(z).zip(&self.direction) {
                *trial = z + step * d;
            }
            vi.evaluate(&self.trial, &mut self.trial_f);
            let reached = self.norm_at_trial(vi);
            if 0.5 * reached * reached <= 0.5 * norm * norm + ARMIJO * step * slope {
                if reached < record {
                    self.best.copy_from_slice(&self.trial);
                    self.best_f.copy_from_slice(&self.trial_f);
                    return reached;
                }
                break;
            }
            step *= 0.5;
        }
        record
    }
}

fn norm(a: &[f64]) -> f64 {
    a.iter().map(|a| a * a).sum::<f64>().sqrt()
}
