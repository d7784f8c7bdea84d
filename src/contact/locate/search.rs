//! Search for the first end of a contact mode within a step, by the values of its monitors on the collocation
//! polynomial.
//!
//! While a contact sticks or rests, steps are long, and forces may cross a bound and return many times within one
//! step. Each part of a step is therefore sampled at five points `x = 0, 1/4, .. 1`: a monitor `g` is approximated by
//! the parabola `p` through three of them, with the remainder estimated from the deviations at the other two (and of
//! rates),
//!
//! ```text
//! g(x) - p(x) = (g - p)(1/4) w(x)/w(1/4),    w(x) = x (x - 1/2) (x - 1)
//! ```
//!
//! if the third derivative varies little. If `p` does not decide the sign of `g`, the part is halved.
//!
//! A monitor that leaves its bound at the beginning of the step, such as a gap after an impact or a slip after a
//! stop, has a root at that time, up to rounding. The root is divided out: `(g(t) - g(t_0))/(t - t_0)` begins with
//! the rate of `g`, and keeps the other roots.

use super::monitors::{Ending, Monitor};
use super::smooth_phase::SmoothPhase;
use numerics::Bracket;

/// Initial partition of a step in the search for events, by the golden section: no part is a multiple of another, as
/// periods of the motion might be.
const PARTED: f64 = 0.381_966_011_250_105;

/// Largest admissible deviation of a monitor (event function) from the parabola through three of its values, relative
/// to the parabola (`DOUBT`) or, once violated, to the monitor's range (`BENT`).
const DOUBT: f64 = 0.5;
const BENT: f64 = 0.1;

/// Deviations of a monitor (event function) from the parabola through three of its values below this multiple of the
/// monitor's noise are ignored.
pub(super) const NOISE: f64 = 16.0;

/// A 3D slip has stopped if it is below this fraction of its value halfway between the beginning of the step and the
/// stop.
const STOPPED: f64 = 1e-6;

/// The smallest part of a step that is halved in the search for events, relative to the step (`SMALLEST`) and to the
/// time (`ROUNDING_OF_TIME`, the resolution of the clock).
pub(super) const SMALLEST: f64 = 1e-6;
pub(super) const ROUNDING_OF_TIME: f64 = 32.0 * f64::EPSILON;

/// A monitor (event function) counts as jumping if it falls by this fraction of its change between two points within
/// the resolution of time.
const JUMP: f64 = 1e-3;

/// Largest number of sampling points of the search for events within one step; the remainder of the step is left to the
/// next.
const MOST_POINTS: usize = 1000;

/// Result of the search of a step for the event that ends the contact mode.
#[derive(Clone, Copy)]
pub(super) enum Search {
    /// The contact mode lasts throughout the step.
    Clear,
    /// The contact mode ends within the step, at this violation of a monitor.
    Ends(Violation),
    /// The contact mode lasts until this time at least; the remainder of the step becomes another step.
    Until(f64),
}

/// The violation of a monitor (event function) within a step, with the event that it indicates.
#[derive(Clone, Copy)]
pub struct Violation {
    pub t: f64,
    /// A later time at which the monitor was seen violated.
    pub seen: f64,
    pub index: usize,
    /// The reference value of the monitor: the value that it has at its root, the event.
    pub origin: f64,
    /// The slope of the monitor at its root, the event.
    pub slope: f64,
    /// Whether the monitor jumps, as when a force sets in.
    pub jumps: bool,
    pub ending: Ending,
}

/// The reference value from which a monitor (event function) is measured, in the search for its change of sign.
#[derive(Clone, Copy)]
enum Origin {
    /// Zero, or the value of the monitor at the beginning of the step if negative: drift is no violation until it
    /// grows.
    Floor(f64),
    /// The value of the monitor at the beginning of the step, a root there that is divided out of the monitor.
    Root(f64),
}

impl Origin {
    fn new(monitor: &Monitor) -> Self {
        let rises = monitor.rate.is_some_and(|rate| rate > 0.0);
        if monitor.is_on_bound() && rises { Self::Root(monitor.value) } else { Self::Floor(monitor.value.min(0.0)) }
    }

    /// Measures a monitor (event function) from its reference value, after the time `passed` since the beginning of the
    /// step.
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

/// The beginning of a step, with the reference values of its monitors.
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

/// The monitors at one time, measured from their reference values.
#[derive(Clone)]
struct Point {
    t: f64,
    monitors: Vec<Monitor>,
}

impl SmoothPhase<'_, '_> {
    /// Finds the earliest end of the contact mode on the collocation polynomial of the step.
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

    /// Returns the initial parts of a step for the search for events, the last part first.
    fn parts(&mut self, start: &Start, mut first: Point, h: f64, end: f64) -> Vec<[Point; 3]> {
        // The monitor of a force at its bound has no known rate, and hence no known sign behind the beginning of the
        // step: sample it slightly later.
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

    /// Finds the root at which a monitor (event function) falls to its reference value between two points, by the
    /// Illinois method.
    fn root(&mut self, index: usize, start: &Start, pair: &[Point]) -> Violation {
        let (left, right) = (&pair[0], &pair[1]);
        let at = |point: &Point| (point.t, point.monitors[index].value);
        let mut bracket = Bracket::new(at(left), at(right));
        let (range, mut above) = (bracket.before.1 - bracket.behind.1, bracket.before.1);
        let mut slope = -range / bracket.width();
        for _ in 0..80 {
            let (a, b) = (bracket.before.0, bracket.behind.0);
            let resolution = f64::EPSILON * b.abs();
            if bracket.before.1 <= 0.0 || bracket.width() <= 2.0 * resolution {
                break;
            }
            let t = bracket.guess_apart(resolution);
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
        // Take the known rate, if there is one, as the slope: the rate of the monitor is more accurate than a
        // difference quotient.
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

    /// Returns the end of the contact mode that was found at a root; or, if a slip in 3D has not stopped but only
    /// turned by a right angle, the time up to which its direction is valid.
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

/// Whether a monitor (event function) decreases between two points and is violated at the second.
fn falls(pair: &[Point], index: usize) -> bool {
    let (left, right) = (&pair[0].monitors[index], &pair[1].monitors[index]);
    right.value < -right.noise && right.value < left.value
}

/// Whether five points decide the sign of a monitor (event function) up to the point of index `seen - 1`, and the
/// number of its sign changes.
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
            // Allow for the deviation of the monitor's rate at this point from that of the parabola, as if it persisted
            // up to the next point.
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
