//! Gaps and joints between the points at which a step has been evaluated.
//!
//! Where a body rests, or moves at constant speed, the error estimate of a step is zero whatever its length. A floor that rises
//! for a moment, or a bump that is narrow beside the length of the path, may then lie between all points of the step. So gaps and
//! joints are enclosed over the whole step, in interval arithmetic over the time and the ranges of the collocation polynomials,
//! and the parts are halved where the enclosure leaves a violation open. A violation that is found cuts the step. Where a plain
//! enclosure is too wide, an open gap has the lower bound
//!
//! ```text
//! gap(middle) - |gap'| length/2
//! ```
//!
//! or its value at one end where `gap'`, enclosed as well, has one sign. Closed contacts are screened by their
//! [forces](super::closed).

use super::smooth_phase::SmoothPhase;
use numerics::Interval;

/// Parts of one step that are enclosed for what is held: it is held by the equations, and seldom proven to be.
const MOST_HELD: usize = 64;

/// Parts of one step that are enclosed; what is undecided then is no violation that was found.
pub(super) const MOST_PARTS: usize = 200;

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

impl SmoothPhase<'_, '_> {
    /// Whether a joint or a gap is violated within the last step, beyond the tolerances of its coordinates.
    pub(super) fn hidden(&mut self, begin: f64, end: f64) -> Enclosed {
        let structure = &self.located.structure;
        if structure.joints + structure.contacts.len() == 0 {
            return Enclosed::Proven;
        }
        let tolerances = self.tolerances_of_rows(begin, 1.0);
        let (mut is_proven, violated) = self.forces_within(begin, end);
        if let Some(t) = violated {
            return Enclosed::Violated(Hidden { until: t, next: NEXT * (t - begin) });
        }
        let mut parts = vec![(begin, end)];
        let mut enclosed = 0;
        while let Some((a, b)) = parts.pop() {
            enclosed += 1;
            let (open, held) = self.undecided(a, b, &tolerances);
            if !open && !held {
                continue;
            }
            let middle = 0.5 * (a + b);
            if let Some(row) = self.violated(middle, &tolerances) {
                let faint = self.tolerances_of_rows(begin, FAINT);
                let found = self
                    .beginning(begin, middle, row, &faint)
                    .or_else(|| self.beginning(begin, middle, row, &tolerances));
                return found.map_or(Enclosed::Missed, Enclosed::Violated);
            }
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

    /// Whether a joint or a gap is held at zero.
    fn is_held(&self, row: usize) -> bool {
        row.checked_sub(self.located.structure.joints).is_none_or(|k| self.mode[k].is_closed())
    }

    /// By how much joints and gaps may be off: what the step began with, and a part of the tolerances of its coordinates.
    fn tolerances_of_rows(&mut self, begin: f64, part: f64) -> Vec<f64> {
        let n = self.located.structure.coordinates;
        let mut x = vec![0.0; 2 * n];
        self.at(begin, &mut x);
        self.watch.evaluate_at(begin, &x);
        let (constraints, tolerances) = (self.watch.constraints(), self.located.radau.tolerances(0, &x[..n]));
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
        let is_open =
            |&row: &usize| lowest([at_begin[row], at_middle[row], at_end[row]], rates[row], b - a) >= -tolerances[row];
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

/// A lower bound of a quantity over a length of time, from its values at the beginning, in the middle and at the end and an
/// enclosure of its rate.
pub(super) fn lowest([begin, middle, end]: [f64; 3], rate: Interval, length: f64) -> f64 {
    match () {
        () if !rate.defined => f64::NEG_INFINITY,
        () if rate.lo >= 0.0 => begin,
        () if rate.hi <= 0.0 => end,
        () => middle - 0.5 * length * rate.size(),
    }
}
