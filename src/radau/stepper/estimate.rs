//! The error of a step, by four estimates.
//!
//! The first is the embedded estimate `e`, of order `s`, held to a tolerance that is rescaled because the result has
//! order `2s`. The rescaling fails in three cases, each with an estimate of its own.
//!
//! Stiff equations: on `y' = lambda y + g(t)` with `z = h lambda`, the error of one step is `h^(s+1) Psi(z) g^(s)`,
//! where `Psi` is of order `z^(s-1)` at zero but `1/z` at infinity, like `e` itself (Hairer and Wanner 1996, IV.15).
//! With `P = E^-1 (gamma/h) M`, that is `gamma/(gamma - z)`,
//!
//! ```text
//! (I - P)^(s-1) e
//! ```
//!
//! has these orders at zero and at infinity, and the error is between half of it and `s` times it on the whole negative
//! axis, for 3, 5 and 7 stages. It is held to the tolerance that is not rescaled, up to a factor, since stiff errors do
//! not accumulate.
//!
//! Output between steps: `e` vanishes as `1/z`, although the collocation polynomial may miss a solution that varies
//! within the step; its slope then jumps from the last step to this one. The jump, which equals `gamma e` for nonstiff
//! equations, is held to the bound of `gamma e`.
//!
//! Long steps: the order shows only if a step is short compared with the variation of the rates (see `ripple`).
//!
//! The last three estimates are for explicit equations, and for linear ones, in the directions that constraints leave
//! free: in other equations, residues of Newton's method or of rounding do not shrink with the step, and would stall
//! the run.

use super::Radau;
use super::ripple::Ripple;
use crate::consistent_variables::{ConsistentVariables, InverseMass};
use crate::layout::Storage;
use crate::newton_control::mean_square_root;
use crate::orders::Method;
use nalgebra::DVector;
use problem::Mass;

/// Admissible error of one step, in tolerances, if its order is reduced because the equations are stiff.
const STIFF: f64 = 3.0;

/// Workspace of the error estimates of a step.
pub(super) struct Estimates {
    /// The embedded error estimate `e` of each unknown.
    pub error: Vec<f64>,
    /// Jump of the slope of the states into the step, times the step size; empty if the slope before the step is not
    /// known.
    jump: Vec<f64>,
    /// Rounding error of each rate at the beginning of a first step.
    noise: Vec<f64>,
    pub ripple: Ripple,
    pub embedded: Vec<f64>,
    pub shifted: Vec<f64>,
    /// Whether `error` is filtered twice: the estimate of a transient shorter than the step.
    is_filtered_twice: bool,
}

/// Rounding error of a rate, relative to its terms: each term errs by a unit or two, and the errors cancel in part.
pub(super) const ROUNDING: f64 = 4.0 * f64::EPSILON;

impl Estimates {
    pub fn new(unknowns: usize) -> Self {
        let zeros = || vec![0.0; unknowns];
        Self {
            error: zeros(),
            jump: Vec::new(),
            noise: Vec::new(),
            ripple: Ripple::new(unknowns),
            embedded: zeros(),
            shifted: zeros(),
            is_filtered_twice: false,
        }
    }
}

impl Radau<'_> {
    /// Returns the error of the states in a step of size `h`, in units of the tolerance: the largest of all estimates.
    /// The embedded estimate is `E^-1 (Phi(t_n, y_n) + (1/h) diag(M, 0) sum_i D_i Z_i)`, filtered once more if it looks
    /// too large.
    pub(super) fn error(&mut self, h: f64, coupled: bool) -> f64 {
        if coupled && let Some(vi) = &mut self.stage_vi {
            vi.swap_face(&mut self.system);
        }
        let error = self.filtered_error(h, coupled);
        if coupled && let Some(vi) = &mut self.stage_vi {
            vi.swap_face(&mut self.system);
        }
        error
    }

    /// Estimates the errors of a step whose size is prescribed. The embedded estimates, raised to a power, have the
    /// order of the result; they bound nothing, but show what the step size is worth. An estimate that is filtered
    /// twice is that of a transient shorter than the step, whose error at the end has no order: it is not raised to a
    /// power.
    pub(super) fn estimate_given_step(&mut self, h: f64, coupled: bool) {
        let evaluations = self.system.work.rates;
        let is_finite = self.error(h, coupled).is_finite();
        // Evaluations for the error estimate are not counted as work of the method.
        self.system.work.rates = evaluations;
        let power = self.error_power();
        let given = &mut self.last.given;
        let error = |(e, largest): (&f64, &f64)| match self.estimates.is_filtered_twice {
            _ if !is_finite => f64::INFINITY,
            true => e.abs() * largest.max(e.abs()).powf(power - 1.0),
            false => e.abs().powf(power),
        };
        given.at_end.clear();
        given.at_end.extend(self.estimates.error[..self.system.states].iter().zip(&self.extent.largest).map(error));
        if !is_finite {
            given.within.clear();
            given.within.resize(self.system.states, f64::INFINITY);
        }
        (self.last.given.missed, self.last.given.is_blind) = match coupled {
            true => (Vec::new(), self.switching.locates() && self.varies_unseen(h)),
            false => (self.missed_errors(h).unwrap_or_default(), false),
        };
        self.unseen.charge();
    }

    /// Returns the power to which embedded estimates are raised so that they have the order of the method.
    pub fn error_power(&self) -> f64 {
        1.0 / self.orders.current().tolerance.exponent
    }

    fn filtered_error(&mut self, h: f64, coupled: bool) -> f64 {
        let n = self.system.unknowns;
        let states = self.system.states;
        let leaves_no_rest = !coupled && self.leaves_no_rest();
        let is_bound = leaves_no_rest && self.consistent.is_some() && !self.switching.inside.tells_all(&self.system);
        let has_output = self.settings.interpolated && !coupled;
        // On the first step, which has no other slope to start from, nonlinear equations are admissible if they
        // determine their variables: their residuals shrink with the step size.
        let has_slope =
            has_output && (leaves_no_rest || !self.continues && self.switching.inside.tells_all(&self.system));
        if has_slope && !self.continues && self.last.end_slope.is_empty() {
            self.find_first_slope();
        }
        let factors = match &mut self.stage_vi {
            Some(vi) if coupled => vi.factors(),
            _ => &mut self.factors,
        };
        let weights = &self.orders.current().tableau.estimate;
        self.estimates.shifted.fill(0.0);
        for (weight, z) in weights.iter().zip(self.stages.z.chunks_exact(n)) {
            let weight = weight / h;
            for (sum, z) in self.estimates.shifted[..states].iter_mut().zip(z) {
                *sum += weight * z;
            }
        }
        self.estimates.jump.clear();
        if has_slope {
            self.last.jump(h, &self.estimates.shifted[..states], &mut self.estimates.jump);
            let Self { system, control, switching, y, estimates: Estimates { jump, noise, .. }, .. } = self;
            if !self.continues {
                let noise = noise.iter().map(|noise| h * noise);
                jump.iter_mut().zip(noise).for_each(|(jump, noise)| *jump -= jump.clamp(-noise, noise));
            }
            if is_bound && !jump.is_empty() && !switching.constraints.project(system, control, y, jump) {
                jump.clear();
            }
        }
        self.system.multiply_by_mass(&self.estimates.shifted, &mut self.estimates.embedded);
        let mut error = f64::INFINITY;
        for pass in 0..2 {
            self.estimates.is_filtered_twice = pass == 1;
            if pass == 1 {
                for (shifted, (y, e)) in self.estimates.shifted.iter_mut().zip(self.y.iter().zip(&self.estimates.error))
                {
                    *shifted = y + e;
                }
            }
            let y = if pass == 0 { &self.y } else { &self.estimates.shifted };
            if !self.system.phi(self.clock.t, y, &mut self.estimates.error) {
                return f64::INFINITY;
            }
            for (sum, e) in self.estimates.error.iter_mut().zip(&self.estimates.embedded) {
                *sum += e;
            }
            if !factors.solve_real(&mut self.estimates.error) {
                return f64::INFINITY;
            }
            if pass == 0 && self.settings.step.is_some() {
                let within = &mut self.last.given.within;
                within.clear();
                within.extend(self.estimates.error[..states].iter().map(|error| error.abs()));
            }
            error = rms(&self.estimates.error[..states], &self.control.weight);
            if error < 1.0 || !(self.counts.accepted == 0 || self.controller.rejected) {
                break;
            }
        }
        if error.is_nan() {
            return f64::INFINITY;
        }
        if let Some(gamma) = self.tableau().gamma
            && !self.estimates.jump.is_empty()
        {
            error = error.max(rms(&self.estimates.jump, &self.control.weight) / gamma);
        }
        if !leaves_no_rest {
            return error;
        }
        let error = error.max(self.ripple_error(h, error, is_bound));
        error.max(self.stiff_error(h, error, is_bound))
    }

    /// Sets the slope with which the first step of a run or of a face should begin, from the rates at the beginning
    /// of that step: a transient that is short compared with the previous step may follow a switch.
    fn find_first_slope(&mut self) {
        let (t, mut y) = (self.clock.t, self.y.clone());
        let Self { system, control, consistent, switching, .. } = self;
        let are_found = consistent.as_mut().is_some_and(|consistent| consistent.solve(system, control, t, &mut y));
        if !are_found && !switching.inside.tells_all(system) || !system.evaluate(t, &y) {
            return;
        }
        let n = system.states;
        let noise = (0..n).map(|row| ROUNDING * system.terms_of_row(row, |j| [y[j].abs()])[0]);
        let (rates, noise) = (DVector::from_column_slice(&system.values[..n]), DVector::from_iterator(n, noise));
        let (slope, noise) = match (system.mass(), consistent.as_ref().and_then(ConsistentVariables::inverse_mass)) {
            (Mass::Identity, _) => (rates, noise),
            (_, Some(InverseMass::Entries(inverse))) => (inverse * rates, inverse.abs() * noise),
            _ => return,
        };
        self.last.end_slope.extend_from_slice(slope.as_slice());
        self.estimates.noise.clear();
        self.estimates.noise.extend_from_slice(noise.as_slice());
    }

    /// Whether the equations are explicit, or would be after elimination of the variables, and Newton's method leaves
    /// no residual in the equations of the variables: the latter are linear, and are no hidden constraints of a large
    /// system.
    fn leaves_no_rest(&mut self) -> bool {
        self.system.is_explicit_ode()
            || self.system.constant_jacobian()
                && self.consistent.is_some()
                && !self.system.is_curved()
                && (self.switching.inside.tells_all(&self.system)
                    || self.switching.is_to_locate() && matches!(self.system.layout.storage, Storage::Dense))
    }

    /// Returns the norm of `(I - P)^(s-1) e` for the current estimate `e`, in units of the tolerance that is not
    /// rescaled, raised to the power by which the tolerance is rescaled; zero if a lower power of `I - P` already
    /// gives less than `enough`. If constraints bind states, only the directions that the constraints leave free
    /// count.
    fn stiff_error(&mut self, h: f64, enough: f64, is_bound: bool) -> f64 {
        let Method { tableau, tolerance } = self.orders.current();
        let Some(gamma) = tableau.gamma else { return 0.0 };
        let states = self.system.states;
        self.estimates.shifted.copy_from_slice(&self.estimates.error);
        let exponent = tolerance.exponent;
        // The error `enough` raised to the inverse of the exponent is between `enough` and its square.
        let surely_enough = enough.min(enough * enough);
        let is_enough = |left: f64| left <= surely_enough || left <= enough.powf(1.0 / exponent);
        let mut left = f64::INFINITY;
        for power in 0..tableau.stages() {
            if power > 0 {
                self.system.multiply_by_mass(&self.estimates.shifted, &mut self.estimates.embedded);
                self.estimates.embedded.iter_mut().for_each(|e| *e *= gamma / h);
                if !self.factors.solve_real(&mut self.estimates.embedded) {
                    return f64::INFINITY;
                }
                self.estimates.shifted.iter_mut().zip(&self.estimates.embedded).for_each(|(e, smooth)| *e -= smooth);
            }
            let Self { system, control, switching, y, estimates: Estimates { shifted, .. }, .. } = self;
            if is_bound && !switching.constraints.project(system, control, y, shifted) {
                return 0.0;
            }
            left = left.min(tolerance.factor / STIFF * rms(&self.estimates.shifted[..states], &self.control.weight));
            if is_enough(left) {
                return 0.0;
            }
        }
        left.powf(exponent)
    }
}

/// Returns the root mean square of the components of the error `e`, each multiplied by its entry of `weight`.
pub(super) fn rms(e: &[f64], weight: &[f64]) -> f64 {
    let terms = e.iter().zip(weight).map(|(e, w)| e * w);
    mean_square_root(terms.clone().map(|e| e * e).sum(), e.len(), || terms)
}
