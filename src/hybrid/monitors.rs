//! Monitors (event functions): functions along the dense output of a step whose sign change marks an event.
//!
//! A step is examined in subintervals, the earliest first. If the enclosure of a monitor over a subinterval contains no
//! zero, the monitor has no event there; other subintervals are bisected. Enclosures find the first sign change however
//! close the next one is. Without enclosures the monitors are sampled, and the step counts as open (not proven).

use numerics::Interval;

/// Maximum number of subintervals of a step over which monitors are enclosed. Locating a sign change takes two for
/// each binary digit of a double; more stay undecided where a monitor touches zero, since enclosures prove little
/// there.
const MOST_PARTS: usize = 400;
/// Number of samples of the monitors (event functions) over a step over which they cannot be enclosed.
const SAMPLES: f64 = 32.0;
/// Time resolution of the sign changes of one monitor, relative to the step: rounding splits one sign change into
/// several. Two sign changes within this distance cancel if both lie in one subinterval; a sign change within this
/// distance behind a located one is ignored.
const ONE: f64 = 1e-9;
/// Bound on a monitor (event function) that rests at zero over a subinterval, in units of its enclosure at the end of
/// the subinterval, which contains zero: rounding errors differ along the way.
const RESTING: f64 = 8.0;
/// Tolerance on an event time, in units of its rounding error: the times of a step are sums that err by a unit or two
/// each.
const FOUND: f64 = 4.0;

/// A step with dense output, along which monitors (event functions) are evaluated.
pub trait Followed {
    /// Writes the values of the monitors at time `t` within the step to `out`.
    fn monitors(&mut self, t: f64, out: &mut [f64]);

    /// Writes enclosures of the monitors over `[from, to]` within the step to `out`; returns false if there are no
    /// enclosures.
    fn enclose(&mut self, from: f64, to: f64, out: &mut [Interval]) -> bool;

    /// Writes enclosures of the monitors at time `t`, at which they were evaluated last, to `out`; a monitor that
    /// jumps at `t` is enclosed on the side of its value. Returns false if there are no enclosures.
    fn enclose_at(&mut self, t: f64, out: &mut [Interval]) -> bool {
        self.enclose(t, t, out)
    }
}

/// A sign change of a monitor (event function): an event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// First floating-point time at which the new sign of the monitor is seen.
    pub t: f64,
    /// Index of the monitor that changes sign.
    pub monitor: usize,
    /// Whether the monitor rises: from below zero to zero or above, or from a rest at zero.
    pub is_rising: bool,
    /// Whether the monitor leaves zero (a value whose enclosure contains zero) to the side from which it reached
    /// zero.
    pub returns: bool,
}

/// The search for the next sign change of the monitors (event functions) along a run.
#[derive(Clone, Debug)]
pub struct Monitors {
    signs: Vec<Sign>,
    /// Whether the signs of the monitors at the start of a run are still to be found.
    is_new: bool,
    values: Vec<f64>,
    /// Enclosures of the monitors over a subinterval, and at the time of the last evaluation.
    ranges: Vec<Interval>,
    points: Vec<Interval>,
    /// Subintervals of a step still to be examined for sign changes, as a stack: the earliest is last.
    left: Vec<(f64, f64)>,
    /// Number of steps in which the search is not proven to have found all sign changes of the monitors.
    pub open: u64,
}

/// The sign of a monitor (event function) at the time up to which the step has been examined.
#[derive(Clone, Copy, Debug)]
struct Sign {
    /// Present sign: 1, -1, or 0 for a value that is zero or cannot be told from zero by its enclosure.
    now: f64,
    /// Last nonzero sign of the monitor; 0 if there has been none.
    last: f64,
    /// Whether the monitor has been zero over an interval since the start of the run.
    rested: bool,
    /// Time up to which sign changes of the monitor count as part of its last event, since rounding splits one event
    /// into several sign changes.
    quiet: f64,
}

impl Sign {
    /// Whether the enclosure `range` of the monitor over a subinterval excludes a change of its sign.
    fn stays(&self, range: Interval) -> bool {
        if self.now == 0.0 { is_zero(range) } else { sign_within(range) == self.now }
    }

    /// Updates the sign of the monitor to `to`; returns whether the change is an event. Reaching zero from either
    /// side is an event; leaving zero to the other side completes that event, and leaving zero to the side from which
    /// it was reached is another event. A monitor that is zero at the start of the run has an event when it leaves
    /// zero only if it has rested there.
    fn pass(&mut self, to: f64) -> bool {
        let is_event = self.now != 0.0 || self.last == to || self.last == 0.0 && self.rested;
        self.now = to;
        if to != 0.0 {
            self.last = to;
        }
        is_event
    }

    /// Completes the last event of a monitor, at which it reached zero from one side: if the monitor has now left
    /// zero to the opposite side, its sign is set to `to`, without a new event.
    fn complete(&mut self, to: f64) {
        if self.now == 0.0 && to != 0.0 && to != self.last {
            self.now = to;
            self.last = to;
        }
    }
}

impl Monitors {
    /// Creates the search for the sign changes of `count` monitors, at the start of a run.
    pub fn new(count: usize) -> Self {
        Self {
            signs: vec![Sign { now: 0.0, last: 0.0, rested: false, quiet: f64::NEG_INFINITY }; count],
            is_new: true,
            values: vec![0.0; count],
            ranges: vec![Interval::LINE; count],
            points: vec![Interval::LINE; count],
            left: Vec::new(),
            open: 0,
        }
    }

    /// Returns the first sign change of a monitor in `[from, to]` within a step.
    pub fn next(&mut self, step: &mut impl Followed, from: f64, to: f64) -> Option<Crossing> {
        if self.signs.is_empty() {
            return None;
        }
        let h = to - from;
        self.evaluate(step, from);
        if std::mem::take(&mut self.is_new) {
            self.begin(from, h);
        }
        if let Some(crossing) = self.pass(from, h) {
            return Some(crossing);
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
            self.evaluate(step, b);
            if self.changed(b).is_some() {
                if !can_halve || b - a <= FOUND * f64::EPSILON * a.abs().max(b.abs()) {
                    crossing = self.pass(b, h);
                    if crossing.is_some() {
                        break;
                    }
                    continue;
                }
            } else {
                let is_settled = is_enclosed && self.are_clear_or_rest(b) || !can_halve || b - a <= ONE * h;
                let is_left = !is_settled && (parts > MOST_PARTS || !is_enclosed && b - a <= h / SAMPLES);
                is_open |= is_left;
                if is_settled || is_left {
                    self.complete();
                    continue;
                }
            }
            self.left.extend([(middle, b), (a, middle)]);
        }
        self.open += u64::from(is_open);
        crossing
    }

    /// Sets the signs of the monitors at the start of a run, where they were evaluated. A monitor that leaves zero at
    /// once has not changed its sign.
    fn begin(&mut self, from: f64, h: f64) {
        for k in 0..self.signs.len() {
            if let Some(now) = self.sign_there(k) {
                self.signs[k] = Sign { now, last: now, ..self.signs[k] };
            }
            if self.signs[k].now == 0.0 {
                self.signs[k].quiet = from + ONE * h;
            }
        }
    }

    /// Whether the enclosures of the monitors over a subinterval that ends at `b` exclude a sign change of every
    /// monitor.
    fn are_clear(&mut self, b: f64) -> bool {
        let mut are_clear = true;
        for (sign, range) in self.signs.iter_mut().zip(&self.ranges) {
            let (stays, is_quiet) = (sign.stays(*range), sign.quiet >= b);
            sign.rested |= stays && is_zero(*range);
            if is_quiet {
                sign.complete(sign_within(*range));
            }
            are_clear &= stays || is_quiet;
        }
        are_clear
    }

    /// Whether the enclosures of the monitors over a subinterval that ends at `b` exclude a sign change of every
    /// monitor, if a monitor at zero stays there as long as its enclosure is hardly larger than the enclosure at `b`.
    fn are_clear_or_rest(&self, b: f64) -> bool {
        self.signs.iter().zip(&self.ranges).zip(&self.points).all(|((sign, range), point)| {
            let rests = sign.now == 0.0 && range.size() <= RESTING * point.size();
            rests || sign.quiet >= b || sign.stays(*range)
        })
    }

    /// Evaluates the monitors (event functions) and their enclosures at time `t` within the step.
    fn evaluate(&mut self, step: &mut impl Followed, t: f64) {
        step.monitors(t, &mut self.values);
        if !step.enclose_at(t, &mut self.points) {
            self.points.fill(Interval::LINE);
        }
    }

    /// Returns the sign of monitor `k` at the time of its last evaluation: zero if the enclosure contains zero;
    /// `None` for a NaN.
    fn sign_there(&self, k: usize) -> Option<f64> {
        let (value, point) = (self.values[k], self.points[k]);
        let is_open = point.width().is_finite() && point.lo <= 0.0 && point.hi >= 0.0;
        (!value.is_nan()).then(|| if is_open { 0.0 } else { sign_of(value) })
    }

    /// Returns the monitor of lowest index whose sign at `t`, where the monitors were evaluated, differs from its
    /// recorded sign, with the new sign; a NaN leaves the sign unchanged.
    fn changed(&self, t: f64) -> Option<(usize, f64)> {
        self.signs.iter().enumerate().find_map(|(k, Sign { now, quiet, .. })| {
            let there = self.sign_there(k).filter(|there| t > *quiet && there != now)?;
            Some((k, there))
        })
    }

    /// Updates the recorded signs of the monitors at `t`, where the monitors were evaluated, up to the first sign
    /// change that is an event.
    fn pass(&mut self, t: f64, h: f64) -> Option<Crossing> {
        while let Some((monitor, to)) = self.changed(t) {
            let sign = &mut self.signs[monitor];
            let is_rising = if sign.now == 0.0 { to > 0.0 } else { sign.now < 0.0 };
            let returns = sign.now == 0.0 && sign.last == to;
            sign.quiet = t + ONE * h;
            if sign.pass(to) {
                return Some(Crossing { t, monitor, is_rising, returns });
            }
        }
        None
    }

    /// Completes the last events of all monitors at the end of an examined subinterval, where the monitors were
    /// evaluated: a monitor that had reached zero, and has left it to the opposite side, gets its new sign without a
    /// new event.
    fn complete(&mut self) {
        for k in 0..self.signs.len() {
            if let Some(there) = self.sign_there(k) {
                self.signs[k].complete(there);
            }
        }
    }
}

fn is_zero(range: Interval) -> bool {
    range.defined && range.lo == 0.0 && range.hi == 0.0
}

/// Returns the sign of a monitor over a whole subinterval if its enclosure `range` proves one, otherwise zero.
fn sign_within(range: Interval) -> f64 {
    f64::from(i8::from(range.least() > 0.0) - i8::from(range.defined && range.hi < 0.0))
}

fn sign_of(value: f64) -> f64 {
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

    /// Test monitor: the polynomial `prod (t - root)` with given roots.
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
        let mut monitors = Monitors::new(1);
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

        let mut monitors = Monitors::new(1);
        let found = monitors.next(&mut Resting, 0.0, 1.0).expect("a change");
        assert!((found.t - 0.25).abs() < 1e-15 && !found.is_rising);
        assert_eq!(monitors.next(&mut Resting, found.t, 1.0), None);
        assert_eq!(monitors.next(&mut Resting, 1.0, 2.0), None);
        assert_eq!(monitors.open, 0);
    }

    #[test]
    fn a_monitor_that_starts_at_zero_has_not_changed() {
        let mut monitors = Monitors::new(1);
        assert_eq!(monitors.next(&mut Polynomial(&[0.0]), 0.0, 1.0), None);
        let mut monitors = Monitors::new(1);
        let found = monitors.next(&mut Polynomial(&[0.0, 0.5]), 0.0, 1.0).expect("a change at one half");
        assert!((found.t - 0.5).abs() < 1e-15 && found.is_rising);
    }

    /// Test monitor: a piecewise constant function of time, given by the times of its jumps and its values behind
    /// them.
    struct Steps<'a>(&'a [(f64, f64)]);

    impl Steps<'_> {
        fn at(&self, t: f64) -> f64 {
            self.0.iter().take_while(|(from, _)| *from <= t).last().expect("a value from the start").1
        }
    }

    impl Followed for Steps<'_> {
        fn monitors(&mut self, t: f64, out: &mut [f64]) {
            out[0] = self.at(t);
        }

        fn enclose(&mut self, from: f64, to: f64, out: &mut [Interval]) -> bool {
            let met = self.0.iter().filter(|(at, _)| *at > from && *at <= to).map(|(_, value)| *value);
            out[0] = met.fold(Interval::point(self.at(from)), |range, value| {
                Interval::new(range.lo.min(value), range.hi.max(value))
            });
            true
        }
    }

    /// Returns the times of the events of a monitor in steps that end at `ends`, and whether the monitor rises at
    /// each.
    fn events(step: &mut impl Followed, ends: &[f64]) -> Vec<(f64, bool)> {
        let mut monitors = Monitors::new(1);
        let (mut from, mut found) = (0.0, Vec::new());
        for &end in ends {
            while let Some(Crossing { t, is_rising, .. }) = monitors.next(step, from, end) {
                found.push((t, is_rising));
                from = t;
            }
            from = end;
        }
        assert_eq!(monitors.open, 0);
        found
    }

    fn assert_alike(found: &[(f64, bool)], expected: &[(f64, bool)]) {
        let is_alike = |(found, expected): (&(f64, bool), &(f64, bool))| {
            (found.0 - expected.0).abs() < 1e-14 && found.1 == expected.1
        };
        let are_alike = found.len() == expected.len() && found.iter().zip(expected).all(is_alike);
        assert!(are_alike, "{found:?} instead of {expected:?}");
    }

    #[test]
    fn resting_at_zero_is_reached_once_and_left_to_the_other_side_without_another_event() {
        let floor = [(0.0, -2.0), (1.0, -1.0), (2.0, 0.0), (3.0, 1.0), (4.0, 2.0)];
        for ends in [&[4.5][..], &[1.7, 2.4, 2.6, 4.5], &[2.0, 3.0, 4.0]] {
            assert_alike(&events(&mut Steps(&floor), ends), &[(2.0, true)]);
        }
    }

    #[test]
    fn a_return_from_zero_is_an_event_and_so_is_leaving_rest_at_the_start() {
        let expected = [(2.0, true), (3.0, false), (5.0, true), (6.0, false)];
        for ends in [&[7.0][..], &[0.3, 2.5, 4.0, 7.0], &[2.0, 3.0, 5.0, 6.0]] {
            let mut pulses = Steps(&[(0.0, 0.0), (2.0, 1.0), (3.0, 0.0), (5.0, 1.0), (6.0, 0.0)]);
            assert_alike(&events(&mut pulses, ends), &expected);
        }
    }

    #[test]
    fn rounding_around_zero_is_no_event() {
        /// Test monitor: `max(1/2 - t, 0)` with noise of the size of a rounding error.
        struct Held;

        impl Followed for Held {
            fn monitors(&mut self, t: f64, out: &mut [f64]) {
                let noise = if ((t * 1e9) as u64).is_multiple_of(2) { 1e-16 } else { -1e-16 };
                out[0] = (0.5 - t).max(0.0) + noise;
            }

            fn enclose(&mut self, from: f64, to: f64, out: &mut [Interval]) -> bool {
                out[0] = Interval::new((0.5 - to).max(0.0) - 1e-16, (0.5 - from).max(0.0) + 1e-16);
                true
            }
        }

        let mut monitors = Monitors::new(1);
        let found = monitors.next(&mut Held, 0.0, 1.0).expect("zero is reached");
        assert!((found.t - 0.5).abs() < 3e-9 && !found.is_rising, "{found:?}");
        assert_eq!(monitors.next(&mut Held, found.t, 1.0), None);
        assert_eq!(monitors.next(&mut Held, 1.0, 2.0), None);
    }
}
