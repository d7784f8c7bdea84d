//! A scalar kernel `t^(e-1) g(t)` and its integrals against the basis functions of an element. Quadrature rules are
//! exact for the singularities, of the kernel at zero and of the functions at the beginning of the element; smooth
//! factors are integrated to rounding.

use super::shape::Shape;
use crate::gauss_jacobi::gauss_jacobi;
use crate::kernel::Function;
use crate::stepper::StepError;
use expression::{IntervalWorkspace, Tape};
use numerics::Interval;

/// Number of nodes of each quadrature rule, exact for polynomials of degree 47: the functions of an element have
/// degree ten at most, so that a factor of the kernel may vary over an element like a polynomial of degree 37.
const NODES: usize = 24;
/// If the time since the end of an element is below this fraction of its length, the integral of the kernel over the
/// element is the difference of two integrals that begin at the singularity. The functions of the element are then
/// extrapolated by at most this fraction: at that distance a Legendre polynomial of degree eight is `5e2`, so that
/// less than three digits cancel. A larger fraction would lose more (`8e3` for a half), a smaller one would leave
/// kernels that vary over more decades of the lag to the other quadrature rule.
const ADJACENT: f64 = 0.25;

/// A scalar kernel as a function of the lag, other than a multiple of the identity.
pub struct Lag {
    exponent: f64,
    factor: Option<Tape>,
    slope: Option<Tape>,
    /// The value of `g` if the kernel has no smooth factor of its own: `1 / Gamma(e)`.
    constant: f64,
    at_zero: Vec<(f64, f64)>,
    plain: Vec<(f64, f64)>,
    at_switch: Vec<(f64, f64)>,
}

impl Lag {
    /// Prepares a scalar kernel, without the repeated integrations that `function` may ask for; returns `None` for
    /// the identity. `beta` is the exponent of the singular basis functions behind switches.
    pub fn new(function: &Function, beta: f64) -> Option<Self> {
        if function.factor.is_none() && function.exponent == 0.0 {
            return None;
        }
        let exponent = function.exponent;
        Some(Self {
            exponent,
            factor: function.factor.clone(),
            slope: function.slope.clone(),
            constant: 1.0 / gamma(exponent),
            at_zero: gauss_jacobi(NODES, exponent - 1.0),
            plain: gauss_jacobi(NODES, 0.0),
            at_switch: gauss_jacobi(NODES, beta),
        })
    }

    /// Evaluates the smooth factor `g` at a lag.
    fn smooth(&mut self, lag: f64) -> Result<f64, StepError> {
        let Some(factor) = &mut self.factor else { return Ok(self.constant) };
        let mut value = [0.0];
        factor.evaluate(lag, &[], &mut value);
        if value[0].is_finite() { Ok(value[0]) } else { Err(StepError::Kernel { lag }) }
    }

    /// Evaluates the scalar kernel at a lag (time difference).
    pub fn value(&mut self, lag: f64) -> Result<f64, StepError> {
        let smooth = self.smooth(lag)?;
        Ok(if self.exponent == 1.0 { smooth } else { smooth * lag.powf(self.exponent - 1.0) })
    }

    /// Returns bounds on the magnitudes of the smooth factor `g` of the kernel and of its derivative over the lags up
    /// to `length`.
    pub fn bounds(&self, length: f64) -> [f64; 2] {
        let lags = Interval::new(0.0, length);
        let bound = |tape: &Tape| {
            let mut range = [Interval::LINE];
            tape.enclose(lags, &[], &mut IntervalWorkspace::new(tape), &mut range);
            if range[0].is_empty() { f64::INFINITY } else { range[0].magnitudes().1 }
        };
        match &self.factor {
            None => [self.constant, 0.0],
            Some(factor) => [bound(factor), self.slope.as_ref().map_or(f64::INFINITY, bound)],
        }
    }

    /// Returns the integral of the singular factor `t^(e-1)` of the kernel over the lags from zero to `length`.
    pub fn integral_of_power(&self, length: f64) -> f64 {
        length.powf(self.exponent) / self.exponent
    }

    /// Writes the integrals of the scalar kernel against the basis functions of an element of length `h`, at the time
    /// `theta h` within the element, to `out`.
    pub fn within(&mut self, shape: &Shape, h: f64, theta: f64, out: &mut [f64]) -> Result<(), StepError> {
        out.fill(0.0);
        let whole = if shape.is_singular() { 0.5 * theta } else { theta };
        self.add_from_singularity(shape, h, theta, whole * h, 1.0, out)?;
        if shape.is_singular() {
            // The singular basis functions need the split of the element into two parts, since they are singular at its
            // beginning; one rule for each part serves all functions.
            self.add_beginning(shape, h, 0.5 * theta, theta, out)?;
        }
        Ok(())
    }

    /// Writes the integrals of the scalar kernel against the basis functions of an element of length `h`, at the time
    /// `from` after the end of the element, to `out`.
    pub fn behind(&mut self, shape: &Shape, h: f64, from: f64, out: &mut [f64]) -> Result<(), StepError> {
        out.fill(0.0);
        let theta = 1.0 + from / h;
        let length = if shape.is_singular() { 0.5 * h } else { h };
        if from < ADJACENT * length {
            self.add_from_singularity(shape, h, theta, from + length, 1.0, out)?;
            self.add_from_singularity(shape, h, theta, from, -1.0, out)?;
        } else {
            let mut values = vec![0.0; out.len()];
            let (first, ratio) = (from.ln(), ((from + length) / from).ln());
            for place in 0..self.plain.len() {
                let (x, w) = self.plain[place];
                let lag = (first + ratio * x).exp();
                let weight = w * ratio * lag * self.value(lag)?;
                shape.evaluate(theta - lag / h, &mut values);
                add(out, &values, weight);
            }
        }
        if shape.is_singular() {
            self.add_beginning(shape, h, 0.5, theta, out)?;
        }
        Ok(())
    }

    /// Adds `sign` times the integrals of the scalar kernel against the basis functions over the lags from zero to
    /// `length`, at the time `theta h`, to `out`.
    fn add_from_singularity(
        &mut self,
        shape: &Shape,
        h: f64,
        theta: f64,
        length: f64,
        sign: f64,
        out: &mut [f64],
    ) -> Result<(), StepError> {
        if length == 0.0 {
            return Ok(());
        }
        let mut values = vec![0.0; out.len()];
        let scale = sign * length.powf(self.exponent);
        for place in 0..self.at_zero.len() {
            let (x, w) = self.at_zero[place];
            let weight = scale * w * self.smooth(length * x)?;
            shape.evaluate(theta - length * x / h, &mut values);
            add(out, &values, weight);
        }
        Ok(())
    }

    /// Adds the integrals of the scalar kernel against the basis functions over the first part of an element, up to
    /// `end`, at the later time `theta h`, to `out`.
    fn add_beginning(&mut self, shape: &Shape, h: f64, end: f64, theta: f64, out: &mut [f64]) -> Result<(), StepError> {
        let mut values = vec![0.0; out.len()];
        for place in 0..self.plain.len() {
            let (x, w) = self.plain[place];
            let weight = h * end * w * self.value(h * (theta - end * x))?;
            shape.polynomials(false, end * x, &mut values);
            add(out, &values, weight);
            let (x, w) = self.at_switch[place];
            let weight = h * end.powf(1.0 + shape.beta) * w * self.value(h * (theta - end * x))?;
            shape.polynomials(true, end * x, &mut values);
            add(out, &values, weight);
        }
        Ok(())
    }
}

fn add(out: &mut [f64], values: &[f64], weight: f64) {
    out.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
}

/// Computes `Gamma(x)` for `x > 0`, by Stirling's series far from zero.
fn gamma(x: f64) -> f64 {
    let (mut x, mut product) = (x, 1.0);
    while x < 20.0 {
        product *= x;
        x += 1.0;
    }
    let inverse = 1.0 / x;
    let square = inverse * inverse;
    let series = inverse * (1.0 / 12.0 - square * (1.0 / 360.0 - square * (1.0 / 1260.0 - square / 1680.0)));
    (std::f64::consts::TAU / x).sqrt() * (x * (x.ln() - 1.0) + series).exp() / product
}
