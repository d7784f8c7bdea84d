//! Bursts: explicit dependence on time that a step has missed, such as a force, a belt or a floor that acts briefly
//! between all points at which the step was evaluated.
//!
//! Forces, the drift `b` of the velocities `u = J v + b` of contacts and joints, and the bias of their rates are
//! enclosed over the times of a step, with coordinates and velocities frozen at the middle of each part of the step.
//! A part is halved if an enclosure is much wider than the values at the ends and the middle of the part, or if these
//! three values are far from a straight line. In each resulting part the slopes of the collocation polynomial are
//! then compared with the accelerations: where they differ, the step went over a burst and is repeated up to the
//! beginning of the burst.

use super::hidden::{HALVINGS, Hidden, NEXT};
use super::mode::Status;
use super::smooth_phase::SmoothPhase;
use numerics::{Interval, is_seen};

/// Largest number of parts of one step; beyond it, parts not proven to represent the dependence on time are not halved
/// further.
const MOST_PARTS: usize = 400;

/// The shortest part into which a step is halved, relative to the step.
const SMALLEST: f64 = 1e-9;

/// A burst of time-dependent forces was missed if slopes of velocities in the middle of a part differ from the
/// accelerations by more than `OFF` tolerances, over the length of the part: the derivative of the collocation
/// polynomial is one order less accurate than its end values.
const OFF: f64 = 10.0;

/// A partition of a step into parts in time.
#[derive(Clone, Debug, Default)]
pub(super) struct Parts {
    /// The times at which the parts of the step end, except for the last part.
    pub ends: Vec<f64>,
    /// Whether the points of every part represent the dependence on time within that part, as enclosures prove.
    pub are_decided: bool,
}

impl SmoothPhase<'_, '_> {
    /// Partitions a step so that the points of each part represent the explicit dependence on time.
    pub(super) fn parts_in_time(&mut self, begin: f64, end: f64) -> Parts {
        let mut parts = Parts { ends: Vec::new(), are_decided: true };
        if !self.located.structure.depends_on_time {
            return parts;
        }
        let n = self.located.structure.coordinates;
        let allowed = self.tolerances_in_time(begin, end);
        let least = (SMALLEST * (end - begin)).max(8.0 * self.watch.problem().rounding_of_time(end));
        let (mut stack, mut passed) = (vec![(begin, end)], 0);
        while let Some((a, b)) = stack.pop() {
            passed += 1;
            let middle = 0.5 * (a + b);
            let mut x = vec![0.0; 2 * n];
            self.at(middle, &mut x);
            let is_small = b - a <= least;
            if !is_small && !self.shows((a, b), &x, &allowed) && passed + stack.len() < MOST_PARTS {
                stack.extend([(middle, b), (a, middle)]);
                continue;
            }
            parts.are_decided &= is_small || passed + stack.len() < MOST_PARTS;
            if b < end {
                parts.ends.push(b);
            }
        }
        parts
    }

    /// Returns the tolerances, for the partition of a step in time, of forces, of the drift of contact velocities, of
    /// the bias of their rates, and of varying coefficients of friction: errors within them change velocities by no
    /// more than the tolerances of velocities.
    fn tolerances_in_time(&mut self, begin: f64, end: f64) -> Vec<f64> {
        let n = self.located.structure.coordinates;
        let mut x = vec![0.0; 2 * n];
        self.at(begin, &mut x);
        self.watch.evaluate_at(begin, &x);
        let (h, radau) = (end - begin, &self.located.radau);
        let of_v = radau.tolerances(n, &x[n..]);
        let mass = self.watch.masses();
        let forces = mass.zip(&of_v).map(|(mass, of_v)| mass * of_v / h);
        let constraints = self.watch.constraints();
        let rows = 0..self.located.structure.rows();
        let drift = rows.clone().map(|row| constraints.size(row, &of_v));
        let bias = rows.map(|row| constraints.size(row, &of_v) / h);
        let forces: Vec<f64> = forces.collect();
        // The tolerance on the dependence on time of a coefficient of friction follows from those of the forces,
        // divided by its normal force.
        let structure = &self.located.structure;
        let varying = (0..self.mode.len()).filter(|&k| structure.contacts[k].varies);
        let coefficient = |k: usize| {
            let load = self.watch.lambda[structure.normal(k)].abs();
            let of_row = |row: usize| {
                let push = self.watch.constraints().row(row);
                push.iter().zip(&forces).map(|(j, force)| force / (load * j.abs())).fold(f64::INFINITY, f64::min)
            };
            structure.tangents(k).map(of_row).fold(f64::INFINITY, f64::min)
        };
        let coefficients: Vec<f64> = varying.map(coefficient).collect();
        forces.into_iter().chain(drift).chain(bias).chain(coefficients).collect()
    }

    /// Encloses forces, the drift of contact velocities, the bias of their rates, and varying coefficients of
    /// friction over times `t`, with coordinates and velocities frozen.
    fn enclose_in_time(&mut self, t: Interval, x: &[f64], values: &mut [Interval]) {
        let (q, v) = x.split_at(x.len() / 2);
        let structure = &self.located.structure;
        let (of_motion, of_friction) = values.split_at_mut(q.len() + 2 * structure.rows());
        self.watch.problem().enclose_in_time(t, q, v, of_motion);
        let frozen: Vec<Interval> = x.iter().map(|x| Interval::point(*x)).collect();
        let varying = (0..self.mode.len()).filter(|&k| structure.contacts[k].varies);
        for (value, k) in of_friction.iter_mut().zip(varying) {
            let slip_speed = match self.mode[k] {
                Status::Slip(_) => structure.contacts[k].slip_speed(&self.watch.slip(k, v)),
                _ => 0.0,
            };
            *value = self.watch.problem().enclose_friction(k, t, &frozen, Interval::point(slip_speed));
        }
    }

    /// Whether the values at the ends and the middle of a part represent the explicit dependence on time within it.
    fn shows(&mut self, (a, b): (f64, f64), x: &[f64], allowed: &[f64]) -> bool {
        let mut enclosed = vec![Interval::LINE; allowed.len()];
        self.enclose_in_time(Interval::new(a, b), x, &mut enclosed);
        let is_narrow = |(value, allowed): (&Interval, &f64)| value.defined && value.width() <= *allowed;
        if enclosed.iter().zip(allowed).all(is_narrow) {
            return true;
        }
        let mut seen = [a, 0.5 * (a + b), b].map(|t| (t, vec![Interval::LINE; allowed.len()]));
        for (t, values) in &mut seen {
            self.enclose_in_time(Interval::point(*t), x, values);
        }
        let [(_, first), (_, middle), (_, last)] = &seen;
        (0..allowed.len()).all(|i| is_seen(enclosed[i], [first[i].lo, middle[i].lo, last[i].lo], allowed[i]))
    }

    /// Finds a burst of time-dependent forces that the last step missed, in one of the parts of the step.
    pub(super) fn burst(&mut self, begin: f64, end: f64) -> Option<Hidden> {
        let mut from = begin;
        let ends = self.parts.ends.clone();
        let last = (!ends.is_empty()).then_some(end);
        for to in ends.into_iter().chain(last) {
            let middle = 0.5 * (from + to);
            if self.is_off(middle, to - from, OFF) {
                return Some(self.before(begin, middle, to - from));
            }
            from = to;
        }
        None
    }

    /// Whether the slopes of velocities at the time `t` differ from the accelerations that the mode equations give by
    /// more than `multiple` tolerances over `length`.
    fn is_off(&mut self, t: f64, length: f64, multiple: f64) -> bool {
        let n = self.located.structure.coordinates;
        let mut x = vec![0.0; 2 * n];
        self.at(t, &mut x);
        let slopes = self.slopes_at(t);
        self.watch.evaluate_at(t, &x);
        let tolerances = self.located.radau.tolerances(n, &x[n..]);
        (0..n).any(|i| (slopes[n + i] - self.watch.a[i]).abs() * length > multiple * tolerances[i])
    }

    /// Returns the cut of a step whose velocity slopes were found to differ from the accelerations of the mode
    /// equations at the time `seen`.
    fn before(&mut self, begin: f64, seen: f64, length: f64) -> Hidden {
        let (mut clear, mut off) = (begin, seen);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (clear + off);
            if middle <= clear || middle >= off {
                break;
            }
            let side = if self.is_off(middle, length, 1.0) { &mut off } else { &mut clear };
            *side = middle;
        }
        // A burst of forces may begin earlier than the slopes of velocities show.
        let until = (clear - (seen - clear)).max(begin);
        Hidden { until, next: NEXT * (seen - until) }
    }
}
