//! What a gap does between the points at which a step has been looked at.
//!
//! Where a body rests, or goes on at one speed, the error of a step is zero whatever its length; a floor that rises for a
//! moment, or a bump that is narrow beside the way of the step, is then between all its points. So gaps and joints are
//! enclosed over the whole step, in interval arithmetic over the time and the ranges of the polynomials that the step is,
//! the parts halved where the enclosure leaves a violation open. A violation that is found cuts the step. Where a plain
//! enclosure is too wide, an open gap is above
//!
//! ```text
//! gap(middle) - |gap'| length/2
//! ```
//!
//! or its value at one end where `gap'`, enclosed as well, has one sign. Slips are told likewise, and forces of closed contacts
//! by their enclosure (see [`enclosed_forces`](super::enclosed_forces)).

use super::leg::Leg;
use super::mode::Status;
use super::monitors::Ending;
use super::search::{NOISE, ROUNDING_OF_TIME, SMALLEST};
use numerics::Interval;

/// Parts of one step that are enclosed for what is held: it is held by the equations, and seldom proven to be.
const MOST_HELD: usize = 64;

/// Parts of one step that are enclosed; what is undecided then is no violation that was found.
const MOST_PARTS: usize = 200;

/// Halvings of the time at which a violation begins.
pub(super) const HALVINGS: usize = 24;

/// The part of the way to a violation that the next step takes.
pub(super) const NEXT: f64 = 0.25;

/// The part of the tolerance at which a violation begins: what comes before it is smooth to the end of the step.
const FAINT: f64 = 1e-3;

/// A violation between the points of a step.
pub(super) struct Hidden {
    /// Up to when the step may go.
    pub until: f64,
    /// The step to go on with.
    pub next: f64,
}

/// What the enclosure of a step tells.
pub(super) enum Enclosed {
    /// No open gap closes.
    Proven,
    /// No violation was found, and none is excluded.
    Undecided,
    /// There is one.
    Violated(Hidden),
    /// There is one from the beginning of the step on.
    Missed,
}

impl Leg<'_, '_> {
    /// Whether a joint or a gap is violated within the last step, beyond the tolerances of its coordinates.
    pub(super) fn hidden(&mut self, begin: f64, end: f64) -> Enclosed {
        let structure = &self.located.structure;
        if structure.joints + structure.contacts.len() == 0 {
            return Enclosed::Proven;
        }
        let tolerances = self.tolerances_of_rows(begin, 1.0);
        let levels = self.levels(begin);
        // What a force does in a moment before the step ends is the event that ends it, or none that times tell apart.
        let smallest = (SMALLEST * (end - begin)).max(ROUNDING_OF_TIME * end.abs());
        let mut parts = vec![(begin, end)];
        let (mut enclosed, mut is_proven) = (0, true);
        while let Some((a, b)) = parts.pop() {
            enclosed += 1;
            let (open, held) = self.undecided(a, b, &tolerances);
            let loaded = b - a > smallest && !self.are_forces_proven(a, b, &levels);
            if !open && !held && !loaded {
                continue;
            }
            let middle = 0.5 * (a + b);
            if loaded && self.is_mode_violated(middle, &levels) {
                return Enclosed::Violated(Hidden { until: middle, next: NEXT * (middle - begin) });
            }
            if let Some(row) = self.violated(middle, &tolerances) {
                let faint = self.tolerances_of_rows(begin, FAINT);
                let found = self
                    .beginning(begin, middle, row, &faint)
                    .or_else(|| self.beginning(begin, middle, row, &tolerances));
                return found.map_or(Enclosed::Missed, Enclosed::Violated);
            }
            let open = open || loaded;
            let most = if open { MOST_PARTS } else { MOST_HELD };
            if enclosed + parts.len() < most && a < middle && middle < b {
                // The widest first: those of one size are looked at in the order of time.
                parts.insert(0, (middle, b));
                parts.insert(0, (a, middle));
                parts.sort_by(|x, y| (x.1 - x.0).total_cmp(&(y.1 - y.0)));
            } else {
                is_proven &= !open;
            }
        }
        if is_proven { Enclosed::Proven } else { Enclosed::Undecided }
    }

    /// To where the monitors of closed contacts may fall: to their noise, or to where the step begins if that is below.
    fn levels(&mut self, begin: f64) -> Vec<f64> {
        let mut monitors = Vec::new();
        self.monitors_at(begin, &mut monitors);
        monitors.iter().map(|monitor| monitor.value.min(0.0) - NOISE * monitor.noise).collect()
    }

    /// Whether a monitor of a closed contact is violated at a time.
    fn is_mode_violated(&mut self, t: f64, levels: &[f64]) -> bool {
        let mut monitors = Vec::new();
        self.monitors_at(t, &mut monitors);
        let closed = monitors.iter().zip(levels).filter(|(monitor, _)| !matches!(monitor.ending, Ending::Closes(_)));
        closed.into_iter().any(|(monitor, level)| monitor.value < *level)
    }

    /// Whether no monitor of a closed contact falls to its level between two times.
    fn are_forces_proven(&mut self, a: f64, b: f64, levels: &[f64]) -> bool {
        if !self.mode.iter().any(|status| status.is_closed()) {
            return true;
        }
        let [mut first, mut middle, mut last] = [const { Vec::new() }; 3];
        self.monitors_at(a, &mut first);
        self.monitors_at(b, &mut last);
        // Settled there last, about which the equations are enclosed.
        self.monitors_at(0.5 * (a + b), &mut middle);
        let x = self.ranges(a, b);
        let Some(forces) = self.watch.enclose(Interval::new(a, b), &x) else { return false };
        let structure = &self.located.structure;
        let v = &x[structure.coordinates..];
        let lowest = |index: usize| match (middle[index].ending, middle[index].value) {
            (Ending::Closes(_), _) | (_, f64::INFINITY) => f64::INFINITY,
            (Ending::LetsGo(k), _) => least(forces.lambda[structure.normal(k)]),
            (Ending::Breaks(k, _), _) => {
                let squares = structure.tangents(k).map(|row| forces.lambda[row].square());
                let friction = squares.fold(Interval::point(0.0), |sum, square| sum + square).sqrt();
                least(Interval::point(structure.contacts[k].mu) * forces.lambda[structure.normal(k)] - friction)
            }
            (Ending::Stops(k), value) => {
                let Status::Slip(d) = self.mode[k] else { return f64::NEG_INFINITY };
                let rate = forces.slip_rate(self.watch, k, |i| d[i]);
                let along = match () {
                    () if !rate.defined => f64::NEG_INFINITY,
                    () if rate.lo >= 0.0 => first[index].value,
                    () if rate.hi <= 0.0 => last[index].value,
                    () => value - 0.5 * (b - a) * rate.magnitudes().1,
                };
                along.max(least(forces.slip(self.watch, k, v, |i| d[i])))
            }
        };
        (0..middle.len()).all(|index| lowest(index) >= levels[index])
    }

    /// Whether a joint or a gap is held at zero.
    fn is_held(&self, row: usize) -> bool {
        row.checked_sub(self.located.structure.joints).is_none_or(|k| self.mode[k].is_closed())
    }

    /// By how much joints and gaps may be off: what the step began with, and a part of the tolerances of its coordinates.
    fn tolerances_of_rows(&mut self, begin: f64, part: f64) -> Vec<f64> {
        let n = self.located.structure.coordinates;
        let mut x = vec![0.0; 2 * n];
        self.at(begin, &mut x);
        self.watch.settle(begin, &x);
        let (constraints, radau) = (self.watch.constraints(), &self.located.radau);
        let tolerances: Vec<f64> =
            x[..n].iter().zip(&radau.atol).map(|(q, atol)| atol + radau.rtol * q.abs()).collect();
        let rows = constraints.values.iter().enumerate();
        let step = &self.located.step;
        let held = |row: usize, value: f64| value.abs().min(step.closed(row)) + step.rounding_of_row(row);
        rows.map(|(row, value)| held(row, *value) + part * constraints.size(row, &tolerances)).collect()
    }

    /// Whether an open gap may be negative between two times, and whether what is held may be off.
    fn undecided(&mut self, a: f64, b: f64, tolerances: &[f64]) -> (bool, bool) {
        let n = self.located.structure.coordinates;
        let (t, x) = (Interval::new(a, b), self.ranges(a, b));
        let (q, v) = x.split_at(n);
        let mut values = vec![Interval::EMPTY; tolerances.len()];
        self.watch.problem().enclose_positions(t, q, &mut values);
        let off = |row: &usize| values[*row].lo < -tolerances[*row] || !values[*row].defined;
        let (held, open): (Vec<usize>, Vec<usize>) = (0..values.len()).partition(|&row| self.is_held(row));
        // What is affine and held at the ends is held on all of the polynomial.
        let is_affine = self.located.structure.affine_constraints;
        let held = !is_affine && held.iter().any(|row| off(row) || values[*row].hi > tolerances[*row]);
        let open: Vec<usize> = open.into_iter().filter(off).collect();
        if open.is_empty() {
            return (false, held);
        }
        let mut rates = vec![Interval::LINE; tolerances.len()];
        self.watch.problem().enclose_velocities(t, q, v, &mut rates);
        let [at_begin, at_middle, at_end] = [a, 0.5 * (a + b), b].map(|t| self.positions_at(t, tolerances.len()));
        let is_open = |&row: &usize| {
            let rate = rates[row];
            let lowest = match () {
                () if !rate.defined => f64::NEG_INFINITY,
                () if rate.lo >= 0.0 => at_begin[row],
                () if rate.hi <= 0.0 => at_end[row],
                () => at_middle[row] - 0.5 * (b - a) * rate.lo.abs().max(rate.hi.abs()),
            };
            lowest >= -tolerances[row]
        };
        (!open.iter().all(is_open), held)
    }

    fn positions_at(&mut self, t: f64, rows: usize) -> Vec<f64> {
        let n = self.located.structure.coordinates;
        let (mut x, mut values) = (vec![0.0; 2 * n], vec![0.0; rows]);
        self.at(t, &mut x);
        self.watch.problem().positions(t, &x[..n], &mut values);
        values
    }

    /// A joint or a gap that is off at a time.
    fn violated(&mut self, t: f64, tolerances: &[f64]) -> Option<usize> {
        let values = self.positions_at(t, tolerances.len());
        (0..values.len()).find(|&row| {
            let off = if self.is_held(row) { values[row].abs() } else { -values[row] };
            off > tolerances[row]
        })
    }

    /// How far a step may go that has a violation of this row at `t`: past where an open gap closes, which the search then
    /// finds; ahead of where a held one is left.
    fn beginning(&mut self, begin: f64, t: f64, row: usize, tolerances: &[f64]) -> Option<Hidden> {
        let (mut clear, mut off) = (begin, t);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (clear + off);
            if middle <= clear || middle >= off {
                break;
            }
            let side = if self.violated(middle, tolerances).is_some() { &mut off } else { &mut clear };
            *side = middle;
        }
        // Accelerations begin before the gap does: as far ahead of its beginning as it was found behind that.
        let ahead = (clear - (t - clear)).max(0.5 * (begin + clear));
        let until = if self.is_held(row) { ahead } else { off };
        let next = NEXT * (t - clear);
        (until > begin).then_some(Hidden { until, next })
    }
}

/// The lower end of an interval; none where it is not defined all over the box.
fn least(interval: Interval) -> f64 {
    if interval.defined { interval.lo } else { f64::NEG_INFINITY }
}
