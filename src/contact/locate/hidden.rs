//! What a gap does between the points at which a step has been looked at.
//!
//! Where a body rests, or goes on at one speed, the error of a step is zero whatever its length; a floor that rises for a
//! moment, or a bump that is narrow beside the way of the step, is then between all its points. So gaps and joints are
//! enclosed over the whole step, in interval arithmetic over the time and the coordinates of its parts, the parts halved
//! where the enclosure leaves a violation open. A violation that is found cuts the step.

use super::leg::Leg;
use numerics::Interval;

/// Parts of one step that are enclosed; what is undecided then is no violation that was found.
const MOST_PARTS: usize = 64;

/// The part by which the box of a part is wider than what coordinates are at its ends and in its middle.
const WIDER: f64 = 0.25;

/// Halvings of the time at which a violation begins.
const HALVINGS: usize = 24;

/// The part of the way to a violation that the next step takes.
const NEXT: f64 = 0.25;

/// The part of the tolerance at which a violation begins: what comes before it is smooth to the end of the step.
const FAINT: f64 = 1e-3;

/// A violation between the points of a step.
pub(super) struct Hidden {
    /// Up to when the step may go.
    pub until: f64,
    /// The step to go on with.
    pub next: f64,
}

impl Leg<'_, '_> {
    /// A violation of a joint or a gap within the last step, beyond the tolerances of its coordinates.
    pub(super) fn hidden(&mut self, begin: f64, end: f64) -> Option<Hidden> {
        let structure = &self.located.structure;
        if structure.affine_constraints || structure.joints + structure.contacts.len() == 0 {
            return None;
        }
        let tolerances = self.tolerances_of_rows(begin, 1.0);
        let mut parts = vec![(begin, end)];
        let mut enclosed = 0;
        while let Some((a, b)) = parts.pop() {
            enclosed += 1;
            if self.is_clear(a, b, &tolerances) {
                continue;
            }
            let middle = 0.5 * (a + b);
            if let Some(row) = self.violated(middle, &tolerances) {
                let faint = self.tolerances_of_rows(begin, FAINT);
                return self
                    .beginning(begin, middle, row, &faint)
                    .or_else(|| self.beginning(begin, middle, row, &tolerances));
            }
            if enclosed + parts.len() < MOST_PARTS && a < middle && middle < b {
                // The widest first: those of one size are looked at in the order of time.
                parts.insert(0, (middle, b));
                parts.insert(0, (a, middle));
                parts.sort_by(|x, y| (x.1 - x.0).total_cmp(&(y.1 - y.0)));
            }
        }
        None
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
        let held = |row: usize, value: f64| value.abs().min(self.located.step.closed(row));
        rows.map(|(row, value)| held(row, *value) + part * constraints.size(row, &tolerances)).collect()
    }

    /// Whether no joint or gap can be off between two times.
    fn is_clear(&mut self, a: f64, b: f64, tolerances: &[f64]) -> bool {
        let n = self.located.structure.coordinates;
        let mut ends = [vec![0.0; 2 * n], vec![0.0; 2 * n], vec![0.0; 2 * n]];
        for (x, t) in ends.iter_mut().zip([a, 0.5 * (a + b), b]) {
            self.at(t, x);
        }
        let boxed = |i: usize| {
            let [a, m, b] = [ends[0][i], ends[1][i], ends[2][i]];
            let (lo, hi) = (a.min(m).min(b), a.max(m).max(b));
            Interval::new(lo - WIDER * (hi - lo), hi + WIDER * (hi - lo))
        };
        let q: Vec<Interval> = (0..n).map(boxed).collect();
        let mut values = vec![Interval::EMPTY; tolerances.len()];
        self.watch.problem().enclose_positions(Interval::new(a, b), &q, &mut values);
        values
            .iter()
            .zip(tolerances)
            .enumerate()
            .all(|(row, (value, tolerance))| value.lo >= -tolerance && (!self.is_held(row) || value.hi <= *tolerance))
    }

    /// A joint or a gap that is off at a time.
    fn violated(&mut self, t: f64, tolerances: &[f64]) -> Option<usize> {
        let n = self.located.structure.coordinates;
        let (mut x, mut values) = (vec![0.0; 2 * n], vec![0.0; tolerances.len()]);
        self.at(t, &mut x);
        self.watch.problem().positions(t, &x[..n], &mut values);
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
