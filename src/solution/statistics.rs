//! Mean, root mean square, minimum and maximum of outputs over a run, along the dense output: by quadrature, and by
//! searches for extremes within steps, so that output times have no influence.

use super::quadrature::{Integrals, integrate};
use numerics::kronrod;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Relative accuracy of the location of an extreme within its bracket; its value is then accurate to the square of
/// that, which is rounding.
const KNOWN: f64 = 1e-8;
/// Reduction of a bracket by a golden-section step.
const GOLDEN: f64 = 0.618_033_988_749_894_8;

/// Statistics of an output over a time interval.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct OverTime {
    /// The mean.
    pub mean: f64,
    /// The root mean square.
    pub rms: f64,
    /// The minimum.
    pub min: f64,
    /// The maximum.
    pub max: f64,
    /// The maximum minus the minimum.
    pub ripple: f64,
}

/// Statistics of several outputs during a run.
#[derive(Clone, Debug)]
pub(super) struct Statistics {
    time: f64,
    /// The integrals of all outputs, then of their squares.
    integrals: Integrals,
    extremes: Extremes,
    samples: Samples,
}

/// The minima and maxima of several outputs so far.
#[derive(Clone, Debug)]
pub(super) struct Extremes {
    least: Vec<f64>,
    largest: Vec<f64>,
}

/// Samples of outputs within one step, in buffers that are reused.
#[derive(Clone, Debug, Default)]
pub(super) struct Samples {
    times: Vec<f64>,
    /// The values at the first time, then at the second, and so on.
    values: Vec<f64>,
    order: Vec<usize>,
    at_one: Vec<f64>,
}

impl Statistics {
    /// Statistics of `count` outputs.
    pub fn new(count: usize) -> Self {
        let (extremes, samples) = (Extremes::new(count), Samples::default());
        Self { time: 0.0, integrals: Integrals::new(2 * count), extremes, samples }
    }

    /// Adds a step between two times; `at` writes the outputs at a time within it.
    pub fn step(&mut self, from: f64, to: f64, mut at: impl FnMut(f64, &mut [f64])) {
        let count = self.extremes.least.len();
        let Self { integrals, extremes, samples, time } = self;
        samples.begin(count);
        samples.take(from, &mut at);
        samples.take(to, &mut at);
        integrate(from, to, integrals, |t: f64, out: &mut [f64]| {
            let values = samples.take(t, &mut at);
            let (of_values, of_squares) = out.split_at_mut(count);
            of_values.copy_from_slice(values);
            of_squares.iter_mut().zip(values).for_each(|(square, value)| *square = value * value);
        });
        *time += to - from;
        samples.widen(extremes, &mut at);
    }

    /// The largest relative uncertainty of a mean or mean square.
    pub fn uncertainty(&self) -> Option<f64> {
        self.integrals.uncertainty().map(|(_, uncertainty)| uncertainty)
    }

    /// Returns the statistics of each output.
    pub fn finish(self) -> Vec<OverTime> {
        let (means, squares) = self.integrals.values.split_at(self.extremes.least.len());
        let all = means.iter().zip(squares).enumerate();
        all.map(|(k, (mean, square))| {
            let (min, max) = self.extremes.of(k);
            OverTime { mean: mean / self.time, rms: (square / self.time).max(0.0).sqrt(), min, max, ripple: max - min }
        })
        .collect()
    }
}

impl Extremes {
    /// Extremes of `count` outputs, without samples.
    pub fn new(count: usize) -> Self {
        Self { least: vec![f64::INFINITY; count], largest: vec![f64::NEG_INFINITY; count] }
    }

    /// The minimum and the maximum of output `k`.
    pub fn of(&self, k: usize) -> (f64, f64) {
        (self.least[k], self.largest[k])
    }
}

impl Samples {
    /// Adds a step between two times; `at` writes the outputs at a time within it.
    pub fn step(&mut self, extremes: &mut Extremes, from: f64, to: f64, mut at: impl FnMut(f64, &mut [f64])) {
        self.begin(extremes.least.len());
        self.take(from, &mut at);
        self.take(to, &mut at);
        for (t, ..) in kronrod(from, to) {
            self.take(t, &mut at);
        }
        self.widen(extremes, &mut at);
    }

    fn begin(&mut self, count: usize) {
        self.times.clear();
        self.values.clear();
        self.at_one.resize(count, 0.0);
    }

    /// Adds a sample.
    fn take(&mut self, t: f64, at: &mut impl FnMut(f64, &mut [f64])) -> &[f64] {
        let begin = self.values.len();
        self.times.push(t);
        self.values.resize(begin + self.at_one.len(), 0.0);
        at(t, &mut self.values[begin..]);
        &self.values[begin..]
    }

    /// Updates the extremes with the local maxima and minima around the samples.
    fn widen(&mut self, extremes: &mut Extremes, at: &mut impl FnMut(f64, &mut [f64])) {
        let Self { times, values, order, at_one } = self;
        let count = at_one.len();
        order.clear();
        order.extend(0..times.len());
        order.sort_by(|a, b| times[*a].total_cmp(&times[*b]));
        for k in 0..count {
            for (sign, extreme) in [(1.0, &mut extremes.largest[k]), (-1.0, &mut extremes.least[k])] {
                let value = |at: usize| sign * values[order[at] * count + k];
                let best = (0..order.len()).max_by(|a, b| value(*a).total_cmp(&value(*b))).unwrap_or(0);
                if value(best) <= sign * *extreme {
                    continue;
                }
                let ends = [best.saturating_sub(1), (best + 1).min(order.len() - 1)].map(|at| times[order[at]]);
                let found = highest(ends, |t| {
                    at(t, at_one);
                    sign * at_one[k]
                });
                *extreme = sign * found.max(value(best));
            }
        }
    }
}

/// The maximum of a function in an interval where it is unimodal, by golden-section search.
fn highest([mut a, mut b]: [f64; 2], mut value: impl FnMut(f64) -> f64) -> f64 {
    let close = KNOWN * (b - a);
    let (mut left, mut right) = (b - GOLDEN * (b - a), a + GOLDEN * (b - a));
    let (mut at_left, mut at_right) = (value(left), value(right));
    while b - a > close && a < left && right < b {
        if at_left > at_right {
            (b, right, at_right) = (right, left, at_left);
            left = b - GOLDEN * (b - a);
            at_left = value(left);
        } else {
            (a, left, at_left) = (left, right, at_right);
            right = a + GOLDEN * (b - a);
            at_right = value(right);
        }
    }
    at_left.max(at_right)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_has_its_mean_its_root_mean_square_and_its_peaks() {
        let mut statistics = Statistics::new(2);
        let ends = [0.0, 0.7, 2.5, 4.0, std::f64::consts::TAU];
        for pair in ends.windows(2) {
            statistics.step(pair[0], pair[1], |t, out| out.copy_from_slice(&[2.0 + 3.0 * t.sin(), t * t]));
        }
        let [sine, square] = statistics.finish()[..] else { panic!("two outputs") };
        assert!((sine.mean - 2.0).abs() < 1e-14 && (sine.rms - 8.5_f64.sqrt()).abs() < 1e-14, "{sine:?}");
        assert!((sine.max - 5.0).abs() < 1e-14 && (sine.min + 1.0).abs() < 1e-14, "{sine:?}");
        assert!((sine.ripple - 6.0).abs() < 1e-14);
        let end = std::f64::consts::TAU;
        assert_eq!((square.min, square.max), (0.0, end * end));
    }
}
