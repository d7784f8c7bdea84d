//! Interpolants of a run: polynomials through the values of the fields at Chebyshev points of each step, so that
//! values at other times need no further solve.
//!
//! Radau IIA itself has polynomials for the states, but variables and outputs are functions of the states. So all
//! fields are sampled in the same way: at `n + 1` points `cos(pi k/n)`, with `n` doubled until the interpolant agrees
//! with the values halfway between its points (Trefethen 2013, *Approximation Theory and Approximation Practice*,
//! chapters 2 and 5, with the barycentric formula). A polynomial of degree `n` is reproduced up to rounding.

use std::f64::consts::PI;

/// The first number of intervals between Chebyshev points in a step: exact for three stages of Radau IIA.
const FIRST: usize = 4;
/// The largest number of intervals between Chebyshev points in a step: a field that needs more is not smooth within the
/// step.
const MOST: usize = 64;
/// Differences of an interpolant below this fraction of the largest value of a field are rounding errors.
const ROUNDING: f64 = 1e-13;

/// The fields of a run as functions of time, by piecewise interpolation over its steps.
#[derive(Clone, Debug)]
pub struct Dense {
    fields: usize,
    /// The start time of the run with its row of fields: variables may jump immediately after the start.
    start: (f64, Vec<f64>),
    pieces: Vec<Piece>,
    /// The rows of fields at the Chebyshev points of all pieces, one after the other.
    values: Vec<f64>,
    /// The largest difference of an interpolant from the values of the run, relative to the largest value of a field.
    pub deviation: f64,
}

/// The interpolant of all fields over one step of the run.
#[derive(Clone, Copy, Debug)]
struct Piece {
    begin: f64,
    end: f64,
    /// The index of the first value of the interpolant of the step, and the number of intervals between its Chebyshev
    /// points.
    first: usize,
    intervals: usize,
}

/// The construction of the interpolants of a run.
#[derive(Debug)]
pub(super) struct Sampling {
    dense: Dense,
    /// The permitted difference of an interpolant from the values of the run, relative to the largest value of a field.
    tolerance: f64,
    most_values: usize,
    /// The largest absolute value of each field in the run so far.
    largest: Vec<f64>,
    /// Whether some step of the run could not be interpolated.
    is_broken: bool,
}

impl Dense {
    /// Writes the fields at a time of the run; returns false for a time outside the run.
    pub fn at(&self, t: f64, out: &mut [f64]) -> bool {
        if t == self.start.0 {
            out.copy_from_slice(&self.start.1);
            return true;
        }
        // A time at the end of a step takes the values of that step, as in the output of a run.
        let place = self.pieces.partition_point(|piece| piece.end < t);
        match self.pieces.get(place).filter(|piece| piece.begin <= t) {
            Some(piece) => {
                interpolate(&self.values[piece.first..], piece.intervals, piece.position(t), out);
                true
            }
            None => false,
        }
    }

    /// Returns the number of fields that are interpolated.
    pub fn fields(&self) -> usize {
        self.fields
    }
}

impl Piece {
    /// Maps a time within the step of the interpolant to the interval from -1 to 1.
    fn position(&self, t: f64) -> f64 {
        2.0 * ((t - self.begin) / (self.end - self.begin)) - 1.0
    }
}

/// Returns Chebyshev point `k` of `n + 1` points, which increase from -1 to 1.
fn point(k: usize, n: usize) -> f64 {
    // The sine is symmetric, and exactly zero in the middle (Trefethen 2013, chapter 2).
    (0.5 * PI * (2.0 * k as f64 - n as f64) / n as f64).sin()
}

/// Interpolates between Chebyshev points by the barycentric formula; weights have alternating signs, and half the size
/// at the ends.
fn interpolate(values: &[f64], n: usize, x: f64, out: &mut [f64]) {
    let fields = out.len();
    out.fill(0.0);
    let mut sum = 0.0;
    for (k, row) in values.chunks_exact(fields.max(1)).take(n + 1).enumerate() {
        let distance = x - point(k, n);
        if distance == 0.0 {
            out.copy_from_slice(row);
            return;
        }
        let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
        let weight = if k == 0 || k == n { 0.5 * sign / distance } else { sign / distance };
        sum += weight;
        out.iter_mut().zip(row).for_each(|(out, value)| *out += weight * value);
    }
    out.iter_mut().for_each(|out| *out /= sum);
}

impl Sampling {
    /// Creates the interpolants of a run with the row of fields at its start.
    pub fn new(start: f64, row: Vec<f64>, tolerance: f64, most_values: usize) -> Self {
        let largest = row.iter().map(|value| value.abs()).collect();
        let dense =
            Dense { fields: row.len(), start: (start, row), pieces: Vec::new(), values: Vec::new(), deviation: 0.0 };
        Self { dense, tolerance: tolerance.max(ROUNDING), most_values, largest, is_broken: false }
    }

    /// Samples and interpolates the fields over a step; `row` writes the fields at a time within the step.
    pub fn step(&mut self, begin: f64, end: f64, mut row: impl FnMut(f64, &mut [f64])) {
        let fields = self.dense.fields;
        if self.is_broken || fields == 0 || end <= begin {
            return;
        }
        let mut at = |k: usize, n: usize| {
            let mut values = vec![0.0; fields];
            let t = begin + 0.5 * (1.0 + point(k, n)) * (end - begin);
            row(
                if k == 0 {
                    begin
                } else if k == n {
                    end
                } else {
                    t
                },
                &mut values,
            );
            values
        };
        let mut n = FIRST;
        let mut rows: Vec<Vec<f64>> = (0..=n).map(|k| at(k, n)).collect();
        let mut found = vec![0.0; fields];
        loop {
            let flat = rows.concat();
            let between: Vec<Vec<f64>> = (0..n).map(|k| at(2 * k + 1, 2 * n)).collect();
            for row in rows.iter().chain(&between) {
                self.largest.iter_mut().zip(row).for_each(|(largest, value)| *largest = largest.max(value.abs()));
            }
            let mut deviation = 0.0_f64;
            for (k, row) in between.iter().enumerate() {
                interpolate(&flat, n, point(2 * k + 1, 2 * n), &mut found);
                for ((found, value), largest) in found.iter().zip(row).zip(&self.largest) {
                    let difference = (found - value).abs();
                    // A field that has been zero so far has no size to which the difference of its interpolant could be
                    // related.
                    let part = if difference == 0.0 { 0.0 } else { difference / largest };
                    deviation = if part > deviation || part.is_nan() { part } else { deviation };
                }
            }
            if deviation <= self.tolerance {
                self.dense.deviation = self.dense.deviation.max(deviation);
                self.keep(Piece { begin, end, first: self.dense.values.len(), intervals: n }, &flat);
                return;
            }
            if n == MOST || !deviation.is_finite() {
                self.is_broken = true;
                return;
            }
            let mut next = Vec::with_capacity(2 * n + 1);
            let mut between = between.into_iter();
            for row in rows {
                next.push(row);
                next.extend(between.next());
            }
            (rows, n) = (next, 2 * n);
        }
    }

    fn keep(&mut self, piece: Piece, values: &[f64]) {
        self.is_broken |= self.dense.values.len() + values.len() > self.most_values;
        if !self.is_broken {
            self.dense.pieces.push(piece);
            self.dense.values.extend_from_slice(values);
        }
    }

    /// Returns the interpolants of the run, if every step could be interpolated.
    pub fn finish(self) -> Option<Dense> {
        (!self.is_broken).then_some(self.dense)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sampled(steps: &[f64], tolerance: f64, f: impl Fn(f64) -> [f64; 2]) -> Option<Dense> {
        let mut sampling = Sampling::new(steps[0], f(steps[0]).to_vec(), tolerance, 1 << 20);
        for pair in steps.windows(2) {
            sampling.step(pair[0], pair[1], |t, out| out.copy_from_slice(&f(t)));
        }
        sampling.finish()
    }

    #[test]
    fn a_polynomial_is_met_to_rounding() {
        let f = |t: f64| [t.powi(4) - 3.0 * t, 0.0];
        let dense = sampled(&[0.0, 0.3, 1.0], 1e-9, f).unwrap();
        let mut out = [0.0; 2];
        for k in 0..=1000 {
            let t = f64::from(k) / 1000.0;
            assert!(dense.at(t, &mut out));
            assert!((out[0] - f(t)[0]).abs() < 1e-14 && out[1] == 0.0);
        }
        assert!(!dense.at(-1e-9, &mut out) && !dense.at(1.1, &mut out) && !dense.at(f64::NAN, &mut out));
    }

    #[test]
    fn a_smooth_function_is_met_to_the_tolerance_that_is_asked_for() {
        let f = |t: f64| [(3.0 * t).sin(), (-t).exp()];
        for tolerance in [1e-6, 1e-9, 1e-12] {
            let dense = sampled(&[0.0, 1.0, 3.0], tolerance, f).unwrap();
            let (mut out, mut worst) = ([0.0; 2], 0.0_f64);
            for k in 0..=3000 {
                let t = f64::from(k) / 1000.0;
                assert!(dense.at(t, &mut out));
                worst = worst.max((out[0] - f(t)[0]).abs()).max((out[1] - f(t)[1]).abs());
            }
            // Between the times of comparison, the error of an interpolant may be a small multiple of that at these
            // times.
            assert!(worst < 4.0 * tolerance, "{worst:e} at {tolerance:e}");
        }
    }

    #[test]
    fn what_jumps_within_a_step_has_no_interpolant() {
        assert!(sampled(&[0.0, 1.0], 1e-6, |t| [f64::from(t > 0.37), 0.0]).is_none());
        assert!(sampled(&[0.0, 1.0], 1e-6, |t| [1.0 / (t - 0.5), 0.0]).is_none());
        // A field may jump between two steps.
        let dense = sampled(&[0.0, 0.5, 1.0], 1e-9, |t| [t, t]).unwrap();
        let mut out = [0.0; 2];
        assert!(dense.at(0.5, &mut out) && out == [0.5; 2]);
    }
}
