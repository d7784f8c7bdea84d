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

use super::leg::Leg;
use super::monitors::{Ending, Monitor};

/// Parts of a step to begin with.
const PARTS: usize = 2;

/// The part of its parabola by which a monitor may differ from it; and that of how much it varies, where it is violated.
const DOUBT: f64 = 0.5;
const BENT: f64 = 0.1;

/// The multiple of its noise by which it may.
const NOISE: f64 = 16.0;

/// The part of the noise of a gap that a rebound has to rise above: a few roundings of its terms.
const SEEN: f64 = 0.004;

/// The smallest part of a step that is halved.
const SMALLEST: f64 = 1e-6;

/// Points within one step; what lies behind them is left to the next.
const MOST_POINTS: usize = 1000;

/// What is known of a step.
pub(super) enum Search {
    /// The mode goes on.
    Clear,
    /// It ends.
    Ends(Violation),
    /// It goes on until then; what comes behind took too many points.
    Until(f64),
}

/// The violation of a monitor within a step, and how it falls.
pub(super) struct Violation {
    pub t: f64,
    pub index: usize,
    pub slope: f64,
    pub ending: Ending,
}

/// The monitors at a time.
#[derive(Clone)]
struct Point {
    t: f64,
    monitors: Vec<Monitor>,
}

/// What a monitor has to stay above: drift at the beginning of a step is no violation before it grows.
fn floor(start: &Monitor) -> f64 {
    start.value.min(0.0)
}

impl Leg<'_, '_> {
    /// The earliest ending of the mode on the collocation polynomial of the step.
    pub(super) fn search(&mut self, begin: f64, end: f64) -> Search {
        let h = end - begin;
        let start = self.point(begin);
        let floors: Vec<f64> = start.monitors.iter().map(floor).collect();
        if floors.is_empty() {
            return Search::Clear;
        }
        let mut ends = vec![start];
        for i in 1..2 * PARTS {
            ends.push(self.point(begin + h * i as f64 / (2 * PARTS) as f64));
        }
        ends.push(self.point(end));
        let mut parts: Vec<[Point; 3]> =
            ends.windows(3).step_by(2).rev().map(|three| [0, 1, 2].map(|i| three[i].clone())).collect();
        let mut points = 0;
        while let Some([a, m, b]) = parts.pop() {
            if points >= MOST_POINTS && a.t > begin {
                return Search::Until(a.t);
            }
            points += 2;
            let (first, last) = (self.point(0.5 * (a.t + m.t)), self.point(0.5 * (m.t + b.t)));
            let five = [a, first, m, last, b];
            let falls = |pair: &[Point], index: usize| {
                let (left, right) = (&pair[0].monitors[index], &pair[1].monitors[index]);
                right.value < floors[index] - right.noise && right.value < left.value
            };
            let found = five.windows(2).position(|pair| (0..floors.len()).any(|index| falls(pair, index)));
            let seen = found.map_or(5, |place| place + 2);
            let settled = (0..floors.len()).all(|index| is_settled(&five, seen, index, floors[index]));
            if !settled && five[4].t - five[0].t > SMALLEST * h {
                let [a, first, m, last, b] = five;
                parts.push([m.clone(), last, b]);
                parts.push([a, first, m]);
                continue;
            }
            if let Some(place) = found {
                let pair = &five[place..place + 2];
                let violated: Vec<usize> = (0..floors.len()).filter(|&index| falls(pair, index)).collect();
                let roots = violated.into_iter().map(|index| self.root(index, floors[index], &pair[0], &pair[1]));
                let earliest = roots.min_by(|a, b| a.t.total_cmp(&b.t));
                return earliest.map_or(Search::Clear, Search::Ends);
            }
        }
        Search::Clear
    }

    fn point(&mut self, t: f64) -> Point {
        let mut monitors = Vec::new();
        self.monitors_at(t, &mut monitors);
        Point { t, monitors }
    }

    /// Where a monitor falls to its floor between two points, by the method of Illinois.
    fn root(&mut self, index: usize, floor: f64, left: &Point, right: &Point) -> Violation {
        let ending = right.monitors[index].ending;
        let rate = left.monitors[index].rate;
        let (mut a, mut fa) = (left.t, left.monitors[index].value - floor);
        let (mut b, mut fb) = (right.t, right.monitors[index].value - floor);
        let mut slope = (fb - fa) / (b - a);
        let mut values = Vec::new();
        let mut kept = 0;
        // From where a mode begins on its boundary the first way is inwards; what is no more than rounding does not count.
        let noise = left.monitors[index].noise;
        let least = rate.map_or(noise, |_| SEEN * noise);
        if rate.map_or(fa <= 0.0, |rate| rate > 0.0) {
            let mut part = 0.5;
            fa = 0.0;
            while fa == 0.0 && part > f64::EPSILON {
                let t = left.t + part * (right.t - left.t);
                self.monitors_at(t, &mut values);
                let value = values[index].value - floor;
                if value > least {
                    (a, fa) = (t, value);
                } else {
                    (b, fb) = (t, value.min(0.0));
                }
                part *= 0.5;
            }
        }
        for _ in 0..80 {
            if fa <= 0.0 || b - a <= 2.0 * f64::EPSILON * b.abs() {
                break;
            }
            let t = (a * fb - b * fa) / (fb - fa);
            let t = if t > a && t < b { t } else { 0.5 * (a + b) };
            if t <= a || t >= b {
                break;
            }
            self.monitors_at(t, &mut values);
            let value = values[index].value - floor;
            if value <= 0.0 {
                if t < b {
                    slope = (fb - value) / (b - t);
                }
                (b, fb) = (t, value);
                fa *= if kept < 0 { 0.5 } else { 1.0 };
                kept = -1;
            } else {
                (a, fa) = (t, value);
                fb *= if kept > 0 { 0.5 } else { 1.0 };
                kept = 1;
            }
            if value == 0.0 {
                break;
            }
        }
        let t = if fa <= 0.0 { a } else { b };
        // A rate that is known is better than a quotient of differences.
        self.monitors_at(t, &mut values);
        Violation { t, index, slope: values[index].rate.unwrap_or(slope), ending }
    }
}

/// Whether the first `seen` of five points tell the sign of a monitor between them, and how often it changes.
fn is_settled(five: &[Point; 5], seen: usize, index: usize, floor: f64) -> bool {
    let monitor = |i: usize| &five[i].monitors[index];
    let value = five.each_ref().map(|point| point.monitors[index].value - floor);
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
    (0..4 * (seen - 1)).filter(|i| i % 8 != 0).all(|i| {
        let x = i as f64 / 16.0;
        rest * (w(x) / w(0.25)).abs() <= DOUBT * parabola(x) + noise
    })
}
