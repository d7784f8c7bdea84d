//! A globally convergent fallback of the active set method that cannot cycle: it takes the step of the active set if
//! that lowers
//!
//! ```text
//! Psi(z) = 1/2 |psi(z_i, w_i / A_ii)|^2,    w = A z + q
//! ```
//!
//! enough, else a damped Newton step on the Fischer-Burmeister equation `psi = 0`, else a step of steepest descent
//! (De Luca, Facchinei and Kanzow 1996, *A semismooth equation approach to the solution of nonlinear complementarity
//! problems*). With rows divided by the derivatives of `psi` by `w`, the Newton matrix is `A` plus a nonnegative
//! diagonal: it keeps the pattern and the symmetry of `A`.

use super::super::fischer_burmeister::{Psi, psi};
use super::{Face, Level};
use problem::{Control, ConvexSet};

/// Largest number of steps of the line search method; practical problems take five to thirty steps.
const ITERATIONS: usize = 100;

/// A step of the active set method is accepted if it lowers the norm of the Fischer-Burmeister function `psi` to this
/// fraction.
const DECREASE: f64 = 0.9;

/// A variable counts as at its bound if, in the Fischer-Burmeister function `psi`, the derivative by `w` is below
/// this fraction of the derivative by `z`.
const NEGLIGIBLE: f64 = 1e-12;

/// Condition on a direction of descent, with the Fischer-Burmeister function `psi` and `Psi = 1/2 |psi|^2`: the slope
/// of `Psi` along the direction is at most `-DESCENT |psi|^2`; along an exact Newton direction it is `-|psi|^2 = -2
/// Psi`.
const DESCENT: f64 = 0.01;

/// Armijo's fraction of the slope in the line search, and the largest number of halvings of a step.
const ARMIJO: f64 = 1e-4;
const HALVINGS: usize = 40;

/// Proximal term added to the diagonal of `A`, relative to the diagonal entry and to the norm of the
/// Fischer-Burmeister function `psi`; it regularises a singular `A`.
const PROXIMAL: f64 = 1e-3;

/// The line search method, the fallback of the active set method, with its workspace for `n` variables.
pub(super) struct LineSearch {
    psi: Vec<Psi>,
    shift: Vec<f64>,
    gradient: Vec<f64>,
    direction: Vec<f64>,
    trial: Vec<f64>,
}

impl LineSearch {
    pub fn new(n: usize) -> Self {
        let vector = || vec![0.0; n];
        Self {
            psi: vec![Psi { value: 0.0, by_z: 0.0, by_w: 0.0 }; n],
            shift: vector(),
            gradient: vector(),
            direction: vector(),
            trial: vector(),
        }
    }

    /// Improves `z` until it solves the problem or no step lowers the merit function `Psi = 1/2 |psi|^2`; returns the
    /// number of steps.
    pub fn run(&mut self, level: &mut Level, q: &[f64], set: &ConvexSet, z: &mut [f64], control: &Control) -> usize {
        for (i, z) in z.iter_mut().enumerate() {
            *z = set.project(i, if z.is_finite() { *z } else { 0.0 });
        }
        for iteration in 0..ITERATIONS {
            if level.measure(q, set, z).0 || control.poll().is_some() {
                return iteration;
            }
            let norm = self.linearise(level, set, z);
            if self.active_set_step(level, q, set, z, control) && self.norm_at_trial(level, q, set) <= DECREASE * norm {
                z.copy_from_slice(&self.trial);
            } else if !self.descend(level, q, set, z, norm, control) {
                return iteration + 1;
            }
        }
        ITERATIONS
    }

    /// Evaluates the Fischer-Burmeister function `psi` and its derivatives by `z` and `w / A_ii` at `z`; `w` is read
    /// from `level`. Returns the norm `|psi|`.
    fn linearise(&mut self, level: &Level, set: &ConvexSet, z: &[f64]) -> f64 {
        let scale = level.operator.inverse_diagonal();
        let mut sum = 0.0;
        for (i, at) in self.psi.iter_mut().enumerate() {
            *at = psi(z[i], scale[i] * level.w[i], set.lower[i], set.upper[i]);
            sum += at.value * at.value;
        }
        sum.sqrt()
    }

    /// Computes into `trial` the solution of the linear system of the active set that is guessed from `z` and `w`.
    fn active_set_step(&mut self, level: &mut Level, q: &[f64], set: &ConvexSet, z: &[f64], control: &Control) -> bool {
        for (i, (trial, &z)) in self.trial.iter_mut().zip(z).enumerate() {
            *trial = z - level.operator.inverse_diagonal()[i] * level.w[i];
        }
        level.guess(set, &self.trial);
        level.fit(set);
        level.solve_on_face(q, set, &mut self.trial, control)
    }

    fn norm_at_trial(&mut self, level: &mut Level, q: &[f64], set: &ConvexSet) -> f64 {
        level.operator.apply(q, &self.trial, &mut level.w, &mut level.terms);
        let scale = level.operator.inverse_diagonal();
        let values = self.trial.iter().enumerate().map(|(i, &z)| {
            let value = psi(z, scale[i] * level.w[i], set.lower[i], set.upper[i]).value;
            value * value
        });
        values.sum::<f64>().sqrt()
    }

    /// Makes a step by Armijo's line search along Newton's direction, or along steepest descent. Returns false if
    /// neither lowers the merit function `Psi = 1/2 |psi|^2`.
    fn descend(
        &mut self,
        level: &mut Level,
        q: &[f64],
        set: &ConvexSet,
        z: &mut [f64],
        norm: f64,
        control: &Control,
    ) -> bool {
        let scale = level.operator.inverse_diagonal();
        for (i, at) in self.psi.iter().enumerate() {
            self.gradient[i] = at.by_z * at.value;
            self.direction[i] = scale[i] * at.by_w * at.value;
        }
        level.operator.add_transposed(&self.direction, &mut self.gradient);
        if self.newton_direction(level, norm, control) {
            let slope = self.gradient.iter().zip(&self.direction).map(|(g, d)| g * d).sum::<f64>();
            if slope <= -DESCENT * norm * norm && self.search(level, q, set, z, (norm, slope)) {
                return true;
            }
        }
        let slope = -self.gradient.iter().map(|g| g * g).sum::<f64>();
        for (direction, gradient) in self.direction.iter_mut().zip(&self.gradient) {
            *direction = -gradient;
        }
        self.search(level, q, set, z, (norm, slope))
    }

    /// Computes the Newton direction `d` of the Fischer-Burmeister function `psi`, whose derivatives by `z` and `w`
    /// are `by_z` and `by_w`: solves `(diag(by_z) + diag(by_w / A_ii) A) d = -psi`.
    fn newton_direction(&mut self, level: &mut Level, norm: f64, control: &Control) -> bool {
        let proximal = PROXIMAL * norm.min(1.0);
        for (i, at) in self.psi.iter().enumerate() {
            let by_w = at.by_w * level.operator.inverse_diagonal()[i];
            let on_bound = at.by_w <= NEGLIGIBLE * at.by_z;
            level.face[i] = if on_bound { Face::Lower } else { Face::Inside };
            self.direction[i] = -at.value / if on_bound { at.by_z } else { by_w };
            self.shift[i] = if on_bound { 0.0 } else { at.by_z / by_w + proximal * at.by_w / by_w };
        }
        level.operator.solve(&level.face, Some(&self.shift), &mut self.direction, control)
    }

    fn search(
        &mut self,
        level: &mut Level,
        q: &[f64],
        set: &ConvexSet,
        z: &mut [f64],
        (norm, slope): (f64, f64),
    ) -> bool {
        let mut step = 1.0;
        for _ in 0..HALVINGS {
            for ((trial, &z), &d) in self.trial.iter_mut().zip(&*z).zip(&self.direction) {
                *trial = z + step * d;
            }
            let reached = self.norm_at_trial(level, q, set);
            if 0.5 * reached * reached <= 0.5 * norm * norm + ARMIJO * step * slope && reached < norm {
                z.copy_from_slice(&self.trial);
                return true;
            }
            step *= 0.5;
        }
        false
    }
}
