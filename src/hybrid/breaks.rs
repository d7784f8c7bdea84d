//! Breakpoints (time events): times at which a rate, a `G` or a bound has a kink or a jump that depends on time alone,
//! as `heaviside(t - 1)` has at 1. A step across a breakpoint would be of order one, and a step longer than a pulse
//! could miss the pulse altogether.
//!
//! The functions that change sign at breakpoints are enclosed over the step in interval arithmetic. Subintervals over
//! which a sign change is not excluded are bisected, the earliest first, so that no breakpoint is passed over, however
//! close the next one is. A step ends on the last floating-point number before the first zero, and the next step begins on
//! the first number behind it: on which side of a jump a row takes its value at the zero itself depends on how it is
//! written.

use numerics::{Bracket, Interval};
use problem::{Dvi, Mechanical};

/// Maximum number of subintervals of a step over which functions of time are enclosed. Locating a breakpoint takes
/// two for each binary digit of a double; more stay undecided where a function touches zero, since enclosures prove
/// little there.
const MOST_PARTS: usize = 400;
/// Number of samples of a step if enclosures leave sign changes undecided. The step is then no longer than twice the
/// time between the last two breakpoints, or twice the time since the last one, whichever is longer: periodic forcing
/// is sampled eight times between two of its breakpoints.
const SAMPLES: u32 = 16;
/// Breakpoints closer than this many units of rounding count as one. The breakpoints of `t - 1` and `3*t - 3` agree up
/// to a few units, or up to the digits that cancel in a longer expression. A smaller value would make a step between
/// such a pair; a much larger one would merge breakpoints although the interval between them matters.
const ONE: f64 = 1e3;
/// A breakpoint within this many units of rounding of an end of a step is placed at that end: the sums that give the
/// end, and the time of the breakpoint, err by a unit or two each. A smaller value would leave steps of a few units; a
/// much larger one would move breakpoints.
const AT_END: f64 = 8.0;

/// Number of breakpoints over which their mean distance in time is taken: the distances in a shorter burst of
/// breakpoints do not predict later ones.
const WINDOW: u32 = 10_000;

/// Equations that change their form at breakpoints.
pub trait Breaking {
    /// Functions of time, evaluated at `t`, at whose sign changes the breakpoints are. Their number is constant.
    fn breaks(&mut self, t: f64) -> &[f64];

    /// Encloses the functions of time at whose sign changes the breakpoints are over an interval of time; returns an
    /// empty slice if they cannot be enclosed.
    fn enclose_breaks(&mut self, t: Interval) -> &[Interval];
}

impl Breaking for dyn Dvi + '_ {
    fn breaks(&mut self, t: f64) -> &[f64] {
        Dvi::breaks(self, t)
    }

    fn enclose_breaks(&mut self, t: Interval) -> &[Interval] {
        Dvi::enclose_breaks(self, t)
    }
}

impl Breaking for dyn Mechanical + '_ {
    fn breaks(&mut self, t: f64) -> &[f64] {
        Mechanical::breaks(self, t)
    }

    fn enclose_breaks(&mut self, t: Interval) -> &[Interval] {
        Mechanical::enclose_breaks(self, t)
    }
}

/// An interval of time over which enclosures prove that none of the functions whose sign changes are breakpoints
/// changes its sign.
#[derive(Clone, Copy, Debug)]
struct Unbroken {
    from: f64,
    until: f64,
    /// The floating-point numbers before and at the sign change (a breakpoint) that ends the interval, if one was
    /// found.
    change: Option<(f64, f64)>,
}

/// State of the search for breakpoints (times at which equations change their form) along a run.
#[derive(Clone, Debug)]
pub struct Breaks {
    /// Number of breakpoints passed in the present count, and the time from which they are counted: the start of the
    /// run, or the last breakpoint when their mean distance was taken.
    window: (u32, f64),
    /// Signs, at the beginning of the step, of the functions that change sign at breakpoints; 0 for a function that
    /// is zero.
    signs: Vec<f64>,
    /// Subintervals of the step still to be enclosed, as a stack: the earliest is last.
    left: Vec<(f64, f64)>,
    /// The interval over which functions were enclosed last: a step that is repeated with another size, and a probe of
    /// its beginning, need no enclosures of their own.
    unbroken: Option<Unbroken>,
    /// Time of the last breakpoint (or the start of the run), and the time between the last two breakpoints.
    last: f64,
    gap: f64,
    /// Last floating-point number before the breakpoint that was found last.
    before: f64,
    /// First floating-point number after the breakpoint before which the present step ends.
    after: Option<f64>,
    /// Time of the breakpoint that was found last: a zero of its function, or the first number after it.
    at: f64,
}

impl Breaks {
    /// Starts the search for breakpoints in a run that begins at time `t`.
    pub fn new(t: f64) -> Self {
        Self {
            window: (0, t),
            signs: Vec::new(),
            left: Vec::new(),
            unbroken: None,
            last: t,
            gap: f64::INFINITY,
            before: t,
            after: None,
            at: t,
        }
    }

    /// Returns the first floating-point number after the breakpoint before which the present step ends, if the step
    /// ends at one.
    pub fn after(&self) -> Option<f64> {
        self.after
    }

    /// Returns the time of the breakpoint that was found last: a zero of its function, or the first floating-point
    /// number after it.
    pub fn at(&self) -> f64 {
        self.at
    }

    /// Cuts a step of size `h` from `t` at the first breakpoint within it and returns the size of the cut step; zero if
    /// the run must first [pass](Self::pass) the breakpoint.
    pub fn up_to_break(&mut self, problem: &mut (impl Breaking + ?Sized), t: f64, h: f64) -> f64 {
        self.after = None;
        let noise = f64::EPSILON * (ONE * t.abs() + h);
        let is_behind_break = t - self.last <= noise;
        if is_behind_break && h <= noise {
            return h;
        }
        // Rounding may place the sign change of the last breakpoint slightly later: search behind it.
        let begin = if is_behind_break { t + noise } else { t };
        self.signs.clear();
        self.signs.extend(problem.breaks(begin).iter().map(|value| if *value == 0.0 { 0.0 } else { value.signum() }));
        if self.signs.is_empty() {
            return h;
        }
        let end_of = |h: f64| t + h + AT_END * f64::EPSILON * t.abs().max(h);
        match self.first_proven(problem, begin, end_of(h), h) {
            Some(None) => h,
            Some(Some(found)) => self.end_before(problem, found, t, h),
            None => {
                let h = h.min(2.0 * self.gap.max(t - self.last));
                let found = self.first_sampled(problem, begin, end_of(h), h);
                found.map_or(h, |found| self.end_before(problem, found, t, h))
            }
        }
    }

    /// Returns the part of the length `h`, from time `t` on, that lies before the next breakpoint; all of the length
    /// if the breakpoint is at `t`.
    pub fn part_before(&mut self, problem: &mut (impl Breaking + ?Sized), t: f64, h: f64) -> f64 {
        let found = (self.before, self.at, self.after);
        let part = self.up_to_break(problem, t, h);
        (self.before, self.at, self.after) = found;
        if part > 0.0 { part } else { h }
    }

    /// Returns the size of a step from `t` to `end`. If `end` lies between the last breakpoint and the time at which
    /// the run continued behind it, the step ends before that breakpoint instead.
    pub fn size_up_to(&self, t: f64, end: f64) -> f64 {
        let is_at_break = self.before < end && end <= self.last;
        if is_at_break && t < self.before { length(t, self.before) } else { end - t }
    }

    /// Records that the run continues at time `after`, behind a breakpoint.
    pub fn pass(&mut self, after: f64) {
        let gap = after - self.last;
        if gap > ONE * f64::EPSILON * after.abs() {
            self.gap = gap;
        }
        self.last = after;
        self.after = None;
        self.window.0 += 1;
    }

    /// Returns the mean distance in time of the last breakpoints, each time that a certain number of them (10 000)
    /// has been passed; otherwise `None`.
    pub fn mean_distance(&mut self) -> Option<f64> {
        let (count, begin) = self.window;
        if count < WINDOW {
            return None;
        }
        self.window = (0, self.last);
        Some((self.last - begin) / f64::from(count))
    }

    fn end_before(&mut self, problem: &mut (impl Breaking + ?Sized), (before, at): (f64, f64), t: f64, h: f64) -> f64 {
        (self.before, self.at, self.after) = (before, at, Some(self.behind(problem, at)));
        let part = length(t, before).min(h);
        if part <= AT_END * f64::EPSILON * t.abs() { 0.0 } else { part }
    }

    /// Returns the floating-point numbers before and at the first sign change of a function; `Some(None)` if no
    /// function changes its sign, and `None` if enclosures leave that undecided. Does not repeat the enclosures of an
    /// interval that the last call has proven.
    fn first_proven(
        &mut self,
        problem: &mut (impl Breaking + ?Sized),
        begin: f64,
        end: f64,
        h: f64,
    ) -> Option<Option<(f64, f64)>> {
        // Take the known interval only if no function is zero at the beginning: a function that is zero there and
        // positive behind may return to zero within the interval.
        let known = self.unbroken.filter(|known| {
            // Behind a breakpoint, the beginning of a search contains a rounding term that depends on the step size:
            // allow for it in the comparison with the known interval.
            let from = known.from - f64::EPSILON * (known.until - known.from);
            (from..=known.until).contains(&begin) && self.signs.iter().all(|sign| *sign != 0.0)
        });
        let mut from = begin;
        if let Some(known) = known {
            match known.change {
                _ if end <= known.until => return Some(None),
                Some(change) if end >= change.1 => return Some(Some(change)),
                Some(_) => {}
                None => from = known.until,
            }
        }
        let found = self.first_enclosed(problem, from, end, h);
        self.unbroken = found.filter(|_| self.signs.iter().all(|sign| *sign != 0.0)).map(|change| Unbroken {
            from: begin,
            until: change.map_or(end, |(before, _)| before),
            change,
        });
        found
    }

    /// Encloses the functions whose sign changes are breakpoints from `begin` to `end`, and returns the numbers before
    /// and at their first sign change as [`first_proven`](Self::first_proven) does.
    fn first_enclosed(
        &mut self,
        problem: &mut (impl Breaking + ?Sized),
        begin: f64,
        end: f64,
        h: f64,
    ) -> Option<Option<(f64, f64)>> {
        self.left.clear();
        self.left.push((begin, end));
        let mut parts = 0;
        while let Some((a, b)) = self.left.pop() {
            parts += 1;
            if parts > MOST_PARTS {
                return None;
            }
            if self.is_proven(problem, Interval::new(a, b))? {
                continue;
            }
            if let Some(found) = self.first_guessed(problem, a, b) {
                return Some(Some(found));
            }
            let middle = a + 0.5 * (b - a);
            if middle > a && middle < b && b - a > f64::EPSILON * h {
                self.left.extend([(middle, b), (a, middle)]);
            } else if self.has_broken(problem, b) {
                return Some(Some(self.refined(problem, begin, (a, b))));
            }
        }
        Some(None)
    }

    /// Whether enclosures prove that no function (whose sign changes are breakpoints) changes its sign over an interval
    /// of time; `None` if there are none.
    fn is_proven(&self, problem: &mut (impl Breaking + ?Sized), t: Interval) -> Option<bool> {
        let ranges = problem.enclose_breaks(t);
        let keeps = |(range, sign): (&Interval, &f64)| match *sign {
            sign if sign > 0.0 => range.least() > 0.0,
            sign if sign < 0.0 => range.hi < 0.0,
            _ => range.least() >= 0.0,
        };
        (ranges.len() == self.signs.len()).then(|| ranges.iter().zip(&self.signs).all(keeps))
    }

    /// Returns the floating-point numbers before and at a root between `a` and `b` of the first function whose sign
    /// at `b` differs from that at `a`, if one enclosure proves that no function changes its sign before that root.
    /// For a single sign change this saves the bisection.
    fn first_guessed(&self, problem: &mut (impl Breaking + ?Sized), a: f64, b: f64) -> Option<(f64, f64)> {
        let value = |value: f64, sign: f64| if sign == 0.0 { f64::NAN } else { value * sign };
        let values = problem.breaks(b).iter().zip(&self.signs).map(|(x, sign)| value(*x, *sign));
        let (k, at_end) = values.enumerate().find(|(_, value)| *value <= 0.0)?;
        let mut follow = |t: f64| value(problem.breaks(t)[k], self.signs[k]);
        let at_begin = follow(a);
        if at_begin.is_nan() || at_begin <= 0.0 {
            return None;
        }
        let mut bracket = Bracket::new((a, at_begin), (b, at_end));
        loop {
            let (before, behind) = (bracket.before.0, bracket.behind.0);
            let least = f64::EPSILON * behind.abs();
            let t = bracket.guess_apart(least);
            if bracket.width() <= 2.0 * least || t <= before || t >= behind {
                break;
            }
            let found = follow(t);
            if !found.is_finite() {
                return None;
            }
            bracket.narrow(t, found);
        }
        let behind = bracket.behind.0;
        let until = bracket.before.0 - ONE * f64::EPSILON * behind.abs();
        // Other functions may change their signs within rounding of the root of this one: the first of these sign
        // changes is the breakpoint.
        let is_first = until > a && self.is_proven(problem, Interval::new(a, until))?;
        is_first.then(|| self.refined(problem, a, (until, behind)))
    }

    /// Bisects an interval of time with a breakpoint to the resolution of its distance from `begin`, however long the
    /// step is.
    fn refined(&self, problem: &mut (impl Breaking + ?Sized), begin: f64, interval: (f64, f64)) -> (f64, f64) {
        let (mut before, mut after) = interval;
        while before > begin && after - before > f64::EPSILON * (after - begin) {
            let middle = before + 0.5 * (after - before);
            if middle <= before || middle >= after {
                break;
            }
            *if self.has_broken(problem, middle) { &mut after } else { &mut before } = middle;
        }
        (before, after)
    }

    /// Returns the floating-point numbers before and at the first sign change of a function (a breakpoint) that samples
    /// of the functions detect.
    fn first_sampled(
        &self,
        problem: &mut (impl Breaking + ?Sized),
        begin: f64,
        end: f64,
        h: f64,
    ) -> Option<(f64, f64)> {
        let mut before = begin;
        for sample in 1..=SAMPLES {
            let mut after = begin + (end - begin) * f64::from(sample) / f64::from(SAMPLES);
            if !self.has_broken(problem, after) {
                before = after;
                continue;
            }
            loop {
                let middle = before + 0.5 * (after - before);
                if middle <= before || middle >= after || after - before <= f64::EPSILON * h {
                    return Some((before, after));
                }
                *if self.has_broken(problem, middle) { &mut after } else { &mut before } = middle;
            }
        }
        None
    }

    /// Whether a function whose sign changes are breakpoints has reached or passed zero by time `t`; a function that is
    /// zero at the beginning of the step counts only if it has become negative.
    fn has_broken(&self, problem: &mut (impl Breaking + ?Sized), t: f64) -> bool {
        let is_broken = |(value, sign): (&f64, &f64)| match *sign {
            sign if sign < 0.0 => *value >= 0.0,
            sign if sign > 0.0 => *value <= 0.0 || value.is_nan(),
            _ => *value < 0.0 || value.is_nan(),
        };
        problem.breaks(t).iter().zip(&self.signs).any(is_broken)
    }

    /// Returns the first floating-point number from `t` on, within a few units of rounding, at which no function whose
    /// sign changes are breakpoints is zero; `t` if there is none.
    fn behind(&self, problem: &mut (impl Breaking + ?Sized), t: f64) -> f64 {
        let mut after = t;
        for _ in 0..AT_END as u32 {
            let is_zero = |(value, sign): (&f64, &f64)| *value == 0.0 && *sign != 0.0;
            if !problem.breaks(after).iter().zip(&self.signs).any(is_zero) {
                return after;
            }
            after = after.next_up();
        }
        t
    }
}

/// Returns the size of a step from `t` to `end`, reduced until the time of its last stage, `t` plus the step size,
/// does not round to a number beyond `end`.
fn length(t: f64, end: f64) -> f64 {
    let mut length = end - t;
    while length > 0.0 && t + length > end {
        length = length.next_down();
    }
    length
}

#[cfg(test)]
mod tests {
    use super::{Breaking, Breaks};
    use numerics::Interval;

    /// Test equations with the function `t - at` for each breakpoint `at`, and a count of the intervals that were
    /// enclosed.
    struct Steps {
        at: Vec<f64>,
        values: Vec<f64>,
        ranges: Vec<Interval>,
        enclosed: usize,
    }

    impl Breaking for Steps {
        fn breaks(&mut self, t: f64) -> &[f64] {
            self.values = self.at.iter().map(|at| t - at).collect();
            &self.values
        }

        fn enclose_breaks(&mut self, t: Interval) -> &[Interval] {
            self.enclosed += 1;
            self.ranges = self.at.iter().map(|at| t - Interval::point(*at)).collect();
            &self.ranges
        }
    }

    #[test]
    fn what_is_proved_of_an_interval_is_not_proved_again() {
        let mut problem = Steps { at: vec![1.0, 1.25], values: vec![], ranges: vec![], enclosed: 0 };
        let mut breaks = Breaks::new(0.0);
        assert_eq!(breaks.up_to_break(&mut problem, 0.0, 0.5), 0.5);
        assert_eq!(problem.enclosed, 1);
        // None of the following searches for breakpoints needs a new enclosure: a probe of the beginning of the step,
        // the step repeated with half its size, and the next step up to the end of the first attempt.
        assert_eq!(breaks.part_before(&mut problem, 0.0, 0.1), 0.1);
        assert_eq!(breaks.up_to_break(&mut problem, 0.0, 0.25), 0.25);
        assert_eq!(breaks.up_to_break(&mut problem, 0.25, 0.25), 0.25);
        assert_eq!(problem.enclosed, 1);

        // A longer step ends before the first breakpoint, wherever the step begins.
        let first = 0.5 + breaks.up_to_break(&mut problem, 0.5, 2.0);
        assert!(first < 1.0 && 1.0 - first < 1e-15, "{first}");
        // Two more enclosures of the functions: one of the whole step, and one of the interval before the first root.
        assert_eq!(problem.enclosed, 3);
        let enclosed = problem.enclosed;
        assert_eq!(0.75 + breaks.up_to_break(&mut problem, 0.75, 0.75), first);
        assert_eq!(breaks.up_to_break(&mut problem, 0.75, 0.125), 0.125);
        assert_eq!(problem.enclosed, enclosed);
        // After the first of the two breakpoints is passed, the search finds the second, later one.
        breaks.up_to_break(&mut problem, first, 2.0);
        let after = breaks.after().unwrap_or(1.0);
        breaks.pass(after);
        let second = after + breaks.up_to_break(&mut problem, after, 2.0);
        assert!(second < 1.25 && 1.25 - second < 1e-15, "{second}");
        assert!(problem.enclosed > enclosed);
    }

    #[test]
    fn of_breakpoints_within_rounding_the_first_ends_the_step() {
        for apart in [2.0, 100.0, 900.0] {
            let first = 1.0 - apart * f64::EPSILON;
            for at in [vec![1.0, first], vec![first, 1.0]] {
                let mut problem = Steps { at, values: vec![], ranges: vec![], enclosed: 0 };
                let end = Breaks::new(0.0).up_to_break(&mut problem, 0.0, 3.0);
                assert!(end < first && first - end <= f64::EPSILON, "{end} {first}");
            }
        }
    }
}
