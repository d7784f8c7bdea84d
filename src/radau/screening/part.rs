//! Parts of a step, with the Bernstein polynomials of the unknowns over each part.

use crate::tableau::Tableau;
use numerics::{Interval, bernstein};

/// A part of a step: `theta` in `[begin, begin + length]`, as fractions of the step, and the Bernstein coefficients of
/// each unknown over the part, unknown by unknown.
#[derive(Clone, Debug, Default)]
pub(crate) struct Part {
    pub begin: f64,
    pub length: f64,
    coefficients: Vec<f64>,
    /// Number of Bernstein coefficients of each unknown.
    count: usize,
}

impl Part {
    /// Sets the part to the whole step that begins at `y` and has the stage increments `increments`.
    pub fn set_whole(&mut self, tableau: &Tableau, y: &[f64], increments: &[f64]) {
        let (s, n) = (tableau.stages(), y.len());
        let of_stages = tableau.bernstein();
        (self.begin, self.length, self.count) = (0.0, 1.0, s + 1);
        self.coefficients.clear();
        for (j, &start) in y.iter().enumerate() {
            self.coefficients.extend((0..=s).map(|i| {
                let stages = of_stages.iter().zip(increments.chunks_exact(n));
                start + stages.map(|(of_stage, increment)| of_stage[i] * increment[j]).sum::<f64>()
            }));
        }
    }

    /// Keeps the first half of the part of the step, and writes its second half to `second`.
    pub fn halve(&mut self, second: &mut Self) {
        self.length *= 0.5;
        (second.begin, second.length, second.count) = (self.begin + self.length, self.length, self.count);
        second.coefficients.resize(self.coefficients.len(), 0.0);
        let halves =
            self.coefficients.chunks_exact_mut(self.count).zip(second.coefficients.chunks_exact_mut(self.count));
        halves.for_each(|(first, second)| bernstein::halve(first, second));
    }

    /// Returns the position `theta` of the midpoint of the part, as a fraction of the step.
    pub fn middle(&self) -> f64 {
        self.begin + 0.5 * self.length
    }

    /// Writes the ranges of the unknowns over the part of the step to `out`.
    pub fn ranges(&self, out: &mut [Interval]) {
        let unknowns = self.coefficients.chunks_exact(self.count);
        unknowns.zip(out).for_each(|(coefficients, range)| *range = bernstein::range(coefficients));
    }

    /// Returns the range of the derivative of an unknown with respect to the position `u` in `[0, 1]` within the
    /// part.
    pub fn rate(&self, unknown: usize) -> Interval {
        let first = unknown * self.count;
        bernstein::range_of_rate(&self.coefficients[first..first + self.count])
    }

    /// Returns the range of the derivative of `sum_j c_j y_j` with respect to the position `u` in `[0, 1]` within the
    /// part, where the `c_j` of the terms `(j, c_j)` are intervals: the sum with their midpoints is formed before its
    /// range is taken, so that unknowns that vary together do not widen the range.
    pub fn rate_of_sum(&self, terms: &[(usize, Interval)]) -> Interval {
        let mut sum = vec![0.0; self.count];
        let (mut beside, mut size) = (0.0, 0.0);
        for &(unknown, factor) in terms {
            let of_unknown = &self.coefficients[unknown * self.count..(unknown + 1) * self.count];
            let (middle, radius) = factor.ball();
            if !(factor.defined && radius.is_finite()) {
                return Interval::LINE;
            }
            let largest = of_unknown.iter().fold(0.0_f64, |largest, c| largest.max(c.abs()));
            size += middle.abs() * largest;
            sum.iter_mut().zip(of_unknown).for_each(|(sum, c)| *sum += middle * c);
            if radius > 0.0 {
                beside += radius * self.rate(unknown).magnitudes().1;
            }
        }
        let rate = bernstein::range_of_rate(&sum);
        let beside = beside + bernstein::rounding_of_rate(self.count, size) * terms.len() as f64;
        rate + Interval::new(-beside, beside)
    }

    /// Writes the unknowns at the position `u` in `[0, 1]` within the part to `out`.
    pub fn values(&self, u: f64, out: &mut [f64]) {
        let unknowns = self.coefficients.chunks_exact(self.count);
        unknowns.zip(out).for_each(|(coefficients, value)| *value = bernstein::value(coefficients, u));
    }
}
