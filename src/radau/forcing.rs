//! What depends on time explicitly, within a step whose stages do not show it: a pulse between all of them, or a ripple of which
//! each happens to be at the same phase. No error estimate sees that.
//!
//! So rates, and the equations of variables inside, are enclosed over the times of the step, with the unknowns as they are in
//! its middle, and a part of it is halved where the enclosure is much wider than what is seen at its ends and in its middle,
//! or that is not nearly straight. In the parts that are left the rows are compared with the polynomial through their values
//! at the stages: where it is off by more than a part of what they show, and by so much that the step misses a tolerance, the
//! step is made again, shorter.

use super::stepper::Radau;
use super::tableau::MOST_STAGES;
use numerics::Interval;

/// The factor by which an enclosure may be wider than the range of what is seen: it is for sums and products of terms that
/// vary together.
const WIDER: f64 = 4.0;

/// The part of this range by which what is in the middle may differ from the mean of the ends.
const BENT: f64 = 0.3;

/// The part of their range at the stages by which rows may be off the polynomial through their values there: within it the
/// stages show the shape, and the error estimate its error.
const SHOWN: f64 = 0.1;

/// The phase that passes within a step whose stages show it: half a turn, over which even three are within 8 parts in 100 of
/// a sine: `0.018 phase^4/4!`, with the largest product of the distances to their nodes and to the beginning.
const SHOWN_PHASE: f64 = std::f64::consts::PI;

/// Parts of one step; a part that is left undecided then is off by all that its enclosure leaves open.
const MOST_PARTS: usize = 400;

/// One row of the rows that are compared.
#[derive(Clone, Copy, Debug)]
struct Row {
    at: usize,
    /// What its mean over the step may be off by.
    allowed: f64,
}

/// A part of the step, and the rows at its ends and in its middle.
type Part = ([f64; 3], [Vec<f64>; 3]);

impl Radau<'_> {
    /// How far the states would be off for what the stages of the step of size `h` do not show of the rows, in units of their
    /// tolerances; zero where rows do not depend on time, or cannot be enclosed.
    pub(super) fn missed_forcing(&mut self, h: f64) -> f64 {
        if self.system.pace * h <= SHOWN_PHASE {
            return 0.0;
        }
        let rows = self.rows_in_time(h);
        let mut y = vec![0.0; self.system.unknowns];
        self.polynomial_at(0.5);
        y.copy_from_slice(&self.switching.scratch);
        let still: Vec<Interval> = y.iter().map(|y| Interval::point(*y)).collect();
        let mut ranges = vec![Interval::LINE; self.system.values.len()];
        let rounding = self.rounding_of_time(h);
        if h <= 4.0 * rounding {
            return 0.0;
        }
        // Not what is at the ends themselves, where there may be a break.
        let whole = Interval::new(self.t + rounding, self.t + h - rounding);
        if !self.system.problem().enclose(whole, &still, &mut ranges) {
            return 0.0;
        }
        let is_narrow = |row: &Row| ranges[row.at].defined && ranges[row.at].hi - ranges[row.at].lo <= row.allowed;
        if rows.iter().all(is_narrow) {
            return 0.0;
        }
        let evaluations = self.system.work.rates;
        let mut means = self.missed_in_parts(h, &rows, &y, &still);
        // Evidence is no part of the method.
        self.system.work.rates = evaluations;
        if means.iter().all(|mean| *mean == 0.0) {
            return 0.0;
        }
        let n = self.system.states;
        match self.tableau().gamma {
            Some(gamma) if self.factors.solve_real(&mut means) => {
                means.iter_mut().for_each(|mean| *mean *= gamma);
                // Filtered once more: what stiff states forget before the step ends counts no longer.
                let mut forced = vec![0.0; means.len()];
                self.system.multiply_by_mass(&means, &mut forced);
                forced.iter_mut().for_each(|forced| *forced *= gamma / h);
                if self.factors.solve_real(&mut forced) {
                    means = forced;
                }
            }
            _ => means.iter_mut().for_each(|mean| *mean *= h),
        }
        (0..n).map(|j| means[j].abs() / self.uncertainty(j).max(f64::MIN_POSITIVE)).fold(0.0, f64::max)
    }

    /// The rows whose course in time matters, with what their means may be off by over a step of size `h`.
    fn rows_in_time(&self, h: f64) -> Vec<Row> {
        let n = self.system.states;
        let rates = (0..n).map(|at| {
            let tolerance = self.settings.atol[at] + self.settings.rtol * self.largest[at].max(self.y[at].abs());
            let mass = if self.system.mass_diagonal[at] != 0.0 { self.system.mass_diagonal[at].abs() } else { 1.0 };
            Row { at, allowed: mass * tolerance / h }
        });
        let inside =
            (0..self.system.unknowns - n).filter(|&k| self.system.face.places[k] == super::face::Place::Inside);
        rates.chain(inside.map(|k| Row { at: n + k, allowed: self.uncertainties(k, h)[1] })).collect()
    }

    fn rows_at(&mut self, t: f64, y: &[f64]) -> Vec<f64> {
        self.system.evaluate(t, y);
        self.system.values.clone()
    }

    /// The means over the step of what rows are beside the polynomial through their values at the stages.
    fn missed_in_parts(&mut self, h: f64, rows: &[Row], y: &[f64], still: &[Interval]) -> Vec<f64> {
        let (t, tableau) = (self.t, self.tableau());
        let end = self.rounding_of_time(h) / h;
        let nodes: Vec<f64> = std::iter::once(end).chain(tableau.c.iter().map(|c| c.min(1.0 - end))).collect();
        let at_nodes: Vec<Vec<f64>> = nodes.iter().map(|node| self.rows_at(t + node * h, y)).collect();
        let seen = |at: usize| {
            let values = at_nodes.iter().map(|values| values[at]);
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), value| (lo.min(value), hi.max(value)))
        };
        let shown: Vec<f64> = rows.iter().map(|row| SHOWN * (seen(row.at).1 - seen(row.at).0)).collect();
        let mut weights = [0.0; MOST_STAGES];
        let mut polynomial = |theta: f64, at: usize| {
            tableau.increments_at(theta, &mut weights[..tableau.stages()]);
            let begin = at_nodes[0][at];
            let changes = at_nodes[1..].iter().zip(&weights).map(|(values, weight)| weight * (values[at] - begin));
            begin + changes.sum::<f64>()
        };
        let mut missed = vec![0.0; self.system.unknowns];
        let mut ranges = vec![Interval::LINE; self.system.values.len()];
        let thetas = [end, 0.5, 1.0 - end];
        let first: Part = (thetas, thetas.map(|theta| self.rows_at(t + theta * h, y)));
        let (mut parts, mut enclosed) = (vec![first], 0);
        while let Some((thetas, values)) = parts.pop() {
            enclosed += 1;
            let [a, middle, b] = thetas;
            let times = Interval::new(t + a * h, (t + b * h).max((t + a * h).next_up()));
            self.system.problem().enclose(times, still, &mut ranges);
            let shows = |row: &Row| {
                let [first, middle, last] = [0, 1, 2].map(|i| values[i][row.at]);
                let range = first.max(middle).max(last) - first.min(middle).min(last);
                let width = ranges[row.at].hi - ranges[row.at].lo;
                let bent = (middle - 0.5 * (first + last)).abs();
                ranges[row.at].defined
                    && (width * (b - a) <= row.allowed
                        || width <= WIDER * range + row.allowed && bent <= BENT * range + row.allowed)
            };
            if rows.iter().all(shows) {
                for (row, shown) in rows.iter().zip(&shown) {
                    let off = values[1][row.at] - polynomial(middle, row.at);
                    missed[row.at] += if off.abs() > *shown { (b - a) * off } else { 0.0 };
                }
            } else if enclosed + parts.len() < MOST_PARTS && (b - a) * h > self.rounding_of_time(h) {
                let [quarter, later] = [0.5 * (a + middle), 0.5 * (middle + b)];
                let [at_a, at_middle, at_b] = values;
                let (at_quarter, at_later) = (self.rows_at(t + quarter * h, y), self.rows_at(t + later * h, y));
                parts.push(([middle, later, b], [at_middle.clone(), at_later, at_b]));
                parts.push(([a, quarter, middle], [at_a, at_quarter, at_middle]));
            } else {
                for row in rows {
                    let width = ranges[row.at].hi - ranges[row.at].lo;
                    missed[row.at] += if ranges[row.at].defined { (b - a) * width } else { 0.0 };
                }
            }
        }
        missed
    }
}
