//! The error of a step that is long compared with the variation of the rates.
//!
//! If the step is short, the Legendre coefficients of the slope of the collocation polynomial decrease by a factor
//! `r < 1` from one degree to the next, and the error of the result is about `r^(s-1) e`, where `e` is the embedded
//! estimate. This error is held to the tolerance that is not rescaled: a ripple that is small beside the rest of a
//! rate, and has many periods within the step, has `r = 1` and the error `e`.
//!
//! Both `e` and `r` may vanish by chance for some step size, whatever the rates are, so each is found in two ways. The
//! first coefficient that the stages do not show is about `r` times the last one that they show, so `e` is at least
//! `P/gamma` times that product, with the filter `P = E^-1 (gamma/h) M` of stiff directions that `e` has passed as
//! well. And `r` is at least `gamma e` divided by the last coefficient.

use super::Radau;
use super::estimate::{Estimates, rms};
use crate::orders::Method;
use crate::stages::combine;

/// Fraction of the tolerance below which an error does not limit the growth of the step: the next estimate detects an
/// increase.
const NEGLIGIBLE: f64 = 1e-3;

/// The last Legendre coefficients of the slope of each state, times the step size, with workspace for the error that
/// they suggest.
pub(super) struct Ripple {
    /// The largest magnitude among the last Legendre coefficients of each state, with the sign of the last one.
    last: Vec<f64>,
    /// The decrease of the Legendre coefficients of each state over the last half of the degrees, as a ratio.
    fall: Vec<f64>,
    expected: Vec<f64>,
    /// The Legendre coefficients of all unknowns, degree by degree.
    coefficients: Vec<f64>,
}

impl Ripple {
    pub fn new(unknowns: usize) -> Self {
        let zeros = || vec![0.0; unknowns];
        Self { last: zeros(), fall: zeros(), expected: zeros(), coefficients: Vec::new() }
    }
}

impl Radau<'_> {
    /// Returns the norm of `r^(s-1) e`, in units of the tolerance that is not rescaled, raised to the power by which
    /// the tolerance is rescaled. If constraints bind states, only the directions that the constraints leave free
    /// count.
    ///
    /// Returns zero if the norm is certainly not above `enough`.
    pub(super) fn ripple_error(&mut self, h: f64, enough: f64, is_bound: bool) -> f64 {
        let Method { tableau, tolerance } = *self.orders.current();
        let Some(gamma) = tableau.gamma.filter(|_| tableau.stages() >= 3) else { return 0.0 };
        let states = self.system.states;
        self.estimates.shifted.copy_from_slice(&self.estimates.error);
        let Self { system, control, switching, y, estimates: Estimates { shifted, .. }, .. } = self;
        if is_bound && !switching.constraints.project(system, control, y, shifted) {
            return 0.0;
        }
        self.find_falls();
        // If constraints bind states, the coefficients contain the rounding errors of the constraints as well.
        if !is_bound {
            self.take_expected(h, gamma);
        }
        let degrees = tableau.stages() - 1;
        let power = degrees as f64 / half(degrees) as f64;
        // The exponent of the decrease, `s - 1` divided by half of that, is two for all methods with an odd number of
        // stages up to seven.
        let raise = |fall: f64| if power == 2.0 { fall * fall } else { fall.powf(power) };
        let Estimates { shifted, ripple, .. } = &mut self.estimates;
        for ((e, last), fall) in shifted[..states].iter_mut().zip(&ripple.last).zip(&ripple.fall) {
            *e *= raise(fall.max((gamma * *e / last).abs().min(1.0)));
        }
        let error = tolerance.factor * rms(&shifted[..states], &self.control.weight);
        // Rounding errors of the stage increments have coefficients of all degrees: a negligible error is treated as
        // zero. The exponent of the tolerance is between a half and one.
        let is_enough = error.max(error.sqrt()) <= enough;
        if error < NEGLIGIBLE || is_enough { 0.0 } else { error.powf(tolerance.exponent) }
    }

    /// Finds the last Legendre coefficients of the slopes of the states over the step, and their decrease with the
    /// degree.
    fn find_falls(&mut self) {
        let (tableau, n) = (self.tableau(), self.system.unknowns);
        let s = tableau.stages();
        // Use several degrees, since a single coefficient may vanish by chance.
        let count = half(s - 1);
        let (first, before) = (s - count, s - count - count.max(2));
        let Ripple { last, fall, coefficients, .. } = &mut self.estimates.ripple;
        coefficients.resize(s * n, 0.0);
        combine(tableau.spectrum.as_slice(), &self.stages.z, coefficients, n);
        let states = self.system.states;
        let find_largest = |degrees: &[f64], largest: &mut [f64]| {
            largest.fill(0.0);
            for of_degree in degrees.chunks_exact(n) {
                largest
                    .iter_mut()
                    .zip(of_degree)
                    .for_each(|(largest, of_state)| *largest = largest.max(of_state.abs()));
            }
        };
        find_largest(&coefficients[first * n..], &mut last[..states]);
        find_largest(&coefficients[before * n..first * n], &mut fall[..states]);
        let ends = &coefficients[(s - 1) * n..][..states];
        for ((last, fall), end) in last.iter_mut().zip(fall).zip(ends) {
            *fall = if *last < *fall { *last / *fall } else { 1.0 };
            *last = last.copysign(*end);
        }
    }

    /// Raises the embedded estimate to the error that the Legendre coefficients suggest, if that is larger.
    fn take_expected(&mut self, h: f64, gamma: f64) {
        let Self { system, factors, estimates: Estimates { shifted, embedded, ripple, .. }, .. } = self;
        let states = system.states;
        let Ripple { last, fall, expected, .. } = ripple;
        for ((expected, last), fall) in expected[..states].iter_mut().zip(last).zip(fall) {
            *expected = *fall * *last / h;
        }
        // Skip the linear solve that filters the expected errors if its result cannot matter: it can only make them
        // smaller.
        if expected[..states].iter().zip(&*shifted).all(|(expected, e)| h * expected.abs() <= gamma * e.abs()) {
            return;
        }
        system.multiply_by_mass(expected, embedded);
        if factors.solve_real(embedded) {
            shifted[..states].iter_mut().zip(embedded).for_each(|(e, expected)| *e = e.abs().max(expected.abs()));
        }
    }
}

/// Returns half the number of degrees of Legendre coefficients: the upper half of the degrees counts as the last
/// coefficients.
fn half(degrees: usize) -> usize {
    degrees / 2
}
