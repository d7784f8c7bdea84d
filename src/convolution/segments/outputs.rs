//! Outputs at any time up to the current one: the variables `z`, their integral, and the function `w` of the
//! inequality.

use super::past::{Past, combine};
use super::shape::Shape;
use super::{Part, Segments};
use crate::stepper::StepError;
use nalgebra::DMatrix;
use problem::ConvexSet;

/// Data of the element at which a convolution is evaluated, with the number of elements before it.
pub(super) struct Here<'a> {
    /// The number of elements before the one at which the convolution is evaluated.
    pub before: usize,
    pub shape: &'a Shape,
    /// The time at the beginning of the element at which the convolution is evaluated, and its length.
    pub start: f64,
    pub h: f64,
    /// The coefficients of the variables and of their repeated integrals, one matrix for each number of integrations;
    /// a row for each basis function.
    pub levels: &'a [DMatrix<f64>],
}

/// Adds the convolution `m * z` of the kernel and the variables at the time `theta h` within an element to `out`.
pub(super) fn convolve(
    terms: &mut [Part],
    (past, shapes): (&Past, &[Shape]),
    here: &Here<'_>,
    theta: f64,
    out: &mut [f64],
) -> Result<(), StepError> {
    let Here { before, shape, start, h, levels } = *here;
    let mut row = vec![0.0; shape.len()];
    let (mut sum, mut size) = (vec![0.0; out.len()], vec![0.0; out.len()]);
    for term in terms {
        sum.fill(0.0);
        match &mut term.lag {
            None => {
                shape.evaluate(theta, &mut row);
                combine(&levels[term.level], &row, &mut sum);
            }
            Some(lag) => {
                if theta > 0.0 {
                    lag.within(shape, h, theta, &mut row)?;
                    combine(&levels[term.level], &row, &mut sum);
                }
                past.convolve(lag, shapes, term.level, before, (start, theta * h), &mut sum, &mut size)?;
            }
        }
        for &(row, column, value) in &term.matrix {
            out[row] += value * sum[column];
        }
    }
    Ok(())
}

impl Segments<'_> {
    /// Writes the variables `z`, their integral and `w = m * z + q` at a time within the elements so far to `out`.
    /// The variables are projected onto `K` from their polynomials.
    ///
    /// # Errors
    /// If values are not finite.
    pub fn outputs(&mut self, t: f64, out: &mut [f64]) -> Result<(), StepError> {
        let m = self.places.len();
        let q = self.forcing.at(t, 0, &mut self.set)?;
        let (z, rest) = out.split_at_mut(m);
        let (integral, w) = rest.split_at_mut(m);
        w.copy_from_slice(q);
        let before = self.past.place_of(t);
        let Some(element) = self.past.elements.get(before) else { return Ok(()) };
        let (shape, start, h) = (&self.shapes[element.shape], element.start, element.length());
        let theta = ((t - start) / h).clamp(0.0, 1.0);
        let mut row = vec![0.0; shape.len()];
        shape.evaluate(theta, &mut row);
        combine(&element.coefficients[0], &row, z);
        shape.integrate(theta, &mut row);
        combine(&element.coefficients[0], &row, integral);
        integral.iter_mut().zip(&element.integral).for_each(|(value, start)| *value = start + h * *value);
        let here = Here { before, shape, start, h, levels: &element.coefficients };
        convolve(&mut self.terms, (&self.past, &self.shapes), &here, theta, w)?;
        self.set.project_all(z, &mut self.work);
        Ok(())
    }

    /// Writes the variables `z` at a time within the elements so far, without projection onto `K`.
    pub fn variables_at(&self, t: f64, z: &mut [f64]) {
        let Some(element) = self.past.elements.get(self.past.place_of(t)) else { return };
        let shape = &self.shapes[element.shape];
        let mut row = vec![0.0; shape.len()];
        shape.evaluate(((t - element.start) / element.length()).clamp(0.0, 1.0), &mut row);
        combine(&element.coefficients[0], &row, z);
    }

    /// Returns, for each variable, the mean over time of the absolute difference between this run and another one.
    pub fn mean_distance(&self, other: &Self) -> Vec<f64> {
        let m = self.places.len();
        let (mut own, mut others, mut sums) = (vec![0.0; m], vec![0.0; m], vec![0.0; m]);
        let rule = crate::gauss_jacobi::gauss_jacobi(self.order, 0.0);
        for element in &self.past.elements {
            for &(x, weight) in &rule {
                let t = element.start + x * element.length();
                self.variables_at(t, &mut own);
                other.variables_at(t, &mut others);
                for (sum, (a, b)) in sums.iter_mut().zip(own.iter().zip(&others)) {
                    *sum += weight * element.length() * (a - b).abs();
                }
            }
        }
        sums.iter().map(|sum| sum / (self.t - self.start)).collect()
    }

    /// Returns the largest absolute value of each variable in the run so far.
    pub fn sizes(&self) -> &[f64] {
        &self.size
    }

    /// Returns the set `K` of the variables, with its moving bounds, at the time of the last output.
    pub fn set(&self) -> &ConvexSet {
        &self.set
    }

    /// Returns the values of the variables at the time that the run has reached.
    pub fn ends(&self) -> Vec<f64> {
        let mut z = vec![0.0; self.places.len()];
        self.variables_at(self.t, &mut z);
        z
    }
}
