//! Monitors (event functions): functions along the dense output of a step whose sign change marks an event.
//!
//! A step is examined in subintervals, the earliest first. If the enclosure of a monitor over a subinterval contains no
//! zero, the monitor has no event there; other subintervals are bisected. Enclosures find the first sign change however
//! close the next one is. Without enclosures the monitors are sampled, and the step counts as open (not proven).

use numerics::Interval;

/// Maximum number of subintervals of a step that are enclosed. Locating a sign change takes two for each binary digit
/// of a double; more stay undecided where a monitor touches zero, since enclosures prove little there.
const MOST_PARTS: usize = 400;
/// Number of samples of a step without enclosures.
const SAMPLES: f64 = 32.0;
/// Time resolution of the sign changes of one monitor, relative to the step: rounding splits one sign change into
/// several. Two within this distance cancel if both lie in one subinterval; behind a located sign change, the next is
/// ignored.
const ONE: f64 = 1e-9;
/// Tolerance on an event time, in units of rounding: the times of a step are sums that err by a unit or two each.
const FOUND: f64 = 4.0;

/// A step with dense output, along which monitors are evaluated.
pub trait Followed {
    /// Writes the values of the monitors at time `t` within the step to `out`.
    fn monitors(&mut self, t: f64, out: &mut [f64]);

    /// Writes enclosures of the monitors over `[from, to]` within the step to `out`; returns false if there are none.
    fn enclose(&mut self, from: f64, to: f64, out: &mut [Interval]) -> bool;
}

/// A sign change of a monitor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// First floating-point time at which the new sign is seen.
    pub t: f64,
    /// Index of the monitor.
    pub monitor: usize,
    /// Whether the monitor rises: negative before `t`, zero or positive at `t`.
    pub is_rising: bool,
}

/// The sides of zero on which the monitors are, and the search for their next sign change.
#[derive(Clone, Debug)]
pub struct Monitors {
    /// Sign of each monitor: 1, -1, or 0 if it has been zero since the start. A monitor that reaches zero counts as
    /// having changed sign.
    sides: Vec<f64>,
    /// Whether a monitor has reached zero and stayed there since.
    rests: Vec<bool>,
    /// Time up to which sign changes of a monitor belong to its last event.
    quiet: Vec<f64>,
    values: Vec<f64>,
    ranges: Vec<Interval>,
    /// Subintervals of a step still to be examined, as a stack: the earliest is last.
    left: Vec<(f64, f64)>,
    /// Number of steps that are not proven to show all sign changes.
    pub open: u64,
}

impl Monitors {
    /// Starts from the values of the monitors at the start of a run.
    pub fn new(values: &[f64]) -> Self {
        let count = values.len();
        Self {
            sides: values.iter().map(|value| side(*value)).collect(),
            rests: vec![false; count],
            quiet: vec![f64::NEG_INFINITY; count],
            values: vec![0.0; count],
            ranges: vec![Interval::LINE; count],
            left: Vec::new(),
            open: 0,
        }
    }

    /// The first sign change in `[from, to]` within a step.
    pub fn next(&mut self, step: &mut impl Followed, from: f64, to: f64) -> Option<Crossing> {
        if self.sides.is_empty() {
            return None;
        }
        let h = to - from;
        if let Some(monitor) = self.changed_at(step, from) {
            return Some(self.cross(monitor, from, h));
        }
        self.left.clear();
        self.left.push((from, to));
        let (mut parts, mut is_open) = (0, false);
        let mut crossing = None;
        while let Some((a, b)) = self.left.pop() {
            parts += 1;
            let mut is_enclosed = parts <= MOST_PARTS && step.enclose(a, b, &mut self.ranges);
            if is_enclosed && self.are_clear(b) {
                continue;
            }
            is_enclosed &= self.ranges.iter().all(|range| range.width().is_finite());
            let middle = a + 0.5 * (b - a);
            let can_halve = a < middle && middle < b;
            if let Some(monitor) = self.changed_at(step, b) {
                if !can_halve || b - a <= FOUND * f64::EPSILON * a.abs().max(b.abs()) {
                    crossing = Some((monitor, b));
                    break;
                }
            } else if !can_halve || b - a <= ONE * h {
                self.set_sides();
                continue;
            } else if parts > MOST_PARTS || !is_enclosed && b - a <= h / SAMPLES {
                is_open = true;
                self.set_sides();
                continue;
            }
            self.left.extend([(middle, b), (a, middle)]);
        }
        self.open += u64::from(is_open);
        crossing.map(|(monitor, t)| self.cross(monitor, t, h))
    }

    /// Whether the enclosures of a subinterval that ends at `b` exclude a sign change. Sets the sign of monitors that
    /// were zero so far, if the enclosures decide it.
    fn are_clear(&mut self, b: f64) -> bool {
        let mut are_clear = true;
        for k in 0..self.sides.len() {
            let range = self.ranges[k];
            let sign = f64::from(i8::from(range.least() > 0.0) - i8::from(range.defined && range.hi < 0.0));
            if self.sides[k] == 0.0 {
                self.sides[k] = sign;
            }
            let is_zero = range.defined && range.lo == 0.0 && range.hi == 0.0;
            let stays =
                if is_zero { self.rests[k] || self.sides[k] == 0.0 } else { sign != 0.0 && sign == self.sides[k] };
            are_clear &= stays || self.quiet[k] >= b;
        }
        are_clear
    }

    /// The first monitor (of lowest index) whose sign at `t` differs from its recorded sign; a NaN leaves the sign as
    /// it is.
    fn changed_at(&mut self, step: &mut impl Followed, t: f64) -> Option<usize> {
        step.monitors(t, &mut self.values);
        let mut changed = None;
        for k in (0..self.sides.len()).rev() {
            if self.values[k].is_nan() {
                continue;
            }
            let now = side(self.values[k]);
            if self.sides[k] == 0.0 || now == self.sides[k] {
                self.rests[k] &= now == 0.0;
            } else if t > self.quiet[k] && !(now == 0.0 && self.rests[k]) {
                changed = Some(k);
            }
        }
        changed
    }

    /// Sets the sign of monitors that were zero so far, from their values at the end of a finished subinterval.
    fn set_sides(&mut self) {
        for (own, value) in self.sides.iter_mut().zip(&self.values).filter(|(side, _)| **side == 0.0) {
            *own = side(*value);
        }
    }

    fn cross(&mut self, monitor: usize, t: f64, h: f64) -> Crossing {
        let is_rising = self.sides[monitor] < 0.0;
        self.sides[monitor] = -self.sides[monitor];
        self.rests[monitor] = self.values[monitor] == 0.0;
        self.quiet[monitor] = t + ONE * h;
        Crossing { t, monitor, is_rising }
    }
}

fn side(value: f64) -> f64 {
    if value > 0.0 {
        1.0
    } else if value < 0.0 {
        -1.0
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::{Crossing, Followed, Monitors};
    use numerics::Interval;

    /// `(t - root)` for each root, multiplied.
    struct Polynomial(&'static [f64]);

    impl Followed for Polynomial {
        fn monitors(&mut self, t: f64, out: &mut [f64]) {
            out[0] = self.0.iter().map(|root| t - root).product();
        }

        fn enclose(&mut self, from: f64, to: f64, out: &mut [Interval]) -> bool {
            let factors = self.0.iter().map(|root| Interval::new(from, to) - Interval::point(*root));
            out[0] = factors.fold(Interval::point(1.0), |product, factor| product * factor);
            true
        }
    }

    #[test]
    fn all_changes_of_sign_are_found_in_order_however_close() {
        let mut step = Polynomial(&[0.1, 0.3, 0.300_001, 0.7]);
        let mut value = [0.0];
        step.monitors(0.0, &mut value);
        let mut monitors = Monitors::new(&value);
        let (mut from, mut found) = (0.0, Vec::new());
        while let Some(Crossing { t, is_rising, .. }) = monitors.next(&mut step, from, 1.0) {
            found.push((t, is_rising));
            from = t;
        }
        let expected = [(0.1, false), (0.3, true), (0.300_001, false), (0.7, true)];
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (found, expected) in found.iter().zip(expected) {
            assert!((found.0 - expected.0).abs() < 1e-15 && found.1 == expected.1, "{found:?}");
        }
        assert_eq!(monitors.open, 0);
    }

    #[test]
    fn what_reaches_zero_and_rests_there_has_changed_once() {
        struct Resting;

        impl Followed for Resting {
            fn monitors(&mut self, t: f64, out: &mut [f64]) {
                out[0] = (0.25 - t).max(0.0);
            }

            fn enclose(&mut self, from: f64, to: f64, out: &mut [Interval]) -> bool {
                out[0] = Interval::new((0.25 - to).max(0.0), (0.25 - from).max(0.0));
                true
            }
        }

        let mut monitors = Monitors::new(&[0.25]);
        let found = monitors.next(&mut Resting, 0.0, 1.0).expect("a change");
        assert!((found.t - 0.25).abs() < 1e-15 && !found.is_rising);
        assert_eq!(monitors.next(&mut Resting, found.t, 1.0), None);
        assert_eq!(monitors.next(&mut Resting, 1.0, 2.0), None);
        assert_eq!(monitors.open, 0);
    }

    #[test]
    fn a_monitor_that_starts_at_zero_has_not_changed() {
        let mut monitors = Monitors::new(&[0.0]);
        assert_eq!(monitors.next(&mut Polynomial(&[0.0]), 0.0, 1.0), None);
        let mut monitors = Monitors::new(&[0.0]);
        let found = monitors.next(&mut Polynomial(&[0.0, 0.5]), 0.0, 1.0).expect("a change at one half");
        assert!((found.t - 0.5).abs() < 1e-15 && found.is_rising);
    }
}
