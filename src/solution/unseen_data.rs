//! Variations of functions of time between the times at which a step evaluates them: pulses shorter than a step,
//! periods equal to the step size, poles. The integrals over a step are computed by bisection and compared with the
//! values that the step uses; interval enclosures prove that nothing is missed between samples. Along the path of a
//! step through the states, enclosures of functions of several states are wide even where nothing is missed: there
//! they only direct the bisection.

use numerics::Interval;

/// Largest number of parts into which a step is bisected to integrate data such as forces. A jump is then located to a
/// sixty-fourth of a step; the remaining width of the enclosures counts as unknown.
const MOST_PARTS: usize = 64;

/// Largest number of parts of a step along its path through the states over which data such as forces are integrated,
/// if no missed value can exceed all values seen so far.
const PARTS_OF_WAY: usize = 8;

/// Difference of two quadrature rules at which they count as equal, relative to the largest value of the function so
/// far: a tenth of the smallest error that the verdict permits.
const AGREE: f64 = 1e-4;

/// Functions of time alone (such as forces), with all other arguments fixed at one end of a step, or along the path of
/// a step.
pub(super) trait InTime {
    /// Writes the values of the functions at the time `t`.
    fn at(&mut self, t: f64, out: &mut [f64]);

    /// Writes enclosures of the values of the functions over the time interval `t`.
    fn enclose(&mut self, t: Interval, out: &mut [Interval]);
}

/// Functions of time and of several states, such as forces.
pub(super) trait OfStates {
    /// Writes the values of the functions at the time `t` and the given states.
    fn at(&mut self, t: f64, states: &[f64], out: &mut [f64]);

    /// Writes enclosures of the values of the functions over the time interval `t` and a box of states.
    fn enclose(&mut self, t: Interval, states: &[Interval], out: &mut [Interval]);
}

/// Returns the value of a single function of time.
pub(super) fn value(of: &mut impl InTime, t: f64) -> f64 {
    let mut value = [0.0];
    of.at(t, &mut value);
    value[0]
}

/// The straight path of a step through the states: their linear interpolation over the step.
pub(super) struct StraightWay<'s> {
    /// The times at the beginning and at the end of the step.
    pub step: [f64; 2],
    /// The states at the beginning and at the end of the step.
    pub states: [&'s [f64]; 2],
}

impl StraightWay<'_> {
    /// Returns state `k` on the path of the step at the time `t`.
    pub fn at(&self, k: usize, t: f64) -> f64 {
        let [from, to] = self.states.map(|state| state[k]);
        from + (t - self.step[0]) / (self.step[1] - self.step[0]) * (to - from)
    }

    /// Returns the range of state `k` over a part of the step.
    pub fn within(&self, k: usize, part: [f64; 2]) -> Interval {
        let [a, b] = part.map(|t| self.at(k, t));
        Interval::new(a.min(b), a.max(b))
    }
}

/// Functions (such as forces) along the straight path of a step through the states; the states are fixed if they are
/// equal at both ends.
pub(super) struct OnWay<'s, F> {
    of: &'s mut F,
    way: StraightWay<'s>,
    between: (Vec<f64>, Vec<Interval>),
}

impl<'s, F> OnWay<'s, F> {
    /// Creates the functions along the straight path of a step, from the states at its beginning to those at its end.
    pub fn new(of: &'s mut F, step: [f64; 2], states: [&'s [f64]; 2]) -> Self {
        let between = (states[0].to_vec(), states[0].iter().map(|state| Interval::point(*state)).collect());
        Self { of, way: StraightWay { step, states }, between }
    }
}

impl<F: OfStates> InTime for OnWay<'_, F> {
    fn at(&mut self, t: f64, out: &mut [f64]) {
        for (k, state) in self.between.0.iter_mut().enumerate() {
            *state = self.way.at(k, t);
        }
        self.of.at(t, &self.between.0, out);
    }

    fn enclose(&mut self, t: Interval, out: &mut [Interval]) {
        for (k, range) in self.between.1.iter_mut().enumerate() {
            *range = self.way.within(k, [t.lo, t.hi]);
        }
        self.of.enclose(t, &self.between.1, out);
    }
}

/// Integrals over steps of functions such as forces, with bounds on the variation that samples may have missed.
#[derive(Clone, Debug, Default)]
pub(super) struct UnseenData {
    /// The largest absolute value of each function so far.
    largest: Vec<f64>,
    /// The integral of each function over the last step, and a bound on the error of the integral.
    pub integrals: Vec<[f64; 2]>,
    left: Vec<[f64; 2]>,
    ranges: Vec<Interval>,
    samples: [Vec<f64>; 3],
    /// Whether the functions are evaluated along the path of a step through the states.
    is_of_way: bool,
}

impl UnseenData {
    /// Creates integrals of functions (such as forces) along the path of a step through the states.
    pub fn of_way() -> Self {
        Self { is_of_way: true, ..Self::default() }
    }

    /// Returns the mean of a friction coefficient over the part of a step in which its contact is closed, and a bound
    /// on the error of the mean. If an impact may close the contact (`is_struck`), its impulse may act with the
    /// coefficient at the beginning of the part, and the bound covers this case.
    pub fn mean(&mut self, part: [f64; 2], is_struck: bool, of: &mut impl InTime) -> [f64; 2] {
        let [mean, left] = if part[0] < part[1] && self.integrate(1, part, of) {
            self.integrals[0].map(|integral| integral / (part[1] - part[0]))
        } else {
            [value(of, part[1]), 0.0]
        };
        [mean, if is_struck { left + (value(of, part[0]) - mean).abs() } else { left }]
    }

    /// Integrates `count` functions (such as forces) over a step; returns false if no function varies significantly in
    /// the step.
    pub fn integrate(&mut self, count: usize, step: [f64; 2], of: &mut impl InTime) -> bool {
        let Self { largest, integrals, left, ranges, samples, is_of_way } = self;
        largest.resize(count, 0.0);
        ranges.resize(count, Interval::LINE);
        samples.iter_mut().for_each(|sample| sample.resize(count, 0.0));
        integrals.clear();
        integrals.resize(count, [0.0; 2]);
        of.enclose(Interval::new(step[0], step[1]), ranges);
        // If a function varies by less than the tolerance of the quadrature rules, samples miss nothing significant.
        let mut may_hide = false;
        for (range, largest) in ranges.iter().zip(largest.iter_mut()) {
            if !range.is_empty() {
                *largest = largest.max(range.magnitudes().0);
            }
            let is_narrow = range.width() <= AGREE * *largest;
            may_hide |= !is_narrow || range.is_empty();
        }
        if !may_hide {
            return false;
        }
        left.clear();
        left.push(step);
        let mut parts = 1;
        while let Some([from, to]) = left.pop() {
            let (h, middle) = (to - from, 0.5 * (from + to));
            for (sample, t) in samples.iter_mut().zip([from, middle, to]) {
                of.at(t, sample);
            }
            of.enclose(Interval::new(from, to), ranges);
            let mut is_known = true;
            let mut may_be_larger = false;
            let mut part = |k: usize| {
                let [a, b, c] = [0, 1, 2].map(|place: usize| samples[place][k]);
                largest[k] = largest[k].max(a.abs()).max(b.abs()).max(c.abs());
                // Simpson's rule, the trapezoidal rule, and the part of the enclosed range that the samples do not
                // account for.
                let (sum, other) = ((a + 4.0 * b + c) / 6.0, 0.25 * (a + 2.0 * b + c));
                let shown = a.max(b).max(c) - a.min(b).min(c);
                let hidden = (ranges[k].width() - 2.0 * shown).max(0.0);
                let error = (sum - other).abs() + hidden;
                is_known &= error <= AGREE * largest[k];
                may_be_larger |= hidden > largest[k];
                [sum * h, error * h]
            };
            let found: Vec<[f64; 2]> = (0..count).map(&mut part).collect();
            let most = if *is_of_way && !may_be_larger { PARTS_OF_WAY } else { MOST_PARTS };
            if is_known || parts >= most || !(from < middle && middle < to) {
                for (sums, [sum, error]) in integrals.iter_mut().zip(found) {
                    sums[0] += sum;
                    sums[1] += if is_known { 0.0 } else { error };
                }
            } else {
                parts += 1;
                left.extend([[middle, to], [from, middle]]);
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A test function of time: a triangular pulse of height one, with the given centre and half-width.
    struct Tent(f64, f64);

    impl InTime for Tent {
        fn at(&mut self, t: f64, out: &mut [f64]) {
            out[0] = (1.0 - (t - self.0).abs() / self.1).max(0.0);
        }

        fn enclose(&mut self, t: Interval, out: &mut [Interval]) {
            let ends = [t.lo, t.hi].map(|t| (1.0 - (t - self.0).abs() / self.1).max(0.0));
            let top = if t.contains(self.0) { 1.0 } else { ends[0].max(ends[1]) };
            out[0] = Interval::new(ends[0].min(ends[1]), top);
        }
    }

    #[test]
    fn a_pulse_between_samples_is_seen() {
        for (centre, width) in [(0.3, 0.01), (0.77, 0.002), (0.123, 0.3)] {
            let mut data = UnseenData::default();
            assert!(data.integrate(1, [0.0, 1.0], &mut Tent(centre, width)));
            let [sum, unknown] = data.integrals[0];
            let before = centre.min(width);
            let exact = 0.5 * width + before - 0.5 * before * before / width;
            assert!((sum - exact).abs() <= unknown + 1e-3, "{sum}, {unknown}");
        }
        assert!(!UnseenData::default().integrate(1, [0.5, 0.6], &mut Tent(0.3, 0.1)));
    }
}
