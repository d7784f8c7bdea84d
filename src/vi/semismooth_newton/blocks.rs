//! Semismooth Newton on the natural map `F(z) = z - P_K(z - S w)` over any set, with one positive scale `S` for each
//! block.
//!
//! With `V` an element of the B-subdifferential of `P_K` at `z - S w`, a step solves
//!
//! ```text
//! (I - V (I - S A - mu I)) d = -F(z)
//! ```
//!
//! (Facchinei and Pang 2003, section 7.5; for cones `V` is that of the Jordan-algebra projection). `mu` is small
//! relative to `|F|` and keeps the matrix regular if `A` is singular. The full step is taken if it lowers `|F|`
//! enough; otherwise Armijo's search along it on the D-gap function decides (Peng and Fukushima 1999, *A hybrid
//! Newton method for solving the variational inequality problem via the D-gap function*). If that search fails too,
//! some iterations of Douglas-Rachford splitting give a new start; the splitting continues its own sequence, which
//! converges for every monotone problem.

use crate::d_gap::Gap;
use crate::residual::Gauge;
use crate::splitting::Splitting;
use crate::{Accuracy, AffineVi, EXACT, Outcome, Report, is_interrupted};
use factorisation::DenseLu;
use problem::{Control, Derivative, Workspace};

/// Largest total number of Newton steps in one solve.
const ITERATIONS: usize = 200;

/// Convergence is fast if a Newton step lowers the residual to this fraction.
const FAST: f64 = 0.1;

/// A full Newton step is accepted if it lowers the norm of the natural map to this fraction of the least value so
/// far.
const DECREASE: f64 = 0.9;

/// Weights `mu` of the proximal term, relative to `|F| / |z|` with the natural map `F`. They are tried in turn until
/// a direction lowers the merit function.
const PROXIMAL: [f64; 4] = [1e-6, 1e-3, 1e-1, 1.0];

/// Armijo's fraction of the slope, the largest number of halvings of a step, and the fraction to which the line
/// search must lower the D-gap function.
const ARMIJO: f64 = 1e-4;
const HALVINGS: usize = 12;
const WORTHWHILE: f64 = 0.99;

/// Number of iterations in one run of the Douglas-Rachford splitting, and the largest number of such runs in one solve.
const SPLITTING: usize = 100;
const SPLITTINGS: usize = 50;

/// Semismooth Newton over any closed convex set. Its workspace grows with the problems.
#[derive(Debug, Default)]
pub(crate) struct BlockNewton {
    gauge: Gauge,
    gap: Gap,
    derivative: Derivative,
    work: Workspace,
    z: Vec<f64>,
    w: Vec<f64>,
    /// The negative natural map at the iterate, `P_K(z - S w) - z`.
    defect: Vec<f64>,
    direction: Vec<f64>,
    gradient: Vec<f64>,
    trial: Vec<f64>,
    trial_w: Vec<f64>,
    column: Vec<f64>,
    /// The LU factors of the matrix of the last Newton step.
    lu: Option<DenseLu<f64>>,
}

impl BlockNewton {
    /// Solves the variational inequality from `z`, and writes the result to `z`.
    pub fn solve(&mut self, vi: &AffineVi<'_>, z: &mut [f64], control: &Control) -> Report {
        if !vi.is_sound() {
            return Report::BREAKDOWN;
        }
        self.load(vi, z);
        let mut splitting = None;
        let mut splittings = 0;
        let mut best = self.offer(vi, z, None);
        let mut iterations = 0;
        let mut least = f64::INFINITY;
        let mut converging = true;
        let mut failure = Outcome::Limit;
        while iterations < ITERATIONS && best.componentwise > EXACT && (converging || !best.is_solved()) {
            if is_interrupted(control, iterations) {
                failure = Outcome::Interrupted;
                break;
            }
            iterations += 1;
            least = self.linearise(vi).min(least);
            if !self.newton(vi, least) {
                if best.is_solved() || splittings == SPLITTINGS {
                    break;
                }
                splittings += 1;
                if control.poll().is_some() {
                    failure = Outcome::Interrupted;
                    break;
                }
                let split = splitting.get_or_insert_with(|| Splitting::new(vi, &self.gap.scale, &self.z, &self.w));
                let Some(split) = split else { break };
                split.iterate(vi, &self.gap.scale, SPLITTING, &mut self.z);
                least = f64::INFINITY;
            }
            let found = self.offer(vi, z, Some(best));
            converging = found.componentwise <= FAST * best.componentwise;
            best = found;
        }
        if best.residual.is_nan() {
            return Report { iterations, ..Report::BREAKDOWN };
        }
        best.report(failure, iterations)
    }

    fn load(&mut self, vi: &AffineVi<'_>, z: &[f64]) {
        let m = z.len();
        for vector in [
            &mut self.z,
            &mut self.w,
            &mut self.defect,
            &mut self.direction,
            &mut self.gradient,
            &mut self.trial,
            &mut self.trial_w,
            &mut self.column,
        ] {
            vector.resize(m, 0.0);
        }
        if self.lu.as_ref().is_none_or(|lu| lu.dimension() != m) {
            self.lu = Some(DenseLu::new(m));
        }
        vi.scales(&mut self.gap.scale);
        for (target, z) in self.z.iter_mut().zip(z) {
            *target = if z.is_finite() { *z } else { 0.0 };
        }
        vi.set.project_all(&mut self.z, &mut self.work);
    }

    /// Measures the residual of the projected point `P_K(z - S w)`, and writes the point to `z` if it is the best so
    /// far. Unlike the iterate, the projected point lies exactly on the active face of `K` at the limit of the
    /// iterates.
    fn offer(&mut self, vi: &AffineVi<'_>, z: &mut [f64], best: Option<Accuracy>) -> Accuracy {
        vi.product(&self.z, &mut self.w);
        for (((trial, z), w), s) in self.trial.iter_mut().zip(&self.z).zip(&self.w).zip(&self.gap.scale) {
            *trial = z - s * w;
        }
        vi.set.project_all(&mut self.trial, &mut self.work);
        let found = self.gauge.measure(vi, &self.trial);
        match best {
            Some(best) if found.residual.is_nan() || found.componentwise >= best.componentwise => best,
            _ => {
                z.copy_from_slice(&self.trial);
                found
            }
        }
    }

    /// Computes `w = A z + q`, the negative natural map and the generalised Jacobian `V` of the projection onto `K`
    /// at the iterate; returns the norm of the natural map.
    fn linearise(&mut self, vi: &AffineVi<'_>) -> f64 {
        vi.product(&self.z, &mut self.w);
        for (((x, z), w), s) in self.defect.iter_mut().zip(&self.z).zip(&self.w).zip(&self.gap.scale) {
            *x = z - s * w;
        }
        self.derivative.linearise(vi.set, &mut self.defect, &mut self.work);
        self.defect.iter_mut().zip(&self.z).for_each(|(p, z)| *p -= z);
        length(&self.defect, &self.gap.scale)
    }

    /// Moves the iterate along a Newton direction; returns false if no step lowers the natural map or the D-gap
    /// function enough.
    fn newton(&mut self, vi: &AffineVi<'_>, least: f64) -> bool {
        let norm = length(&self.defect, &self.gap.scale);
        let size = length(&self.z, &self.gap.scale);
        let relative = if size > norm { norm / size } else { 1.0 };
        let merit = self.gap.value(vi.set, &self.z, &self.w);
        let m = self.z.len();
        let column = |j: usize| &vi.matrix.as_slice()[j * m..][..m];
        self.gap.gradient(&self.z, |j, v| dot(column(j), v), &mut self.gradient);
        for proximal in PROXIMAL {
            if !self.direction(vi, proximal * relative) {
                continue;
            }
            self.step(vi, 1.0);
            if self.defect_at_trial(vi) <= DECREASE * least {
                self.z.copy_from_slice(&self.trial);
                return true;
            }
            let slope = dot(&self.gradient, &self.direction);
            let mut step = 1.0;
            for _ in 0..HALVINGS {
                self.step(vi, step);
                let reached = self.gap.value(vi.set, &self.trial, &self.trial_w);
                if reached <= merit + ARMIJO * step * slope && reached <= WORTHWHILE * merit {
                    self.z.copy_from_slice(&self.trial);
                    return true;
                }
                step *= 0.5;
            }
        }
        false
    }

    /// Computes the Newton direction with the weight `mu` of the proximal term. Returns false if the matrix is
    /// singular.
    fn direction(&mut self, vi: &AffineVi<'_>, mu: f64) -> bool {
        let m = self.z.len();
        let Some(lu) = &mut self.lu else { return false };
        for (j, out) in lu.entries().chunks_exact_mut(m.max(1)).enumerate() {
            // Column `j` of the matrix of the Newton step, with the generalised Jacobian `V` of the projection onto
            // `K`, is e_j + V (S A + mu I - I) e_j.
            let source = &vi.matrix.as_slice()[j * m..][..m];
            for ((x, a), s) in self.column.iter_mut().zip(source).zip(&self.gap.scale) {
                *x = s * a;
            }
            self.column[j] += mu - 1.0;
            self.derivative.apply(vi.set, &self.column, out);
            out[j] += 1.0;
        }
        lu.factorise();
        self.direction.copy_from_slice(&self.defect);
        lu.solve(&mut self.direction)
    }

    fn step(&mut self, vi: &AffineVi<'_>, step: f64) {
        for ((trial, z), d) in self.trial.iter_mut().zip(&self.z).zip(&self.direction) {
            *trial = z + step * d;
        }
        vi.product(&self.trial, &mut self.trial_w);
    }

    /// Returns the norm of the natural map at the trial point.
    fn defect_at_trial(&mut self, vi: &AffineVi<'_>) -> f64 {
        for (((x, z), w), s) in self.column.iter_mut().zip(&self.trial).zip(&self.trial_w).zip(&self.gap.scale) {
            *x = z - s * w;
        }
        vi.set.project_all(&mut self.column, &mut self.work);
        self.column.iter_mut().zip(&self.trial).for_each(|(p, z)| *p -= z);
        length(&self.column, &self.gap.scale)
    }
}

/// Returns the scaled norm `sqrt(sum x_i^2 / s_i)`.
fn length(x: &[f64], scale: &[f64]) -> f64 {
    x.iter().zip(scale).map(|(x, s)| x * x / s).sum::<f64>().sqrt()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
