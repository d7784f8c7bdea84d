//! Minima and maxima of functions along the dense output of a run. Samples and local searches find candidates;
//! interval enclosures over parts of a step show whether and where a larger value may lie between samples, such as a
//! pulse much narrower than the step.

use hybrid::Followed;
use numerics::{Interval, kronrod};

/// Relative accuracy of the location of a smooth extreme in its bracket, whose value is then accurate to rounding
/// errors (the square of this number); also the permitted excess over an extreme between samples, relative to its
/// size.
const KNOWN: f64 = 1e-8;
/// Factor by which one golden-section step reduces the bracket of an extreme of a function.
const GOLDEN: f64 = 0.618_033_988_749_894_8;
/// Largest number of parts of a step over which functions are enclosed. A pulse needs two parts for each binary digit
/// of its width.
const MOST_PARTS: usize = 1000;

/// The minima and maxima of several functions over the part of a run that has been examined.
#[derive(Clone, Debug)]
pub(super) struct Extremes {
    least: Vec<f64>,
    largest: Vec<f64>,
    samples: Samples,
    /// Enclosures of the functions over a part of a step, and the widths of the enclosures at a single time, which are
    /// due to rounding.
    ranges: Vec<Interval>,
    rounding: Vec<f64>,
    /// Parts of a step that remain to be enclosed, as a stack with the earliest part on top.
    left: Vec<(f64, f64)>,
    /// For each function, the parts of the step whose middle is the function's minimum and its maximum, if these were
    /// found in this step.
    found: Vec<[Option<[f64; 2]>; 2]>,
    /// The function whose minimum or maximum is least certain: its index, by how much the extreme may be exceeded,
    /// relative to its size, and at what time.
    open: Option<(usize, f64, f64)>,
}

/// Samples of functions within one step, in buffers that are reused.
#[derive(Clone, Debug, Default)]
struct Samples {
    times: Vec<f64>,
    /// The values of all functions at the first sampled time, then at the second, and so on.
    values: Vec<f64>,
    order: Vec<usize>,
    at_one: Vec<f64>,
}

impl Extremes {
    /// Creates the extremes of `count` functions, without samples.
    pub fn new(count: usize) -> Self {
        Self {
            least: vec![f64::INFINITY; count],
            largest: vec![f64::NEG_INFINITY; count],
            samples: Samples::default(),
            ranges: vec![Interval::LINE; count],
            rounding: vec![0.0; count],
            left: Vec::new(),
            found: vec![[None; 2]; count],
            open: None,
        }
    }

    /// Returns the minimum and the maximum of function `k` over the run so far.
    pub fn of(&self, k: usize) -> (f64, f64) {
        (self.least[k], self.largest[k])
    }

    /// Returns the function whose minimum or maximum is least certain, by how much the extreme may be exceeded,
    /// relative to its size, and at what time.
    pub fn open(&self) -> Option<(usize, f64, f64)> {
        self.open
    }

    /// Updates the minima and maxima of the functions `of` by the step from the time `from` to the time `to`.
    pub fn step(&mut self, from: f64, to: f64, of: &mut impl Followed) {
        if self.least.is_empty() {
            return;
        }
        let samples = &mut self.samples;
        samples.begin(self.least.len());
        for t in [from, to].into_iter().chain(kronrod(from, to).map(|(t, ..)| t)) {
            samples.take(t, of);
        }
        self.widen(of);
        self.search(from, to, of);
    }

    /// Updates the minima and maxima of the functions by searches for local extremes around the samples.
    fn widen(&mut self, of: &mut impl Followed) {
        let Samples { times, values, order, at_one } = &mut self.samples;
        let count = at_one.len();
        order.clear();
        order.extend(0..times.len());
        order.sort_by(|a, b| times[*a].total_cmp(&times[*b]));
        for k in 0..count {
            for (sign, extreme) in [(1.0, &mut self.largest[k]), (-1.0, &mut self.least[k])] {
                let value = |at: usize| sign * values[order[at] * count + k];
                let best = (0..order.len()).max_by(|a, b| value(*a).total_cmp(&value(*b))).unwrap_or(0);
                if value(best) <= sign * *extreme {
                    continue;
                }
                let ends = [best.saturating_sub(1), (best + 1).min(order.len() - 1)].map(|at| times[order[at]]);
                let found = highest(of, (k, sign), ends, at_one);
                *extreme = sign * found.max(value(best));
            }
        }
    }

    /// Searches a step for larger maxima and smaller minima of the functions, wherever interval enclosures do not
    /// exclude them.
    fn search(&mut self, from: f64, to: f64, of: &mut impl Followed) {
        self.rounding.fill(0.0);
        if !of.enclose(from, to, &mut self.ranges) || self.exceeded().is_none() {
            return;
        }
        of.monitors(from, &mut self.samples.at_one);
        if !of.enclose_at(from, &mut self.ranges) {
            return;
        }
        // The width of an enclosure at a single time is due to rounding; at a jump only one side is enclosed. A
        // function that cannot be enclosed at a single time cannot be enclosed over an interval either.
        self.rounding.iter_mut().zip(&self.ranges).for_each(|(rounding, range)| *rounding = range.width());
        self.found.fill([None; 2]);
        self.left.clear();
        self.left.push((from, to));
        let mut parts = 0;
        while let Some((a, b)) = self.left.pop() {
            parts += 1;
            if !of.enclose(a, b, &mut self.ranges) {
                return;
            }
            let Some((worst, by)) = self.exceeded() else { continue };
            let middle = a + 0.5 * (b - a);
            if parts > MOST_PARTS || b - a <= KNOWN * KNOWN * (to - from) || middle <= a || b <= middle {
                if self.open.is_none_or(|(_, open, _)| by > open) {
                    self.open = Some((worst, by, a));
                }
                continue;
            }
            of.monitors(middle, &mut self.samples.at_one);
            for (k, &value) in self.samples.at_one.iter().enumerate().filter(|(_, value)| value.is_finite()) {
                if value < self.least[k] {
                    (self.least[k], self.found[k][0]) = (value, Some([a, b]));
                }
                if value > self.largest[k] {
                    (self.largest[k], self.found[k][1]) = (value, Some([a, b]));
                }
            }
            self.left.extend([(middle, b), (a, middle)]);
        }
        for (k, found) in self.found.iter().enumerate() {
            let extremes = [(-1.0, &mut self.least[k]), (1.0, &mut self.largest[k])];
            for ((sign, extreme), ends) in extremes.into_iter().zip(found) {
                let Some(ends) = *ends else { continue };
                let found = highest(of, (k, sign), ends, &mut self.samples.at_one);
                *extreme = sign * found.max(sign * *extreme);
            }
        }
    }

    /// Returns the function whose enclosure exceeds its minimum or maximum most, and by how much relative to its size;
    /// `None` if all enclosures are within the accuracy of the extremes.
    fn exceeded(&self) -> Option<(usize, f64)> {
        let beyond = |k: usize| {
            let (range, least, largest) = (self.ranges[k], self.least[k], self.largest[k]);
            let (size, rounding) = (least.abs().max(largest.abs()), self.rounding[k]);
            let by = (range.hi - largest).max(least - range.lo);
            let is_beyond = rounding.is_finite() && by > KNOWN * size + 2.0 * rounding;
            is_beyond.then(|| (k, if size > 0.0 { by / size } else { f64::INFINITY }))
        };
        (0..self.least.len()).filter_map(beyond).max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

impl Samples {
    fn begin(&mut self, count: usize) {
        self.times.clear();
        self.values.clear();
        self.at_one.resize(count, 0.0);
    }

    /// Adds the values of all functions at the time `t` to the samples of the step.
    fn take(&mut self, t: f64, of: &mut impl Followed) {
        let begin = self.values.len();
        self.times.push(t);
        self.values.resize(begin + self.at_one.len(), 0.0);
        of.monitors(t, &mut self.values[begin..]);
    }
}

/// Returns the maximum of a function, times a sign, in an interval where it is unimodal, by golden-section search
/// until two values differ only by rounding errors, which takes longer at a kink than at a smooth extreme; `at_one`
/// is a buffer for all functions.
fn highest(of: &mut impl Followed, (k, sign): (usize, f64), [mut a, mut b]: [f64; 2], at_one: &mut [f64]) -> f64 {
    let mut value = |t: f64| {
        of.monitors(t, at_one);
        sign * at_one[k]
    };
    let close = KNOWN * (b - a);
    let (mut left, mut right) = (b - GOLDEN * (b - a), a + GOLDEN * (b - a));
    let (mut at_left, mut at_right) = (value(left), value(right));
    let differ = |left: f64, right: f64| (left - right).abs() > f64::EPSILON * left.abs().max(right.abs());
    while (b - a > close || differ(at_left, at_right)) && a < left && right < b {
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
    use super::Extremes;
    use hybrid::Followed;
    use numerics::Interval;

    /// Two test functions of time: a ramp, and a triangular pulse of height 1 at 1/3 with the given half-width.
    struct Hat(f64);

    impl Followed for Hat {
        fn monitors(&mut self, t: f64, out: &mut [f64]) {
            out.copy_from_slice(&[t, (1.0 - ((t - 1.0 / 3.0) / self.0).abs()).max(0.0)]);
        }

        fn enclose(&mut self, from: f64, to: f64, out: &mut [Interval]) -> bool {
            let away = (Interval::new(from, to) - Interval::point(1.0 / 3.0)).abs();
            let hat = |away: f64| (1.0 - away / self.0).max(0.0);
            out.copy_from_slice(&[Interval::new(from, to), Interval::new(hat(away.hi), hat(away.lo))]);
            true
        }
    }

    /// Two test functions, `2 + 3 sin t` and `t^2`, without enclosures.
    struct Smooth;

    impl Followed for Smooth {
        fn monitors(&mut self, t: f64, out: &mut [f64]) {
            out.copy_from_slice(&[2.0 + 3.0 * t.sin(), t * t]);
        }

        fn enclose(&mut self, _: f64, _: f64, _: &mut [Interval]) -> bool {
            false
        }
    }

    #[test]
    fn a_sine_has_its_peaks() {
        let mut extremes = Extremes::new(2);
        let ends = [0.0, 0.7, 2.5, 4.0, std::f64::consts::TAU];
        ends.windows(2).for_each(|pair| extremes.step(pair[0], pair[1], &mut Smooth));
        let (least, largest) = extremes.of(0);
        assert!((largest - 5.0).abs() < 1e-14 && (least + 1.0).abs() < 1e-14, "{least} {largest}");
        assert_eq!(extremes.of(1), (0.0, ends[4] * ends[4]));
    }

    #[test]
    fn a_hat_between_the_samples_is_found_however_narrow() {
        for width in [1e-1, 1e-3, 1e-6, 1e-9] {
            let mut extremes = Extremes::new(2);
            extremes.step(0.0, 1.0, &mut Hat(width));
            let (least, largest) = extremes.of(1);
            assert!(least == 0.0 && (largest - 1.0).abs() < 1e-14_f64.max(1e-16 / width), "{width:e}: {largest}");
            assert_eq!(extremes.of(0), (0.0, 1.0));
            assert_eq!(extremes.open(), None);
        }
    }
}
