//! Screening of an accepted step by enclosure: may a monitor of the face that it kept have changed its sign unseen?
//!
//! The unknowns are polynomials over the step, whose coefficients in the basis of Bernstein bound their range. `G` and
//! the bounds in interval arithmetic over that box hold every value of a monitor `m`; where the plain enclosure is too
//! wide, so does
//!
//! ```text
//! m(middle) + m' [-1/2, 1/2],    m' = G_t dt/du + sum_j G_yj dy_j/du    over the part, u in [0, 1],
//! ```
//!
//! or the value at one end where `m'` has one sign. A part of the step that is not decided is halved (Kearfott 1996,
//! *Rigorous Global Search*). A monitor is proven to keep its sign where it stays above what the tolerances leave
//! uncertain of it; it is seen to change it where the variational inequality itself fails at a point in between.

use super::face::Place;
use super::law::Excess;
use super::stepper::Radau;
use super::tableau::Tableau;
use numerics::Interval;
use problem::Side;

/// The parts of one step that are enclosed at most. Halving a part where a monitor starts at its zero gains a binary
/// digit each time, so that this settles monitors down to `2^-50` of their range at both ends of a step.
const MOST_PARTS: usize = 200;
/// The excess up to which a law holds: one decimal digit less than asked for.
pub const ALLOWED: f64 = 10.0;

/// What screening found of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Screened {
    /// No monitor changes its sign.
    Proven,
    /// Neither proven nor seen to fail: parts were left undecided, or the problem cannot be enclosed.
    Undecided,
    /// The law fails at this time by this much.
    Missed(f64, Excess),
}

/// A quantity that must not become negative on the face.
#[derive(Clone, Copy, Debug)]
struct Watched {
    variable: usize,
    place: Place,
    /// Of a variable inside: whether the upper bound is meant.
    upper: bool,
    /// What counts as zero.
    limit: f64,
}

/// A part of the step: `theta` in `[begin, begin + length]`, and the coefficients of each unknown there.
#[derive(Clone, Debug)]
struct Part {
    begin: f64,
    length: f64,
    coefficients: Vec<f64>,
}

impl Radau<'_> {
    /// Screens the last step, where each unknown has been as large as `largest` in this run.
    pub fn screen(&mut self, largest: &[f64]) -> Screened {
        let evaluations = self.system.work.rates;
        std::mem::swap(&mut self.system.face, &mut self.last.face);
        let screened = self.screen_on_face(largest);
        std::mem::swap(&mut self.system.face, &mut self.last.face);
        // Screening is no part of the method: its work is not counted as that of the run.
        self.system.work.rates = evaluations;
        screened
    }

    fn screen_on_face(&mut self, largest: &[f64]) -> Screened {
        // Where a face ends, its own variables must still be within their law.
        let end = self.last.t + self.last.h;
        if !self.continues
            && let Some(excess) = self.excess_within(end, largest).filter(|found| found.excess > ALLOWED)
        {
            return Screened::Missed(end, excess);
        }
        let watched = self.watched(largest);
        let has_blocks = self.system.set.has_blocks();
        if has_blocks && let Some((t, excess)) = self.sampled_excess(largest) {
            return Screened::Missed(t, excess);
        }
        let mut undecided = has_blocks;
        let tableau = self.methods[self.last_method].tableau;
        let whole = Part { begin: 0.0, length: 1.0, coefficients: self.bernstein(tableau) };
        let (mut stack, mut parts) = (vec![whole], 0);
        while !watched.is_empty()
            && let Some(part) = stack.pop()
        {
            parts += 1;
            if part.length * self.last.h <= self.rounding_of_time(self.last.h) {
                // No event could be told from the end of the step, where a break of the rows may stand.
                continue;
            }
            let Some(left) = self.unproven(&part, &watched) else { return Screened::Undecided };
            if left.is_empty() {
                continue;
            }
            let t = self.last.t + self.last.h * (part.begin + 0.5 * part.length);
            if left.iter().any(|(_, middle)| *middle < 0.0)
                && let Some(excess) = self.excess_within(t, largest).filter(|found| found.excess > ALLOWED)
            {
                return Screened::Missed(t, excess);
            }
            if parts >= MOST_PARTS {
                undecided = true;
                break;
            }
            let (first, second) = part.halves(tableau.stages() + 1);
            stack.extend([second, first]);
        }
        if undecided { Screened::Undecided } else { Screened::Proven }
    }

    /// The monitors of the face, but for those of blocks.
    fn watched(&self, largest: &[f64]) -> Vec<Watched> {
        let mut watched = Vec::new();
        for &k in &self.system.intervals {
            let [of_z, of_g] = self.uncertainties(k, largest).map(|size| ALLOWED * size);
            let place = self.system.face.places[k];
            match place {
                Place::Lower | Place::Upper => watched.push(Watched { variable: k, place, upper: false, limit: of_g }),
                Place::Inside => {
                    let ends = [(false, self.system.set.lower[k]), (true, self.system.set.upper[k])];
                    let finite = ends.into_iter().filter(|(_, end)| end.is_finite());
                    watched.extend(finite.map(|(upper, _)| Watched { variable: k, place, upper, limit: of_z }));
                }
                Place::Held | Place::Boundary(_) | Place::Vertex => {}
            }
        }
        watched
    }

    /// The monitors that are not proven over a part, each with its value in the middle beyond its limit; `None` where the
    /// problem cannot be enclosed.
    fn unproven(&mut self, part: &Part, watched: &[Watched]) -> Option<Vec<(Watched, f64)>> {
        let degree = self.methods[self.last_method].tableau.stages() + 1;
        let (begin, h) = (self.last.t + part.begin * self.last.h, part.length * self.last.h);
        let t = Interval::new(begin.next_down(), (begin + h).next_up());
        let ranges: Vec<Interval> = part.coefficients.chunks_exact(degree + 1).map(range).collect();
        let mut values = vec![Interval::LINE; self.system.values.len()];
        if !self.system.problem().enclose(t, &ranges, &mut values) {
            return None;
        }
        let left: Vec<Watched> =
            watched.iter().copied().filter(|monitor| !is_proven(self.lower_end(monitor, &ranges, &values))).collect();
        if left.is_empty() {
            return Some(Vec::new());
        }
        let at = |theta: f64| -> Vec<f64> {
            part.coefficients.chunks_exact(degree + 1).map(|coefficients| casteljau(coefficients, theta)).collect()
        };
        let at_middle = self.at_point(begin + 0.5 * h, &at(0.5), &left);
        let slopes = self.slopes(part, t, h, &ranges, &left);
        let (mut at_begin, mut at_end) = (None, None);
        let mut unproven = Vec::new();
        for (i, (monitor, middle)) in left.iter().zip(&at_middle).enumerate() {
            let lower = match slopes.as_ref().map(|slopes| slopes[i]) {
                Some(slope) if slope.lo >= 0.0 => {
                    at_begin.get_or_insert_with(|| self.at_point(begin, &at(0.0), &left))[i]
                }
                Some(slope) if slope.hi <= 0.0 => {
                    at_end.get_or_insert_with(|| self.at_point(begin + h, &at(1.0), &left))[i]
                }
                Some(slope) => middle - 0.5 * slope.lo.abs().max(slope.hi.abs()),
                None => f64::NEG_INFINITY,
            };
            if !is_proven(lower) {
                unproven.push((*monitor, *middle));
            }
        }
        Some(unproven)
    }

    /// The lower end of a monitor with its limit added, over the box that `ranges` and `values` belong to.
    fn lower_end(&self, monitor: &Watched, ranges: &[Interval], values: &[Interval]) -> f64 {
        let (n, k) = (self.system.states, monitor.variable);
        let value = match monitor.place {
            Place::Lower => values[n + k],
            Place::Upper => -values[n + k],
            _ if monitor.upper => self.system.bound(k, Side::Upper, values) - ranges[n + k],
            _ => ranges[n + k] - self.system.bound(k, Side::Lower, values),
        };
        if value.defined { value.lo + monitor.limit } else { f64::NAN }
    }

    /// The monitors with their limits added at a point.
    fn at_point(&mut self, t: f64, y: &[f64], monitors: &[Watched]) -> Vec<f64> {
        let n = self.system.states;
        if !self.system.evaluate(t, y) {
            return vec![f64::NAN; monitors.len()];
        }
        let system = &self.system;
        let value = |monitor: &Watched| {
            let k = monitor.variable;
            match monitor.place {
                Place::Lower => system.values[n + k],
                Place::Upper => -system.values[n + k],
                _ if monitor.upper => system.set.upper[k] - y[n + k],
                _ => y[n + k] - system.set.lower[k],
            }
        };
        monitors.iter().map(|monitor| value(monitor) + monitor.limit).collect()
    }

    /// The slopes of monitors over a part, in its own unit of time; `None` where the problem cannot be enclosed. That of a
    /// variable inside whose bound moves is the line.
    fn slopes(
        &mut self,
        part: &Part,
        t: Interval,
        h: f64,
        ranges: &[Interval],
        monitors: &[Watched],
    ) -> Option<Vec<Interval>> {
        let n = self.system.states;
        let degree = self.methods[self.last_method].tableau.stages() + 1;
        let mut jacobian = vec![Interval::LINE; self.system.derivatives.len()];
        let mut by_time = vec![Interval::LINE; self.system.unknowns - n];
        if !self.system.problem().enclose_derivatives(t, ranges, &mut jacobian, &mut by_time) {
            return None;
        }
        let rate = |j: usize| {
            let coefficients = &part.coefficients[j * (degree + 1)..(j + 1) * (degree + 1)];
            let differences: Vec<f64> =
                coefficients.windows(2).map(|pair| degree as f64 * (pair[1] - pair[0])).collect();
            range(&differences)
        };
        let slope = |monitor: &Watched| {
            let k = monitor.variable;
            match monitor.place {
                Place::Inside if self.system.moves(k) => Interval::LINE,
                Place::Inside if monitor.upper => -rate(n + k),
                Place::Inside => rate(n + k),
                place => {
                    let explicit = by_time[k] * Interval::point(h);
                    let along = self.system.places_of_row(n + k).map(|(at, j)| jacobian[at] * rate(j));
                    let slope = along.fold(explicit, |sum, term| sum + term);
                    if place == Place::Upper { -slope } else { slope }
                }
            }
        };
        let found = monitors.iter().map(slope);
        Some(found.map(|slope| if slope.defined { slope } else { Interval::LINE }).collect())
    }

    /// The excess of the law at a time within the last step, with the variables that belong to the states there on its
    /// face, whether `K` holds them or not.
    fn excess_within(&mut self, t: f64, largest: &[f64]) -> Option<Excess> {
        let mut y = vec![0.0; self.system.unknowns];
        self.last.at(self.methods[self.last_method].tableau, t, &mut y);
        if let Some(consistent) = &mut self.consistent
            && !consistent.solve(&mut self.system, &self.control, t, &mut y)
        {
            self.forget_jacobian();
        }
        self.law_excess(t, &y, largest)
    }

    /// The first of the middles between the stages at which the law fails: what is looked at for blocks, whose monitors
    /// have no enclosure.
    fn sampled_excess(&mut self, largest: &[f64]) -> Option<(f64, Excess)> {
        let mut left = 0.0;
        let nodes = self.methods[self.last_method].tableau.c.clone();
        nodes.into_iter().find_map(|node| {
            let t = self.last.t + 0.5 * (left + node) * self.last.h;
            left = node;
            let excess = self.excess_within(t, largest).filter(|found| found.excess > ALLOWED)?;
            Some((t, excess))
        })
    }

    /// Intervals that hold the states between two times within the last step: the ranges of its polynomials.
    pub fn enclose_states(&self, from: f64, to: f64) -> Vec<Interval> {
        let tableau = self.methods[self.last_method].tableau;
        let [from, to] = [from, to].map(|t| ((t - self.last.t) / self.last.h).clamp(0.0, 1.0));
        let all = self.bernstein(tableau);
        let states = all.chunks_exact(tableau.stages() + 2).take(self.system.states);
        states.map(|coefficients| range(&restricted(coefficients, from, to))).collect()
    }

    /// The slopes of the states at a time within the last step, on its polynomial.
    pub fn slopes_at(&self, t: f64) -> Vec<f64> {
        let tableau = self.methods[self.last_method].tableau;
        let (degree, theta) = (tableau.stages() + 1, (t - self.last.t) / self.last.h);
        let all = self.bernstein(tableau);
        let slope = |coefficients: &[f64]| {
            let differences: Vec<f64> = coefficients.windows(2).map(|pair| pair[1] - pair[0]).collect();
            degree as f64 * casteljau(&differences, theta) / self.last.h
        };
        all.chunks_exact(degree + 1).take(self.system.states).map(slope).collect()
    }

    /// The unknowns over the last step in the basis of Bernstein of degree `s + 1`.
    fn bernstein(&self, tableau: &Tableau) -> Vec<f64> {
        let (s, n) = (tableau.stages(), self.system.unknowns);
        let (increments, bubble) = tableau.bernstein();
        let mut coefficients = Vec::with_capacity(n * (s + 2));
        for j in 0..n {
            for i in 0..s + 2 {
                let along: f64 = (0..s).map(|stage| increments[stage][i] * self.last.z[stage * n + j]).sum();
                let slope = self.last.slope.get(j).map_or(0.0, |slope| bubble[i] * slope);
                coefficients.push(self.last.y[j] + along + slope);
            }
        }
        coefficients
    }
}

impl Part {
    /// Both halves, by de Casteljau's algorithm, where polynomials have this degree.
    fn halves(&self, degree: usize) -> (Self, Self) {
        let length = 0.5 * self.length;
        let (mut first, mut second) = (self.coefficients.clone(), self.coefficients.clone());
        for (first, second) in first.chunks_exact_mut(degree + 1).zip(second.chunks_exact_mut(degree + 1)) {
            for (round, first) in first.iter_mut().enumerate().skip(1) {
                for i in 0..=degree - round {
                    second[i] = 0.5 * (second[i] + second[i + 1]);
                }
                *first = second[0];
            }
        }
        let part = |begin, coefficients| Self { begin, length, coefficients };
        (part(self.begin, first), part(self.begin + length, second))
    }
}

/// Whether a lower end shows that a monitor is not negative; one that is not a number shows nothing.
fn is_proven(lower: f64) -> bool {
    lower >= 0.0
}

/// The range of a polynomial with these coefficients, widened by their rounding.
fn range(coefficients: &[f64]) -> Interval {
    let (lo, hi) = coefficients.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), &c| (lo.min(c), hi.max(c)));
    let noise = 8.0 * f64::EPSILON * lo.abs().max(hi.abs());
    if coefficients.iter().any(|c| c.is_nan()) { Interval::LINE } else { Interval::new(lo - noise, hi + noise) }
}

/// The coefficients of a polynomial over a part of its interval.
fn restricted(coefficients: &[f64], from: f64, to: f64) -> Vec<f64> {
    let degree = coefficients.len() - 1;
    // Up to `to`, then from `from` on.
    let mut part = coefficients.to_vec();
    for round in 1..=degree {
        for i in (round..=degree).rev() {
            part[i] = part[i - 1] + to * (part[i] - part[i - 1]);
        }
    }
    let from = if to > 0.0 { from / to } else { 0.0 };
    for round in 1..=degree {
        for i in 0..=degree - round {
            part[i] += from * (part[i + 1] - part[i]);
        }
    }
    part
}

/// The value of a polynomial at `theta`.
fn casteljau(coefficients: &[f64], theta: f64) -> f64 {
    let mut values = coefficients.to_vec();
    for round in (1..values.len()).rev() {
        for i in 0..round {
            values[i] += theta * (values[i + 1] - values[i]);
        }
    }
    values[0]
}
