//! A primal-dual interior-point method for nonlinear variational inequalities over intervals with sparse Jacobians.
//! With distances `a = z - l`, `b = u - z` to the bounds and multipliers `y`, `v`, all positive, it solves
//!
//! ```text
//! F(z) - y + v = 0,    a_i y_i = mu,    b_i v_i = mu,    mu -> 0
//! ```
//!
//! by Newton's method with the predictor and corrector of Mehrotra (1992), on the system `F' + diag(y/a + v/b)`. Its
//! directions exist and are directions of descent if `F` is monotone, whether the solution is one point or a set
//! (Facchinei and Pang 2003, chapter 11; Ralph and Wright 2000, *Superlinear convergence of an interior-point method
//! despite dependent constraints*); for other `F` the method is a heuristic.

use super::sparse_jacobian::SparseJacobian;
use super::{Outcome, Report, SparseVi, Worst};
use problem::{Control, ConvexSet};

/// Largest number of interior-point steps; problems take 15 to 50, hardly more if they are large.
const ITERATIONS: usize = 150;
/// Largest step length, as a fraction of the distance to the nearest bound.
const TO_BOUNDARY: f64 = 0.995;
/// Largest number of halvings of a step whose merit function does not fall enough.
const HALVINGS: usize = 25;
/// Armijo's constant: fraction of the linearly predicted decrease that a step must reach.
const ARMIJO: f64 = 1e-4;
/// The iteration ends once the mean product of distances and multipliers is below this fraction of its largest value:
/// any further progress is rounding.
const LEAST: f64 = 1e-26;
/// The regularising term added to the diagonal of a singular linear system, relative to its scaled rows.
const REGULAR: f64 = 1e-12;

/// The interior-point method for problems of one sparsity pattern.
pub(super) struct InteriorPoint {
    jacobian: SparseJacobian,
    scale: Vec<f64>,
    f: Vec<f64>,
    /// Multipliers of the lower (`y`) and upper bounds (`v`), and their steps.
    y: Vec<f64>,
    v: Vec<f64>,
    dy: Vec<f64>,
    dv: Vec<f64>,
    dz: Vec<f64>,
    trial: Vec<f64>,
    trial_f: Vec<f64>,
}

impl InteriorPoint {
    /// Allocates the workspace for `m` variables and a sparsity pattern; returns `None` if the factors do not fit into
    /// memory, or `control` asks to stop.
    pub fn new(m: usize, pattern: &[(usize, usize)], control: &Control) -> Option<Self> {
        let vector = || vec![0.0; m];
        Some(Self {
            jacobian: SparseJacobian::new(m, pattern, control)?,
            scale: vec![1.0; m],
            f: vector(),
            y: vector(),
            v: vector(),
            dy: vector(),
            dv: vector(),
            dz: vector(),
            trial: vector(),
            trial_f: vector(),
        })
    }

    /// Solves the variational inequality from near `z` until the natural-map residual relative to its terms is below
    /// `tolerance`; leaves the best point in `z`.
    pub fn solve(&mut self, vi: &mut dyn SparseVi, tolerance: f64, z: &mut [f64], control: &Control) -> Report {
        if vi.set().has_blocks() {
            return Report::UNSUITABLE;
        }
        self.begin(vi, z);
        let mut best: Option<(Worst, Vec<f64>)> = None;
        let mut first = 0.0;
        let mut outcome = Outcome::Limit;
        let mut iterations = 0;
        while iterations < ITERATIONS {
            if !self.jacobian.evaluate(vi, z) || !self.f.iter().all(|f| f.is_finite()) {
                outcome = Outcome::Breakdown;
                break;
            }
            self.jacobian.scales(&mut self.scale);
            let fit = self.jacobian.worst(vi.set(), (z, &self.f));
            if best.as_ref().is_none_or(|(best, _)| fit.relative() < best.relative()) {
                best = Some((fit, z.to_vec()));
            }
            if fit.relative() <= tolerance {
                outcome = Outcome::Solved;
                break;
            }
            if control.poll().is_some() {
                outcome = Outcome::Interrupted;
                break;
            }
            let mu = self.mean_product(vi.set(), z);
            first = f64::max(first, mu);
            if mu <= LEAST * first || !self.step(vi, z, mu, control) {
                break;
            }
            iterations += 1;
        }
        let Some((fit, point)) = best else { return Report { iterations, ..Report::BREAKDOWN } };
        z.copy_from_slice(&point);
        Report { outcome, residual: fit.largest, iterations }
    }

    /// Makes `z` a starting point: moves it inside all intervals, and sets multipliers of the size of `F`.
    fn begin(&mut self, vi: &mut dyn SparseVi, z: &mut [f64]) {
        let size = z.iter().filter(|z| z.is_finite()).fold(1.0_f64, |most, z| most.max(z.abs()));
        let set = vi.set();
        for (i, z) in z.iter_mut().enumerate() {
            let (lower, upper) = (set.lower[i], set.upper[i]);
            let inside = size.min(0.25 * (upper - lower));
            *z = if z.is_finite() { *z } else { 0.0 };
            if lower < upper {
                *z = z.clamp(lower + inside.min(size), upper - inside.min(size));
            } else {
                *z = lower;
            }
        }
        vi.evaluate(z, &mut self.f);
        let largest = self.f.iter().filter(|f| f.is_finite()).fold(1.0_f64, |most, f| most.max(f.abs()));
        let set = vi.set();
        for i in 0..z.len() {
            let is_kept = set.lower[i] < set.upper[i];
            self.y[i] = if is_kept && set.lower[i].is_finite() { self.f[i].abs().max(0.1 * largest) } else { 0.0 };
            self.v[i] = if is_kept && set.upper[i].is_finite() { self.f[i].abs().max(0.1 * largest) } else { 0.0 };
        }
    }

    #[expect(clippy::needless_range_loop, reason = "one index for what belongs to a component")]
    fn mean_product(&self, set: &ConvexSet, z: &[f64]) -> f64 {
        let (mut sum, mut count) = (0.0, 0_u32);
        for i in 0..z.len() {
            for (distance, multiplier) in [(z[i] - set.lower[i], self.y[i]), (set.upper[i] - z[i], self.v[i])] {
                if multiplier > 0.0 {
                    sum += distance * multiplier;
                    count += 1;
                }
            }
        }
        sum / f64::from(count.max(1))
    }

    /// Makes one predictor-corrector step from `z`; returns false if no step lowers the merit function.
    #[expect(clippy::needless_range_loop, reason = "one index for what belongs to a component")]
    fn step(&mut self, vi: &mut dyn SparseVi, z: &mut [f64], mu: f64, control: &Control) -> bool {
        let m = z.len();
        let set = vi.set();
        let distances = |i: usize, z: &[f64]| (z[i] - set.lower[i], set.upper[i] - z[i]);
        let diagonal: Vec<f64> = (0..m)
            .map(|i| {
                let (a, b) = distances(i, z);
                let of = |multiplier: f64, distance: f64| if multiplier > 0.0 { multiplier / distance } else { 0.0 };
                of(self.y[i], a) + of(self.v[i], b)
            })
            .collect();
        let is_fixed = |i: usize| set.lower[i] == set.upper[i];
        let scale = &self.scale;
        // Predictor: aim at the solution with zero products. Corrector: aim at a point on the central path, with the
        // second-order terms of the products.
        let mut centre = 0.0;
        for corrects in [false, true] {
            let mut right: Vec<f64> = (0..m)
                .map(|i| {
                    let (a, b) = distances(i, z);
                    let (mut right, da) = (-self.f[i], self.dz[i]);
                    if corrects && self.y[i] > 0.0 {
                        right += (centre - da * self.dy[i]) / a;
                    }
                    if corrects && self.v[i] > 0.0 {
                        right -= (centre + da * self.dv[i]) / b;
                    }
                    if is_fixed(i) { 0.0 } else { right }
                })
                .collect();
            let solved = if corrects {
                self.jacobian.solve(&mut right)
            } else {
                let kept = right.clone();
                [0.0, REGULAR].into_iter().any(|regular| {
                    right.copy_from_slice(&kept);
                    let row = |i: usize| match is_fixed(i) {
                        true => (0.0, 1.0),
                        false => (1.0, diagonal[i] + regular / scale[i]),
                    };
                    self.jacobian.factorise(row, control) && self.jacobian.solve(&mut right)
                })
            };
            if !solved {
                return false;
            }
            for i in 0..m {
                let (a, b) = distances(i, z);
                let (dz, old) = (right[i], self.dz[i]);
                let product = |other: f64| if corrects { centre - old * other } else { 0.0 };
                let (to_lower, to_upper) = (product(self.dy[i]), product(-self.dv[i]));
                self.dy[i] = if self.y[i] > 0.0 { to_lower / a - self.y[i] - self.y[i] / a * dz } else { 0.0 };
                self.dv[i] = if self.v[i] > 0.0 { to_upper / b - self.v[i] + self.v[i] / b * dz } else { 0.0 };
            }
            self.dz.copy_from_slice(&right);
            if !corrects {
                let reach = self.reach(set, z);
                let (mut sum, mut count) = (0.0, 0_u32);
                for i in 0..m {
                    let (a, b) = distances(i, z);
                    let dz = reach * self.dz[i];
                    for (distance, multiplier, change) in
                        [(a + dz, self.y[i], self.dy[i]), (b - dz, self.v[i], self.dv[i])]
                    {
                        if multiplier > 0.0 {
                            sum += distance * (multiplier + reach * change);
                            count += 1;
                        }
                    }
                }
                let reached = sum / f64::from(count.max(1));
                centre = if count > 0 { mu * (reached / mu).clamp(0.0, 1.0).powi(3) } else { 0.0 };
            }
        }
        let mut length = (TO_BOUNDARY * self.reach(set, z)).min(1.0);
        let merit = self.merit(set, (z, &self.f), 0.0);
        for _ in 0..HALVINGS {
            for ((trial, z), dz) in self.trial.iter_mut().zip(&*z).zip(&self.dz) {
                *trial = z + length * dz;
            }
            vi.evaluate(&self.trial, &mut self.trial_f);
            let reached = self.merit(vi.set(), (&self.trial, &self.trial_f), length);
            if reached <= (1.0 - ARMIJO * length) * merit {
                z.copy_from_slice(&self.trial);
                self.f.copy_from_slice(&self.trial_f);
                self.y.iter_mut().zip(&self.dy).for_each(|(y, dy)| *y += length * dy);
                self.v.iter_mut().zip(&self.dv).for_each(|(v, dv)| *v += length * dv);
                return true;
            }
            length *= 0.5;
        }
        false
    }

    /// Returns the largest step length, at most 1, for which all distances to bounds and all multipliers stay
    /// nonnegative.
    #[expect(clippy::needless_range_loop, reason = "one index for what belongs to a component")]
    fn reach(&self, set: &ConvexSet, z: &[f64]) -> f64 {
        let mut reach = 1.0_f64;
        for i in 0..z.len() {
            let pairs = [
                (z[i] - set.lower[i], self.dz[i], self.y[i]),
                (set.upper[i] - z[i], -self.dz[i], self.v[i]),
                (self.y[i], self.dy[i], self.y[i]),
                (self.v[i], self.dv[i], self.v[i]),
            ];
            for (value, change, multiplier) in pairs {
                if multiplier > 0.0 && change < 0.0 {
                    reach = reach.min(-value / change);
                }
            }
        }
        reach
    }

    /// Returns the merit function after a step of the given length: the norm of the residuals of the equations plus
    /// the sum of all products of distances and multipliers.
    fn merit(&self, set: &ConvexSet, (z, f): (&[f64], &[f64]), length: f64) -> f64 {
        let (mut squares, mut products) = (0.0, 0.0);
        for i in (0..z.len()).filter(|&i| set.lower[i] < set.upper[i]) {
            let (y, v) = (self.y[i] + length * self.dy[i], self.v[i] + length * self.dv[i]);
            squares += (f[i] - y + v).powi(2);
            let of = |multiplier: f64, distance: f64| if multiplier > 0.0 { multiplier * distance } else { 0.0 };
            products += of(y, z[i] - set.lower[i]) + of(v, set.upper[i] - z[i]);
        }
        squares.sqrt() + products
    }
}
