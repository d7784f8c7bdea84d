//! Screening of closed contacts between the points at which a step was evaluated: normal forces stay positive and
//! friction below its bound, by the [enclosure](super::enclosed_forces) of both; slips continue, by an enclosure or by
//! the lower bound
//!
//! ```text
//! u_t(middle) - |u_t'| length/2
//! ```
//!
//! or the value at one end where the rate has one sign. An undecided part of the step is halved.

use super::hidden::{MOST_PARTS, lowest};
use super::mode::Status;
use super::monitors::Ending;
use super::search::{NOISE, ROUNDING_OF_TIME, SMALLEST};
use super::smooth_phase::SmoothPhase;
use numerics::Interval;

impl SmoothPhase<'_, '_> {
    /// Whether the monitors (event functions) of closed contacts are proven to stay positive over the step; if not,
    /// also a time at which one of them is violated, if one was found.
    pub(super) fn forces_within(&mut self, begin: f64, end: f64) -> (bool, Option<f64>) {
        if !self.mode.iter().any(|status| status.is_closed()) {
            return (true, None);
        }
        let levels = self.levels(begin);
        // No violation is looked for in parts of the step shorter than `smallest`: it would belong to the event that
        // ends the step, or lie below the resolution of time.
        let smallest = (SMALLEST * (end - begin)).max(ROUNDING_OF_TIME * end.abs());
        let mut parts = vec![(begin, end)];
        let mut enclosed = 0;
        while let Some((a, b)) = parts.pop() {
            enclosed += 1;
            if b - a <= smallest || self.are_forces_proven(a, b, &levels) {
                continue;
            }
            let middle = 0.5 * (a + b);
            if self.is_mode_violated(middle, &levels) {
                return (false, Some(middle));
            }
            if enclosed + parts.len() >= MOST_PARTS {
                return (false, None);
            }
            parts.extend([(middle, b), (a, middle)]);
        }
        (true, None)
    }

    /// Returns the lowest admissible value of each monitor (event function) of the contact mode: zero, or the monitor's
    /// value at the beginning of the step if that is negative, less a multiple of the monitor's noise.
    fn levels(&mut self, begin: f64) -> Vec<f64> {
        let mut monitors = Vec::new();
        self.monitors_at(begin, &mut monitors);
        monitors.iter().map(|monitor| monitor.value.min(0.0) - NOISE * monitor.noise).collect()
    }

    /// Whether a monitor of a closed contact is below its lowest admissible value at the time `t`.
    fn is_mode_violated(&mut self, t: f64, levels: &[f64]) -> bool {
        let mut monitors = Vec::new();
        self.monitors_at(t, &mut monitors);
        let closed = monitors.iter().zip(levels).filter(|(monitor, _)| !matches!(monitor.ending, Ending::Impact(_)));
        closed.into_iter().any(|(monitor, level)| monitor.value < *level)
    }

    /// Whether every monitor of a closed contact provably stays above its lowest admissible value between the times
    /// `a` and `b`.
    fn are_forces_proven(&mut self, a: f64, b: f64, levels: &[f64]) -> bool {
        let slips = self.mode.iter().any(|status| matches!(status, Status::Slip(_)));
        let [mut first, mut middle, mut last] = [const { Vec::new() }; 3];
        // Slip monitors need values at the ends of the interval; the other monitors have their sign decided by
        // enclosures alone.
        if slips {
            self.monitors_at(a, &mut first);
            self.monitors_at(b, &mut last);
        }
        // Evaluate the middle last: enclosures are taken about the point of the last evaluation.
        self.monitors_at(0.5 * (a + b), &mut middle);
        let x = self.ranges(a, b);
        let mut m = vec![0.0; x.len()];
        self.at(0.5 * (a + b), &mut m);
        let Some(forces) = self.watch.enclose(Interval::new(a, b), &x, &m) else { return false };
        let times = Interval::new(a, b);
        let sticks = |k: usize| self.mode[k] == Status::Stick;
        let mu: Vec<Interval> = (0..self.mode.len())
            .map(|k| match sticks(k) {
                true => self.watch.problem().enclose_friction(k, times, &x, Interval::point(0.0)),
                false => Interval::point(self.located.structure.contacts[k].mu),
            })
            .collect();
        let structure = &self.located.structure;
        let v = &x[structure.coordinates..];
        let lowest = |index: usize| match (middle[index].ending, middle[index].value) {
            (Ending::Impact(_), _) | (_, f64::INFINITY) => f64::INFINITY,
            (Ending::Detachment(k), _) => forces.lambda[structure.normal(k)].least(),
            (Ending::StickToSlip(k, _), _) => {
                let squares = structure.tangents(k).map(|row| forces.lambda[row].square());
                let friction = squares.fold(Interval::point(0.0), |sum, square| sum + square).sqrt();
                if !mu[k].defined {
                    return f64::NEG_INFINITY;
                }
                (mu[k] * forces.lambda[structure.normal(k)] - friction).least()
            }
            (Ending::SlipToStick(k), value) => {
                let Status::Slip(d) = self.mode[k] else { return f64::NEG_INFINITY };
                let rate = forces.slip_rate(self.watch, k, d);
                let along = lowest([first[index].value, value, last[index].value], rate, b - a);
                along.max(forces.slip(self.watch, k, v, d).least())
            }
        };
        (0..middle.len()).all(|index| lowest(index) >= levels[index])
    }
}
