//! Semismooth Newton on the natural map over intervals, globalised by a Fischer-Burmeister merit function.
//!
//! ```text
//! z - P_K(z - S w) = 0,    w = A z + q
//! ```
//!
//! An element of the B-subdifferential of the natural map has the row `e_i` where `z - S w` lies outside the interval
//! and `(S A)_i` inside, so that a Newton step solves one system in the variables inside and sets the others to their
//! bounds. The iteration ends after finitely many steps, but alone it may cycle. A step is therefore taken only if it
//! lowers
//!
//! ```text
//! Psi(z) = 1/2 |psi(z_i, (S w)_i)|^2
//! ```
//!
//! enough; otherwise the Newton direction of `psi` with Armijo's line search is taken, or the steepest descent if
//! that direction is not one of descent (De Luca, Facchinei and Kanzow 1996, *A semismooth equation approach to the
//! solution of nonlinear complementarity problems*; Facchinei and Pang 2003, sections 8.3 and 9.1). `S` is diagonal.

use crate::elimination::solve_augmented;
use crate::equilibration::Equilibration;
use crate::fischer_burmeister::psi;
use crate::{Accuracy, AffineVi, EXACT, Outcome, Report, TOLERANCE, is_interrupted};
use nalgebra::DMatrixViewMut;
use problem::Control;

/// Largest number of Newton steps; practical problems take five to thirty.
const ITERATIONS: usize = 100;

/// Convergence is fast if a Newton step lowers the residual to this fraction.
const FAST: f64 = 0.1;

/// A Newton step of the natural map is accepted if it lowers the norm of the Fischer-Burmeister function `psi` to
/// this fraction.
const NATURAL_DECREASE: f64 = 0.9;

/// Condition on a direction of descent, with the Fischer-Burmeister function `psi` and `Psi = 1/2 |psi|^2`: the slope
/// of `Psi` along the direction is at most `-DESCENT |psi|^2`; along an exact Newton direction it is `-|psi|^2 = -2
/// Psi`.
const DESCENT: f64 = 0.01;

/// Armijo's fraction of the slope, and the largest number of halvings of a step.
const ARMIJO: f64 = 1e-4;
const HALVINGS: usize = 40;

/// A diagonal entry of the equilibrated matrix below this value is too small to scale the row by.
const SMALL_DIAGONAL: f64 = 1.0 / 64.0;

/// Weights `mu` of the proximal term, relative to the norm of the Fischer-Burmeister function `psi`. The term keeps
/// the Jacobian regular if `A` is singular; it vanishes with `|psi|`, and so preserves the order of convergence. With
/// a small term the direction may run along the kernel of `A`, and a large one turns it away from descent. The next
/// weight is tried if the last one has not lowered `|psi|` to the fraction `SUFFICIENT_DECREASE`.
const PROXIMAL: [f64; 3] = [1e-1, 1e-3, 1e-6];
const SUFFICIENT_DECREASE: f64 = 0.7;

/// Semismooth Newton over intervals.
#[derive(Debug)]
pub struct IntervalNewton {
    equilibration: Equilibration,
    /// The scaled problem: the matrix `S R A C`, the vector `S R q` and the intervals, where `R` and `C` equilibrate
    /// `A` and `S` scales rows by the diagonal.
    matrix: Vec<f64>,
    q: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    /// The iterate `z`, the scaled value `S w`, and the Fischer-Burmeister function `psi` with its generalised
    /// gradient.
    z: Vec<f64>,
    w: Vec<f64>,
    psi: Vec<f64>,
    by_z: Vec<f64>,
    by_w: Vec<f64>,
    gradient: Vec<f64>,
    direction: Vec<f64>,
    trial: Vec<f64>,
    best: Vec<f64>,
    augmented: Vec<f64>,
    inside: Vec<usize>,
    candidate: Vec<f64>,
    work: [Vec<f64>; 2],
}

impl IntervalNewton {
    /// Allocates the workspace for problems of up to `m` variables; grows for a larger one.
    pub fn new(m: usize) -> Self {
        let vector = || vec![0.0; m];
        Self {
            equilibration: Equilibration::new(m),
            matrix: vec![0.0; m * m],
            q: vector(),
            lower: vector(),
            upper: vector(),
            z: vector(),
            w: vector(),
            psi: vector(),
            by_z: vector(),
            by_w: vector(),
            gradient: vector(),
            direction: vector(),
            trial: vector(),
            best: vector(),
            augmented: vec![0.0; m * (m + 1)],
            inside: Vec::with_capacity(m),
            candidate: vector(),
            work: [vector(), vector()],
        }
    }
}

impl IntervalNewton {
    /// Solves the variational inequality from `z`, and writes the result to `z`.
    pub fn solve(&mut self, vi: &AffineVi<'_>, z: &mut [f64], control: &Control) -> Report {
        self.resize(vi.q.len());
        if !self.equilibration.fit(vi) {
            return Report::BREAKDOWN;
        }
        self.load(vi, z);
        let mut best = self.offer(vi, z, None);
        let mut iterations = 0;
        let mut converging = true;
        let mut failure = Outcome::Limit;
        // Once the problem is solved in every row, continue as long as steps converge fast. While rows with
        // relatively small terms are unsolved, continue up to the iteration limit.
        while iterations < ITERATIONS && best.componentwise > EXACT && (converging || best.componentwise > TOLERANCE) {
            if is_interrupted(control, iterations) {
                failure = Outcome::Interrupted;
                break;
            }
            iterations += 1;
            self.linearise();
            let norm = norm(&self.psi);
            if self.natural_step() && self.residual_norm_at_trial() <= NATURAL_DECREASE * norm {
                self.z.copy_from_slice(&self.trial);
            } else if !self.descend(norm) {
                break;
            }
            let found = self.offer(vi, z, Some(best));
            converging = found.residual <= FAST * best.residual || found.componentwise <= FAST * best.componentwise;
            best = found;
        }
        if best.residual.is_nan() {
            return Report { iterations, ..Report::BREAKDOWN };
        }
        best.report(failure, iterations)
    }

    fn resize(&mut self, m: usize) {
        if m == self.q.len() {
            return;
        }
        self.equilibration.resize(m);
        self.matrix.resize(m * m, 0.0);
        self.augmented.resize(m * (m + 1), 0.0);
        for vector in [
            &mut self.q,
            &mut self.lower,
            &mut self.upper,
            &mut self.z,
            &mut self.w,
            &mut self.psi,
            &mut self.by_z,
            &mut self.by_w,
            &mut self.gradient,
            &mut self.direction,
            &mut self.trial,
            &mut self.best,
            &mut self.candidate,
        ] {
            vector.resize(m, 0.0);
        }
        for vector in &mut self.work {
            vector.resize(m, 0.0);
        }
    }

    /// Scales the problem. `S` is the inverse of the diagonal of the equilibrated matrix `R A C` where that is large
    /// enough.
    fn load(&mut self, vi: &AffineVi<'_>, z: &[f64]) {
        let m = self.q.len();
        let Equilibration { row, column, .. } = &self.equilibration;
        let scale = &mut self.work[0];
        for i in 0..m {
            let diagonal = (vi.matrix[(i, i)] * row[i] * column[i]).abs();
            scale[i] = if diagonal < SMALL_DIAGONAL { row[i] } else { row[i] / diagonal };
            self.q[i] = scale[i] * vi.q[i];
            self.lower[i] = vi.set.lower[i] / column[i];
            self.upper[i] = vi.set.upper[i] / column[i];
            let start = if z[i].is_finite() { z[i] } else { 0.0 };
            self.z[i] = vi.set.project(i, start) / column[i];
        }
        let sources = vi.matrix.as_slice().chunks_exact(m.max(1));
        for ((target, source), &c) in self.matrix.chunks_exact_mut(m.max(1)).zip(sources).zip(column) {
            for ((t, &a), &s) in target.iter_mut().zip(source).zip(&*scale) {
                *t = a * s * c;
            }
        }
    }

    /// Converts the iterate to the units of the problem, and writes it to `z` if it is the best point so far.
    fn offer(&mut self, vi: &AffineVi<'_>, z: &mut [f64], best: Option<Accuracy>) -> Accuracy {
        for (i, &c) in self.equilibration.column.iter().enumerate() {
            self.candidate[i] = vi.set.project(i, self.z[i] * c);
        }
        let [w, terms] = &mut self.work;
        let found = vi.measure(&self.candidate, w, terms);
        match best {
            Some(best) if !found.improves_on(&best) => best,
            _ => {
                z.copy_from_slice(&self.candidate);
                found
            }
        }
    }

    fn evaluate_at_z(&mut self) {
        evaluate(&self.matrix, &self.q, &self.z, &mut self.w);
    }

    /// Computes the Fischer-Burmeister function `psi` and its generalised gradient at the iterate.
    fn linearise(&mut self) {
        self.evaluate_at_z();
        for i in 0..self.q.len() {
            let at = psi(self.z[i], self.w[i], self.lower[i], self.upper[i]);
            (self.psi[i], self.by_z[i], self.by_w[i]) = (at.value, at.by_z, at.by_w);
        }
    }

    /// Computes the Newton step of the natural map from the iterate, and writes its end point to `trial`. Returns
    /// false if the linear system of the step is singular.
    fn natural_step(&mut self) -> bool {
        let m = self.q.len();
        self.inside.clear();
        for i in 0..m {
            let moved = self.z[i] - self.w[i];
            self.trial[i] = moved.clamp(self.lower[i], self.upper[i]);
            if moved > self.lower[i] && moved < self.upper[i] {
                self.inside.push(i);
                self.trial[i] = 0.0;
            }
        }
        let k = self.inside.len();
        // Evaluate `w` with the inactive variables set to zero; their solution must cancel it.
        evaluate(&self.matrix, &self.q, &self.trial, &mut self.direction);
        let storage = &mut self.augmented[..k * (k + 1)];
        for (target, &j) in storage.chunks_exact_mut(k.max(1)).zip(&self.inside) {
            let column = &self.matrix[j * m..][..m];
            for (t, &i) in target.iter_mut().zip(&self.inside) {
                *t = column[i];
            }
        }
        for (t, &i) in storage[k * k..].iter_mut().zip(&self.inside) {
            *t = -self.direction[i];
        }
        if !solve_augmented(&mut DMatrixViewMut::from_slice(storage, k, k + 1)) {
            return false;
        }
        for (&x, &i) in self.augmented[k * k..].iter().zip(&self.inside) {
            self.trial[i] = x;
        }
        self.trial.iter().all(|z| z.is_finite())
    }

    /// Returns the norm of the Fischer-Burmeister function `psi` at the trial point.
    fn residual_norm_at_trial(&mut self) -> f64 {
        let w = &mut self.work[0];
        evaluate(&self.matrix, &self.q, &self.trial, w);
        let mut sum = 0.0;
        for (i, &w) in w.iter().enumerate() {
            let value = psi(self.trial[i], w, self.lower[i], self.upper[i]).value;
            sum += value * value;
        }
        sum.sqrt()
    }

    /// Makes a step by Armijo's line search along the Newton direction of the Fischer-Burmeister function `psi`, or
    /// along the steepest descent of `Psi = 1/2 |psi|^2`. Returns false if neither lowers `Psi`.
    fn descend(&mut self, norm: f64) -> bool {
        let m = self.q.len();
        let work = &mut self.work[0];
        for ((x, &psi), &by_w) in work.iter_mut().zip(&self.psi).zip(&self.by_w) {
            *x = psi * by_w;
        }
        for (j, column) in self.matrix.chunks_exact(m.max(1)).enumerate() {
            self.gradient[j] = self.by_z[j] * self.psi[j] + dot(column, work);
        }
        let mut reached = norm;
        self.best.copy_from_slice(&self.z);
        for proximal in PROXIMAL {
            if reached <= SUFFICIENT_DECREASE * norm || !self.newton_direction(proximal * norm.min(1.0)) {
                break;
            }
            let slope = dot(&self.gradient, &self.direction);
            if slope <= -DESCENT * norm * norm {
                reached = self.search(norm, slope, reached);
            }
        }
        if reached == norm {
            for (d, &g) in self.direction.iter_mut().zip(&self.gradient) {
                *d = -g;
            }
            let slope = -dot(&self.gradient, &self.gradient);
            reached = self.search(norm, slope, reached);
        }
        self.z.copy_from_slice(&self.best);
        reached < norm
    }

    /// Computes the Newton direction `d` of the Fischer-Burmeister function `psi`, whose derivatives by `z` and `w`
    /// are `by_z` and `by_w`: solves `(diag(by_z) + diag(by_w) (A + mu I)) d = -psi`.
    fn newton_direction(&mut self, mu: f64) -> bool {
        let m = self.q.len();
        for (j, column) in self.matrix.chunks_exact(m.max(1)).enumerate() {
            let target = &mut self.augmented[j * m..][..m];
            for ((t, &a), &by_w) in target.iter_mut().zip(column).zip(&self.by_w) {
                *t = a * by_w;
            }
            target[j] += self.by_z[j] + mu * self.by_w[j];
        }
        for (t, &psi) in self.augmented[m * m..].iter_mut().zip(&self.psi) {
            *t = -psi;
        }
        if !solve_augmented(&mut DMatrixViewMut::from_slice(&mut self.augmented, m, m + 1)) {
            return false;
        }
        self.direction.copy_from_slice(&self.augmented[m * m..]);
        self.direction.iter().all(|d| d.is_finite())
    }

    /// Makes Armijo's line search from the iterate, at which the Fischer-Burmeister function `psi` has the given
    /// norm. Keeps the point found in `best` if its norm is below `record`, and returns the smaller of the two norms.
    fn search(&mut self, norm: f64, slope: f64, record: f64) -> f64 {
        let mut step = 1.0;
        for _ in 0..HALVINGS {
            for ((trial, &z), &d) in self.trial.iter_mut().zip(&self.z).zip(&self.direction) {
                *trial = z + step * d;
            }
            let reached = self.residual_norm_at_trial();
            if 0.5 * reached * reached <= 0.5 * norm * norm + ARMIJO * step * slope {
                if reached < record {
                    self.best.copy_from_slice(&self.trial);
                    return reached;
                }
                break;
            }
            step *= 0.5;
        }
        record
    }
}

/// Computes `w = A z + q`.
fn evaluate(matrix: &[f64], q: &[f64], z: &[f64], w: &mut [f64]) {
    w.copy_from_slice(q);
    for (column, &z) in matrix.chunks_exact(q.len().max(1)).zip(z) {
        if z != 0.0 {
            for (w, &a) in w.iter_mut().zip(column) {
                *w += a * z;
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}
