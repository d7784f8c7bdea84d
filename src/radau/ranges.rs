//! Ranges of the states and of their slopes over a part of the last step: Bernstein ranges of the polynomials of the
//! dense output, including the bubble that corrects the slope at the beginning of the step.

use super::stepper::Radau;
use numerics::{Interval, bernstein};

impl Radau<'_> {
    /// Returns enclosures of the states over `[from, to]` within the last step: the ranges of their polynomials.
    pub(super) fn ranges_of_polynomials(&self, from: f64, to: f64) -> Vec<Interval> {
        let [from, to] = [from, to].map(|t| ((t - self.last.t) / self.last.h).clamp(0.0, 1.0));
        let range = |mut coefficients: Vec<f64>| {
            restrict(&mut coefficients, from, to);
            bernstein::range(&coefficients)
        };
        self.polynomials().into_iter().map(range).collect()
    }

    /// Returns the slopes (time derivatives) of the states at time `t` within the last step, from their polynomials.
    pub(super) fn slopes_of_polynomials(&self, t: f64) -> Vec<f64> {
        let theta = (t - self.last.t) / self.last.h;
        let slope = |coefficients: Vec<f64>| {
            let differences: Vec<f64> = coefficients.windows(2).map(|pair| pair[1] - pair[0]).collect();
            differences.len() as f64 * bernstein::value(&differences, theta) / self.last.h
        };
        self.polynomials().into_iter().map(slope).collect()
    }

    /// Returns the Bernstein coefficients of the polynomial of each state over the last step, of degree `s + 1`.
    fn polynomials(&self) -> Vec<Vec<f64>> {
        let tableau = self.orders.last().tableau;
        let (s, n) = (tableau.stages(), self.system.unknowns);
        let (of_stages, bubble) = (tableau.bernstein(), tableau.bubble_in_bernstein());
        let state = |j: usize| {
            let along = |i: usize| (0..s).map(|stage| of_stages[stage][i] * self.last.z[stage * n + j]).sum::<f64>();
            let along: Vec<f64> = (0..=s).map(along).collect();
            let slope = self.last.slope.get(j).copied().unwrap_or(0.0);
            let coefficient = |i: usize| {
                // Elevate the degree of the Bernstein polynomial by one.
                let part = i as f64 / (s + 1) as f64;
                let before = if i > 0 { part * along[i - 1] } else { 0.0 };
                let here = if i <= s { (1.0 - part) * along[i] } else { 0.0 };
                self.last.y[j] + (before + here) + slope * bubble[i]
            };
            (0..s + 2).map(coefficient).collect()
        };
        (0..self.system.states).map(state).collect()
    }
}

/// Restricts a polynomial, given by its Bernstein coefficients, to the part `[from, to]` of its interval `[0, 1]`, by
/// de Casteljau's algorithm at both ends.
fn restrict(coefficients: &mut [f64], from: f64, to: f64) {
    let count = coefficients.len();
    for round in 1..count {
        for i in (round..count).rev() {
            coefficients[i] = coefficients[i - 1] + to * (coefficients[i] - coefficients[i - 1]);
        }
    }
    let from = if to > 0.0 { from / to } else { 0.0 };
    for round in 1..count {
        for i in 0..count - round {
            coefficients[i] += from * (coefficients[i + 1] - coefficients[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_of_a_polynomial_is_the_same_polynomial() {
        let whole = [3.0 / 16.0, -5.0 / 16.0, 3.0 / 16.0];
        let mut part = whole;
        restrict(&mut part, 0.2, 0.7);
        for u in [0.0, 0.3, 1.0] {
            assert!((bernstein::value(&part, u) - bernstein::value(&whole, 0.2 + 0.5 * u)).abs() < 1e-15, "at {u}");
        }
    }
}
