//! Breaks: the times at which a rate, a `G` or a bound has a kink or a jump whatever the states are, as one with
//! `heaviside(t - 1)` has. A step across one would be of order one, and one longer than a pulse need not see it at all.
//!
//! What changes its sign there is enclosed over the step in interval arithmetic, and parts over which a change is not excluded
//! are halved, the first part first: no break is passed over, however short the time to the next. A step ends on the last
//! number before the first change, and the next begins on the first number after it.

use numerics::Interval;
use problem::Dvi;

/// The parts of a step that are enclosed at most. A break takes two for each binary digit of a double; more are left where a
/// quantity touches zero, about which enclosures say little.
const MOST_PARTS: usize = 400;
/// Samples of a step whose enclosures leave changes of sign open. It is then no longer than twice the time between the last
/// two breaks, or since the last: periodic forcing is sampled eight times between two of its breaks.
const SAMPLES: u32 = 16;
/// Breaks closer to each other than this many units of rounding are one: those of `t - 1` and `3*t - 3` are at one time, but for
/// a few units, or for as many as digits cancel in a longer expression. Fewer would take such a pair for a step of its own;
/// many more would take two breaks for one where what lies between them counts.
const ONE: f64 = 1e3;
/// A break within this many units of rounding of either end of a step is at that end: the sums that give the end, and the time of
/// the break, are off by a unit or two each. Fewer would leave steps of some units; many more would move breaks.
const AT_END: f64 = 8.0;

/// What is remembered of breaks.
#[derive(Debug)]
pub struct Breaks {
    signs: Vec<bool>,
    /// The parts of a step that are left to be enclosed, the first last.
    left: Vec<(f64, f64)>,
    /// The last break or the start, and the time to it from the one before.
    last: f64,
    gap: f64,
    /// The first number after the break before which the present step ends.
    after: Option<f64>,
}

impl Breaks {
    /// For a run that starts at `t`.
    pub fn new(t: f64) -> Self {
        Self { signs: Vec::new(), left: Vec::new(), last: t, gap: f64::INFINITY, after: None }
    }

    /// The first number after the break before which the present step ends, if it ends at one.
    pub fn after(&self) -> Option<f64> {
        self.after
    }

    /// The part of a step from `t` of size `h` up to the first break; zero where a run is to [pass](Self::pass) it first.
    pub fn up_to_break(&mut self, problem: &mut dyn Dvi, t: f64, h: f64) -> f64 {
        self.after = None;
        let noise = f64::EPSILON * (ONE * t.abs() + h);
        let is_behind_break = t - self.last <= noise;
        if is_behind_break && h <= noise {
            return h;
        }
        // What is left of the last break is rounding.
        let begin = if is_behind_break { t + noise } else { t };
        self.signs.clear();
        self.signs.extend(problem.breaks(begin).iter().map(|value| *value >= 0.0));
        if self.signs.is_empty() {
            return h;
        }
        let end_of = |h: f64| t + h + AT_END * f64::EPSILON * t.abs().max(h);
        match self.first_enclosed(problem, begin, end_of(h), h) {
            Some(None) => h,
            Some(Some(found)) => self.end_before(found, t, h),
            None => {
                let h = h.min(2.0 * self.gap.max(t - self.last));
                let found = self.first_sampled(problem, begin, end_of(h), h);
                found.map_or(h, |found| self.end_before(found, t, h))
            }
        }
    }

    /// Takes note that a run goes on behind a break.
    pub fn pass(&mut self, after: f64) {
        let gap = after - self.last;
        if gap > ONE * f64::EPSILON * after.abs() {
            self.gap = gap;
        }
        self.last = after;
        self.after = None;
    }

    fn end_before(&mut self, (before, after): (f64, f64), t: f64, h: f64) -> f64 {
        self.after = Some(after);
        let part = (before - t).min(h);
        if part <= AT_END * f64::EPSILON * t.abs() { 0.0 } else { part }
    }

    /// The numbers before and after the first change of a sign; `None` where enclosures do not tell whether there is one.
    fn first_enclosed(&mut self, problem: &mut dyn Dvi, begin: f64, end: f64, h: f64) -> Option<Option<(f64, f64)>> {
        self.left.clear();
        self.left.push((begin, end));
        let mut parts = 0;
        while let Some((a, b)) = self.left.pop() {
            parts += 1;
            if parts > MOST_PARTS {
                return None;
            }
            let ranges = problem.enclose_breaks(Interval::new(a, b));
            if ranges.len() != self.signs.len() {
                return None;
            }
            let keeps = |(range, sign): (&Interval, &bool)| if *sign { range.least() >= 0.0 } else { range.hi < 0.0 };
            if ranges.iter().zip(&self.signs).all(keeps) {
                continue;
            }
            let middle = a + 0.5 * (b - a);
            if middle > a && middle < b && b - a > f64::EPSILON * h {
                self.left.extend([(middle, b), (a, middle)]);
            } else if self.has_broken(problem, b) {
                return Some(Some((a, b)));
            }
        }
        Some(None)
    }

    /// The numbers before and after the first change of a sign that samples show.
    fn first_sampled(&self, problem: &mut dyn Dvi, begin: f64, end: f64, h: f64) -> Option<(f64, f64)> {
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

    fn has_broken(&self, problem: &mut dyn Dvi, t: f64) -> bool {
        problem.breaks(t).iter().zip(&self.signs).any(|(value, sign)| (*value >= 0.0) != *sign)
    }
}
