//! Where a mode first ends within a step, by what its monitors are on the collocation polynomial.
//!
//! While a contact sticks or rests nothing moves, steps are long, and forces may pass a bound and come back many times
//! within one. So each part of a step is looked at in five points `x = 0, 1/4, .. 1`: a monitor `g` is taken for the parabola
//! `p` through three of them, whose rest, from what it misses at the other two (and of rates),
//!
//! ```text
//! g(x) - p(x) = (g - p)(1/4) w(x)/w(1/4),    w(x) = x (x - 1/2) (x - 1)
//! ```
//!
//! if the third derivative varies little. Where `p` does not settle the sign of `g`, each half of the part is looked at so.
//!
//! A monitor that leaves its bound as the step begins, a gap after an impact, a slip after a stop, has a root there which is
//! rounding. It is divided out: `(g(t) - g(t_0))/(t - t_0)`, which begins with the rate of `g`, has the other roots alone.

use super::monitors::{Ending, Monitor};
use super::smooth_phase::SmoothPhase;
use numerics::Bracket;

/// Where a step is parted to begin with: no part is a multiple of another, which a period might be too.
const PARTED: f64 = 0.381_966_011_250_105;

/// The part of its parabola by which a monitor may differ from it; and that of how much it varies, where it is violated.
const DOUBT: f64 = 0.5;
const BENT: f64 = 0.1;

/// The multiple of its noise by which it may.
pub(super) const NOISE: f64 = 16.0;

/// A slip in space that stops is this small beside what it was.
const STOPPED: f64 = 1e-6;

/// The smallest part of a step that is halved, which times tell apart.
pub(super) const SMALLEST: f64 = 1e-6;
pub(super) const ROUNDING_OF_TIME: f64 = 32.0 * f64::EPSILON;

/// A monitor that falls by this part of its change between two points, at a time that is known to rounding, jumps there.
const JUMP: f64 = 1e-3;

/// Points within one step; what lies behind them is left to the next.
const MOST_POINTS: usize = 1000;

/// What is known of a step.
pub(super) enum Search {
    /// The mode goes on.
    Clear,
    /// It ends.
    Ends(Violation),
    /// It goes on until then; what comes behind is another step.
    Until(f64),
}

/// The violation of a monitor within a step.
pub(super) struct Violation {
    pub t: f64,
    /// A time behind it at which it was seen.
    pub seen: f64,
    pub index: usize,
    /// What it falls to.
    pub origin: f64,
    /// How it falls.
    pub slope: f64,
    /// Whether it falls at once, with a force that begins.
    pub jumps: bool,
    pub ending: Ending,
}

/// What a monitor is measured from.
#[derive(Clone, Copy)]
enum Origin {
    /// Zero, or where the step begins if that is below: drift is no violation before it grows.
    Floor(f64),
    /// Its value where the step begins, a root that is divided out.
    Root(f64),
}

impl Origin {
    fn new(monitor: &Monitor) -> Self {
        let rises = monitor.rate.is_some_and(|rate| rate > 0.0);
        if monitor.is_on_bound() && rises { Self::Root(monitor.value) } else { Self::Floor(monitor.value.min(0.0)) }
    }

    /// The monitor from here, after a time.
    fn measure(self, monitor: &mut Monitor, passed: f64) {
        match (self, monitor.rate) {
            (Self::Root(value), Some(rate)) if passed > 0.0 => {
                monitor.value = (monitor.value - value) / passed;
                monitor.noise /= passed;
                monitor.rate = Some((rate - monitor.value) / passed);
            }
            (Self::Root(_), rate) => {
                monitor.value = rate.unwrap_or(0.0);
                (monitor.noise, monitor.rate) = (0.0, None);
            }
            (Self::Floor(floor), _) => monitor.value -= floor,
        }
    }
}

/// Where a step begins, and what its monitors are measured from.
struct Start {
    t: f64,
    origins: Vec<Origin>,
}

impl Start {
    fn measure(&self, t: f64, mut monitors: Vec<Monitor>) -> Point {
        self.origins.iter().zip(&mut monitors).for_each(|(origin, monitor)| origin.measure(monitor, t - self.t));
        Point { t, monitors }
    }
}

/// The monitors at a time, from their origins.
#[derive(Clone)]
struct Point {
    t: f64,
    monitors: Vec<Monitor>,
}

impl SmoothPhase<'_, '_> {
    /// The earliest ending of the mode on the collocation polynomial of the step.
    pub(super) fn search(&mut self, begin: f64, end: f64) -> Search {
        let h = end - begin;
        let mut monitors = Vec::new();
        self.monitors_at(begin, &mut monitors);
        let all = 0..monitors.len();
        if all.is_empty() {
            return Search::Clear;
        }
        let start = Start { t: begin, origins: monitors.iter().map(Origin::new).collect() };
        let first = start.measure(begin, monitors);
        let smallest = (SMALLEST * h).max(ROUNDING_OF_TIME * end.abs());
        let mut parts = self.parts(&start, first, h, end);
        let mut points = 0;
        while let Some([a, m, b]) = parts.pop() {
            if points >= MOST_POINTS && a.t > begin {
                return Search::Until(a.t);
            }
            points += 2;
            let (first, last) = (self.point(&start, 0.5 * (a.t + m.t)), self.point(&start, 0.5 * (m.t + b.t)));
            let five = [a, first, m, last, b];
            let found = five.windows(2).position(|pair| all.clone().any(|index| falls(pair, index)));
            let seen = found.map_or(5, |place| place + 2);
            let settled = all.clone().all(|index| is_settled(&five, seen, index));
            if !settled && five[4].t - five[0].t > smallest {
                let [a, first, m, last, b] = five;
                parts.push([m.clone(), last, b]);
                parts.push([a, first, m]);
                continue;
            }
            if let Some(place) = found {
                let pair = &five[place..place + 2];
                let violated: Vec<usize> = all.clone().filter(|&index| falls(pair, index)).collect();
                let roots = violated.into_iter().map(|index| self.root(index, &start, pair));
                let earliest = roots.min_by(|a, b| a.t.total_cmp(&b.t));
                return earliest.map_or(Search::Clear, |found| self.end_at(begin, found));
            }
        }
        Search::Clear
    }

    /// The parts of a step to begin with, the first of them last.
    fn parts(&mut self, start: &Start, mut first: Point, h: f64, end: f64) -> Vec<[Point; 3]> {
        // Where a force goes from its bound it does not tell there.
        let unknown = |monitor: &Monitor| monitor.is_on_bound() && monitor.rate.is_none();
        if first.monitors.iter().any(unknown) {
            let soon = self.point(start, start.t + SMALLEST * h);
            let known = first.monitors.iter_mut().zip(soon.monitors);
            known.filter(|(monitor, _)| unknown(monitor)).for_each(|(monitor, soon)| *monitor = soon);
        }
        let ends: Vec<f64> = self.parts.ends.iter().copied().filter(|t| *t < end).collect();
        if !ends.is_empty() {
            let mut parts = Vec::new();
            for t in ends.into_iter().chain([end]) {
                let (middle, last) = (self.point(start, 0.5 * (first.t + t)), self.point(start, t));
                parts.push([first, middle, last.clone()]);
                first = last;
            }
            parts.reverse();
            return parts;
        }
        let mut at = |x: f64| self.point(start, start.t + x * h);
        let (left, parted, right) = (at(0.5 * PARTED), at(PARTED), at(0.5 * (1.0 + PARTED)));
        let last = self.point(start, end);
        vec![[parted.clone(), right, last], [first, left, parted]]
    }

    fn point(&mut self, start: &Start, t: f64) -> Point {
        let mut monitors = Vec::new();
        self.monitors_at(t, &mut monitors);
        start.measure(t, monitors)
    }

    /// Where a monitor falls to its origin between two points, by the method of Illinois.
    fn root(&mut self, index: usize, start: &Start, pair: &[Point]) -> Violation {
        let (left, right) = (&pair[0], &pair[1]);
        let at = |point: &Point| (point.t, point.monitors[index].value);
        let mut bracket = Bracket::new(at(left), at(right));
        let (range, mut above) = (bracket.before.1 - bracket.behind.1, bracket.before.1);
        let mut slope = -range / bracket.width();
        for _ in 0..80 {
            let (a, b) = (bracket.before.0, bracket.behind.0);
            if bracket.before.1 <= 0.0 || bracket.width() <= 2.0 * f64::EPSILON * b.abs() {
                break;
            }
            let t = bracket.guess();
            let t = if t > a && t < b { t } else { 0.5 * (a + b) };
            if t <= a || t >= b {
                break;
            }
            let value = self.point(start, t).monitors[index].value;
            if value > 0.0 {
                above = value;
            } else {
                slope = (bracket.behind.1 - value) / (b - t);
            }
            bracket.narrow(t, value);
            if value == 0.0 {
                break;
            }
        }
        let (a, b) = (bracket.before.0, bracket.behind.0);
        let below = self.point(start, b).monitors[index].value;
        let jumps = b - a <= 4.0 * f64::EPSILON * b.abs() && above - below > JUMP * range;
        let t = if bracket.before.1 <= 0.0 { a } else { b };
        let mut values = Vec::new();
        self.monitors_at(t, &mut values);
        let (Origin::Floor(origin) | Origin::Root(origin)) = start.origins[index];
        // A rate that is known is better than a quotient of differences.
        Violation {
            t,
            seen: right.t,
            index,
            origin,
            slope: values[index].rate.unwrap_or(slope),
            jumps,
            ending: values[index].ending,
        }
    }

    /// The ending found; or, where a slip in space has turned by a right angle, as far as its direction is known.
    fn end_at(&mut self, begin: f64, found: Violation) -> Search {
        if let Ending::SlipToStick(k) = found.ending
            && found.t > begin
        {
            let ((before, _), (after, tolerance)) =
                (self.slip_at(k, 0.5 * (begin + found.t)), self.slip_at(k, found.t));
            if after > tolerance + STOPPED * before {
                return Search::Until(found.t);
            }
        }
        Search::Ends(found)
    }
}

/// Whether a monitor is violated at the second of two points, and falls.
fn falls(pair: &[Point], index: usize) -> bool {
    let (left, right) = (&pair[0].monitors[index], &pair[1].monitors[index]);
    right.value < -right.noise && right.value < left.value
}

/// Whether the first `seen` of five points tell the sign of a monitor between them, and how often it changes.
fn is_settled(five: &[Point; 5], seen: usize, index: usize) -> bool {
    let monitor = |i: usize| &five[i].monitors[index];
    let value = five.each_ref().map(|point| point.monitors[index].value);
    if !value.iter().all(|value| value.is_finite()) {
        return true;
    }
    let h = five[4].t - five[0].t;
    let (linear, square) = (4.0 * value[2] - 3.0 * value[0] - value[4], 2.0 * (value[0] + value[4] - 2.0 * value[2]));
    let parabola = |x: f64| value[0] + x * (linear + x * square);
    let mut rest = (value[1] - parabola(0.25)).abs().max((value[3] - parabola(0.75)).abs());
    for i in 0..5 {
        if let Some(rate) = monitor(i).rate {
            // A rate that goes on to the next point.
            rest = rest.max(0.25 * (h * rate - linear - 0.5 * i as f64 * square).abs());
        }
    }
    let noise = (0..5).map(|i| monitor(i).noise).fold(0.0, f64::max);
    rest = (rest - NOISE * noise).max(0.0);
    if value[..seen].iter().any(|value| *value < -noise) {
        let most = value.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let least = value.iter().copied().fold(f64::INFINITY, f64::min);
        return rest <= BENT * (most - least);
    }
    let w = |x: f64| x * (x - 0.5) * (x - 1.0);
    let seen = 0.25 * (seen - 1) as f64;
    let lowest = -0.5 * linear / square;
    let places = (0..16).filter(|i| i % 8 != 0).map(|i| i as f64 / 16.0).chain([lowest]);
    places.filter(|x| *x > 0.0 && *x < seen).all(|x| rest * (w(x) / w(0.25)).abs() <= DOUBT * parabola(x) + noise)
}
