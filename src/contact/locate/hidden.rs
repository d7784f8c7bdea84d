//! Hidden violations: violations of gaps and joints between the points at which a step was evaluated.
//!
//! If a body rests, or moves at constant speed, the error estimate of a step is zero whatever its length. A floor
//! that rises briefly, or a bump that is narrow compared with the path, may then lie between all points of the step.
//! Gaps and joints are therefore enclosed over the whole step, in interval arithmetic over the time and the ranges of
//! the collocation polynomials, and undecided parts are halved. A violation cuts the step. Where a plain enclosure is
//! too wide, an open gap has the lower bound
//!
//! ```text
//! gap(middle) - |gap'| length/2
//! ```
//!
//! or its value at one end where `gap'`, enclosed as well, has one sign. Closed contacts are screened by their
//! [forces](super::closed).

use super::smooth_phase::SmoothPhase;
use numerics::Interval;

/// Largest number of parts enclosed to prove that the held constraints stay at zero: the mode equations keep them
/// there, but enclosures seldom prove it.
const MOST_HELD: usize = 64;

/// Largest number of parts of one step; a step with parts on which violations are then neither proven nor excluded is
/// not proven free of violations.
pub(super) const MOST_PARTS: usize = 200;

/// Number of bisections for the time at which a violation of a gap or joint begins.
pub(super) const HALVINGS: usize = 24;

/// First step after the cut of a step, as a fraction of the time from the cut to the violation that was seen.
pub(super) const NEXT: f64 = 0.25;

/// Fraction of the tolerance of a gap or joint beyond which a violation of it counts as begun, for the time of a cut:
/// the motion of the cut step is smooth up to its end.
const FAINT: f64 = 1e-3;

/// The cut of a step with a violation of a gap or joint between its points of evaluation.
#[derive(Clone, Copy)]
pub struct Hidden {
    /// The time at which to cut the step, before the violation.
    pub until: f64,
    /// The size of the next step, after the cut.
    pub next: f64,
}

/// Result of enclosing gaps and joints over a step.
pub(super) enum Enclosed {
    /// It is proven that no open gap closes.
    Proven,
    /// No violation of a gap or joint was found, but none is excluded.
    Undecided,
    /// A violation of a gap or joint was found, and the step is to be cut before it.
    Violated(Hidden),
    /// A violation of a gap or joint was found that has lasted since the beginning of the step.
    Missed,
}

impl SmoothPhase<'_, '_> {
    /// Looks for a violation of a joint or a gap within the last step, beyond the tolerances of the coordinates.
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
                // Take the widest part of the step first, and the earliest among parts of equal width.
                parts.insert(0, (middle, b));
                parts.insert(0, (a, middle));
                parts.sort_by(|x, y| (x.1 - x.0).total_cmp(&(y.1 - y.0)));
            } else {
                is_proven &= !open;
            }
        }
        if is_proven { Enclosed::Proven } else { Enclosed::Undecided }
    }

    /// Whether the equations of the contact mode hold a joint or a gap at zero.
    fn is_held(&self, row: usize) -> bool {
        row.checked_sub(self.located.structure.joints).is_none_or(|k| self.mode[k].is_closed())
    }

    /// Returns the tolerances of joints and gaps: their values at the beginning of the step, plus the fraction `part`
    /// of the tolerances that follow from the coordinates.
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

    /// Whether an open gap may be negative between the times `a` and `b`, and whether a held joint or gap may be
    /// nonzero.
    fn undecided(&mut self, a: f64, b: f64, tolerances: &[f64]) -> (bool, bool) {
        let n = self.located.structure.coordinates;
        let (t, x) = (Interval::new(a, b), self.ranges(a, b));
        let (q, v) = x.split_at(n);
        let mut values = vec![Interval::EMPTY; tolerances.len()];
        self.watch.problem().enclose_positions(t, q, &mut values);
        let off = |row: &usize| values[*row].lo < -tolerances[*row] || !values[*row].defined;
        let (held, open): (Vec<usize>, Vec<usize>) = (0..values.len()).partition(|&row| self.is_held(row));
        // Affine constraints that hold at the ends of the step hold on the whole collocation polynomial.
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

    /// Finds a joint or a gap that is violated at the time `t`.
    fn violated(&mut self, t: f64, tolerances: &[f64]) -> Option<usize> {
        let values = self.positions_at(t, tolerances.len());
        (0..values.len()).find(|&row| {
            let off = if self.is_held(row) { values[row].abs() } else { -values[row] };
            off > tolerances[row]
        })
    }

    /// Returns the cut of a step in which `row` is violated at the time `t`: after the closing of an open gap, which
    /// the search then locates, or before the time at which a held row is lost.
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
        // Accelerations begin before the violation shows: the cut lies as far before the beginning of the violation
        // as the violation was found after it.
        let ahead = (clear - (t - clear)).max(0.5 * (begin + clear));
        let until = if self.is_held(row) { ahead } else { off };
        let next = NEXT * (t - clear);
        (until > begin).then_some(Hidden { until, next })
    }
}

/// Returns a lower bound of a quantity over a time interval, from its values at the beginning, the middle and the end
/// and an enclosure of its rate.
pub(super) fn lowest([begin, middle, end]: [f64; 3], rate: Interval, length: f64) -> f64 {
    match () {
        () if !rate.defined => f64::NEG_INFINITY,
        () if rate.lo >= 0.0 => begin,
        () if rate.hi <= 0.0 => end,
        () => middle - 0.5 * length * rate.size(),
    }
}
