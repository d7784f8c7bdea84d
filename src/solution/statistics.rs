//! Mean, root of the mean square, least and largest value of outputs over a run, along the dense output: by quadrature, and with
//! the places of extremes found within steps, so that output times play no part.

use super::quadrature::integrate;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// By this part of the distance between samples the place of an extreme is known: its value is then known to the square of that,
/// which is rounding.
const KNOWN: f64 = 1e-8;
/// The part of a bracket that the section by the golden ratio leaves.
const GOLDEN: f64 = 0.618_033_988_749_894_8;

/// What an output is over a length of time.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct OverTime {
    /// Its mean.
    pub mean: f64,
    /// The root of the mean of its square.
    pub rms: f64,
    /// Its least value.
    pub min: f64,
    /// Its largest value.
    pub max: f64,
    /// The largest less the least.
    pub ripple: f64,
}

/// Several outputs on the way of a run.
#[derive(Clone, Debug)]
pub(super) struct Statistics {
    time: f64,
    /// The integrals of all, then of their squares.
    integrals: Vec<f64>,
    least: Vec<f64>,
    largest: Vec<f64>,
}

impl Statistics {
    /// Of so many outputs.
    pub fn new(count: usize) -> Self {
        Self {
            time: 0.0,
            integrals: vec![0.0; 2 * count],
            least: vec![f64::INFINITY; count],
            largest: vec![f64::NEG_INFINITY; count],
        }
    }

    /// Takes a step from one time to another into account; `at` writes the outputs at a time within it.
    pub fn step(&mut self, from: f64, to: f64, mut at: impl FnMut(f64, &mut [f64])) {
        let count = self.least.len();
        let mut samples: Vec<(f64, Vec<f64>)> = Vec::new();
        let mut sample = |t: f64, samples: &mut Vec<(f64, Vec<f64>)>| {
            let mut values = vec![0.0; count];
            at(t, &mut values);
            samples.push((t, values));
        };
        sample(from, &mut samples);
        sample(to, &mut samples);
        integrate(from, to, &mut self.integrals, |t, out| {
            sample(t, &mut samples);
            let values = samples.last().map_or(&[][..], |(_, values)| values);
            let (of_values, of_squares) = out.split_at_mut(count);
            of_values.copy_from_slice(values);
            of_squares.iter_mut().zip(values).for_each(|(square, value)| *square = value * value);
        });
        self.time += to - from;
        samples.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut values = vec![0.0; count];
        for k in 0..count {
            for (sign, extreme) in [(1.0, &mut self.largest[k]), (-1.0, &mut self.least[k])] {
                let best = (0..samples.len())
                    .max_by(|a, b| (sign * samples[*a].1[k]).total_cmp(&(sign * samples[*b].1[k])))
                    .unwrap_or(0);
                if sign * samples[best].1[k] <= sign * *extreme {
                    continue;
                }
                let ends = [best.saturating_sub(1), (best + 1).min(samples.len() - 1)].map(|at| samples[at].0);
                let found = highest(ends, |t| {
                    at(t, &mut values);
                    sign * values[k]
                });
                *extreme = sign * found.max(sign * samples[best].1[k]);
            }
        }
    }

    /// What has come of each output.
    pub fn finish(self) -> Vec<OverTime> {
        let (means, squares) = self.integrals.split_at(self.least.len());
        let extremes = self.least.iter().zip(&self.largest);
        let all = means.iter().zip(squares).zip(extremes);
        all.map(|((mean, square), (&min, &max))| OverTime {
            mean: mean / self.time,
            rms: (square / self.time).max(0.0).sqrt(),
            min,
            max,
            ripple: max - min,
        })
        .collect()
    }
}

/// The largest value of a function between two times between which it has one hill, by sections in the golden ratio.
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
