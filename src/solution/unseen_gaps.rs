//! Gaps that close and open again within a step while they are open at both its ends: a wall thinner than the
//! distance covered in a step, or an obstacle that is present for less than a step. Gaps along the straight path of a
//! step are bounded from below by bisection, with interval enclosures of their values and rates.

use super::unseen_data::StraightWay;
use super::{CheckCode, Checks};
use contact::TimeStepping;
use numerics::Interval;
use problem::{Constraints, Mechanical};

/// Largest number of parts into which a step is bisected to prove that gaps stay open.
const MOST_PARTS: usize = 64;

/// Relative rounding error of the gaps of contacts after position corrections.
const ROUNDING: f64 = 1e-9;

/// Counts the steps of a run in which the gap of a contact may close without being noticed.
#[derive(Default)]
pub(super) struct UnseenGaps {
    /// For each contact: the number of steps in which its gap closes or may close unnoticed, the beginning of the first
    /// such step, and whether a negative gap was found in one of them.
    pub closing: Vec<(u32, f64, bool)>,
    ends: [Vec<f64>; 2],
    rows: Option<Constraints>,
}

/// The gaps of all contacts along the straight path of a step through the coordinates.
struct GapsOnWay<'s> {
    problem: &'s mut dyn Mechanical,
    way: StraightWay<'s>,
    rate: Vec<Interval>,
    values: Vec<f64>,
    ranges: [Vec<Interval>; 2],
}

impl GapsOnWay<'_> {
    /// Returns the value of the constraint with the index `row` (such as a gap) on the path of the step at the time
    /// `t`.
    fn at(&mut self, row: usize, t: f64) -> f64 {
        let q: Vec<f64> = (0..self.rate.len()).map(|k| self.way.at(k, t)).collect();
        self.problem.positions(t, &q, &mut self.values);
        self.values[row]
    }

    /// Encloses the values of all constraints (such as gaps) over a part of the step, and also their rates if
    /// `with_rates` is set.
    fn enclose(&mut self, [from, to]: [f64; 2], with_rates: bool) {
        let q: Vec<Interval> = (0..self.rate.len()).map(|k| self.way.within(k, [from, to])).collect();
        let t = Interval::new(from, to);
        self.problem.enclose_positions(t, &q, &mut self.ranges[0]);
        if with_rates {
            self.problem.enclose_velocities(t, &q, &self.rate, &mut self.ranges[1]);
        }
    }

    /// Whether the value of the constraint with the index `row`, at least `least` at both ends of the step, stays at
    /// least `least` throughout; `None` if undecided.
    fn stays(&mut self, row: usize, ends: [f64; 2], least: f64) -> Option<bool> {
        let mut left = vec![(self.way.step, ends)];
        let mut parts = 1;
        let mut is_known = true;
        while let Some(([from, to], [first, last])) = left.pop() {
            self.enclose([from, to], true);
            let range = self.ranges[0][row];
            if range.lo >= least && !range.is_empty() || lowest([first, last], to - from, self.ranges[1][row]) >= least
            {
                continue;
            }
            let middle = 0.5 * (from + to);
            let value = self.at(row, middle);
            if value < least {
                return Some(false);
            }
            if parts >= MOST_PARTS || !(from < middle && middle < to) {
                is_known = false;
                continue;
            }
            parts += 1;
            left.extend([([middle, to], [value, last]), ([from, middle], [first, value])]);
        }
        is_known.then_some(true)
    }
}

/// Returns the least possible value of a function over a time `length`, given its end values and an enclosure `rate`
/// of its rate.
fn lowest([first, last]: [f64; 2], length: f64, rate: Interval) -> f64 {
    let (falls, rises) = (rate.lo.min(0.0), rate.hi.max(0.0));
    if rate.is_empty() || !rate.defined || !(falls.is_finite() && rises.is_finite()) {
        return f64::NEG_INFINITY;
    }
    if falls == 0.0 || rises == 0.0 {
        return first.min(last);
    }
    // The steepest lines from both end values that the enclosure of the rate permits meet at the lowest value.
    let until = (first - last + rises * length) / (rises - falls);
    (first + falls * until.clamp(0.0, length)).min(last - rises * (length - until).clamp(0.0, length))
}

impl UnseenGaps {
    /// Counts the gaps that close, or may close, within the last step of a run while they are open at both its ends.
    pub fn step(&mut self, stepper: &TimeStepping<'_>, problem: &mut dyn Mechanical) {
        let structure = problem.structure();
        let contacts = structure.contacts.len();
        if contacts == 0 || structure.affine_constraints {
            return;
        }
        let (joints, n) = (structure.joints, structure.coordinates);
        let rows = self.rows.get_or_insert_with(|| Constraints::new(structure));
        self.closing.resize(contacts, (0, 0.0, false));
        let TimeStepping { state, last, step, .. } = stepper;
        let h = state.t - last.t;
        let q = [last.q.as_slice(), state.q.as_slice()];
        for (end, state) in self.ends.iter_mut().zip([last, state]) {
            end.resize(joints + contacts, 0.0);
            problem.positions(state.t, &state.q, end);
        }
        let rate = (0..n).map(|k| Interval::point((q[1][k] - q[0][k]) / h)).collect();
        let values = vec![0.0; joints + contacts];
        let ranges = [vec![Interval::LINE; joints + contacts], vec![Interval::LINE; joints + contacts]];
        let way = StraightWay { step: [last.t, state.t], states: q };
        let mut gaps = GapsOnWay { problem, way, rate, values, ranges };
        gaps.enclose([last.t, state.t], false);
        let is_apart = |range: &Interval| range.lo > 0.0 && !range.is_empty();
        let may_close = |&k: &usize| step.contacted.r[k].x == 0.0 && !is_apart(&gaps.ranges[0][joints + k]);
        let near: Vec<usize> = (0..contacts).filter(may_close).collect();
        if near.is_empty() {
            return;
        }
        gaps.problem.constraints(state.t, &state.q, rows);
        for k in near {
            let row = joints + k;
            let ends = [0, 1].map(|end: usize| self.ends[end][row]);
            let least = -ROUNDING * rows.size(row, &state.q).max(ends[0].abs()).max(ends[1].abs());
            if !(ends[0] >= least && ends[1] >= least) {
                continue;
            }
            let stays = gaps.stays(row, ends, least);
            if stays != Some(true) {
                let (count, first, is_seen) = &mut self.closing[k];
                if *count == 0 {
                    *first = last.t;
                }
                *count += 1;
                *is_seen |= stays == Some(false);
            }
        }
    }

    /// Records the check of the steps in which gaps close unnoticed, or may do so; `names` are the names of the
    /// contacts.
    pub fn judge(&self, names: &[String], checks: &mut Checks) {
        for ((steps, first, is_seen), name) in self.closing.iter().zip(names) {
            checks.record(CheckCode::EventsUnproven, f64::from(*steps), 0.0, || {
                let (closes, why) = match is_seen {
                    true => ("closes and opens again", "the step passes through"),
                    false => ("may close and open again", "the step may pass through"),
                };
                format!(
                    "within {steps} steps, first after t = {first:?}, the gap of `{name}` {closes} while it is open at both ends: \
                     {why} what is narrower than its way or its time; give a smaller `step`"
                )
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lowest_value_is_where_the_steepest_lines_meet() {
        // The lowest admissible function falls from 1 with slope -2 for a third of the time, then rises to 1 with slope
        // 1.
        assert!((lowest([1.0, 1.0], 3.0, Interval::new(-2.0, 1.0)) + 1.0).abs() < 1e-15);
        assert_eq!(lowest([1.0, 3.0], 1.0, Interval::new(0.5, 4.0)), 1.0);
        assert_eq!(lowest([1.0, 1.0], 1.0, Interval::LINE), f64::NEG_INFINITY);
    }
}
