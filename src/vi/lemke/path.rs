//! The path of complementary pivoting: from a start where `theta d` moves all basic variables into their intervals,
//! to `theta = 0`.

use super::ratio::{Block, Motion, NOISE, first_block};
use super::{Ending, Face, Lemke, PIVOTS, PIVOTS_PER_VARIABLE, start};
use crate::{AffineVi, is_interrupted};
use problem::Control;

impl Lemke {
    /// Builds the tableau whose basis belongs to the guessed active set, and follows the path of complementary pivoting
    /// from that basis.
    pub(super) fn pivot_to_end(&mut self, vi: &AffineVi<'_>, control: &Control) -> Ending {
        self.load(vi);
        if !self.free_rows.is_empty() {
            let (rows, columns) = (&mut self.free_rows, &mut self.free_columns);
            if !start::enter_free(&mut self.tableau, &self.resting, rows, columns) {
                return Ending::Singular;
            }
        }
        if !self.inside.is_empty() {
            start::enter_inside(&mut self.tableau, &self.resting, &mut self.inside);
        }
        for row in 0..self.tableau.m {
            (self.tableau.lower[row], self.tableau.upper[row]) = self.interval(self.tableau.basic[row]);
        }
        if self.cover() { self.follow(control) } else { Ending::Complementary }
    }

    /// Writes the equilibrated problem into the tableau, with all components of `z` nonbasic.
    fn load(&mut self, vi: &AffineVi<'_>) {
        let m = self.tableau.m;
        let (row, column) = (&self.equilibration.row, &self.equilibration.column);
        self.tableau.reset();
        self.free_rows.clear();
        for (i, (&q, &r)) in vi.q.iter().zip(row).enumerate() {
            self.tableau.value[i] = q * r;
            self.tableau.magnitude[i] = (q * r).abs();
        }
        for (j, &c) in column.iter().enumerate() {
            let source = &vi.matrix.as_slice()[j * m..][..m];
            for ((t, &a), &r) in self.tableau.column_mut(j).iter_mut().zip(source).zip(row) {
                *t = a * r * c;
            }
            let (lower, upper) = (self.lower[j], self.upper[j]);
            let to_upper = lower == f64::NEG_INFINITY || (self.face[j] == Face::Upper && upper < f64::INFINITY);
            self.resting[j] = if to_upper { upper } else { lower };
            if to_upper && upper == f64::INFINITY {
                self.resting[j] = 0.0;
                self.free_rows.push(j);
            } else if self.resting[j] != 0.0 {
                self.tableau.advance(j, self.resting[j]);
            }
        }
        self.free_columns.clone_from(&self.free_rows);
    }

    /// Returns the interval of a basic variable. It is unbounded for variables that never block the path: `w` of a
    /// point interval, and `w` of a free variable, which is basic only if its equation is redundant.
    fn interval(&self, variable: usize) -> (f64, f64) {
        let m = self.tableau.m;
        if variable < m {
            return (self.lower[variable], self.upper[variable]);
        }
        let i = variable - m;
        if self.is_free(i) || self.lower[i] == self.upper[i] {
            (f64::NEG_INFINITY, f64::INFINITY)
        } else if self.resting[i] == self.upper[i] {
            (f64::NEG_INFINITY, 0.0)
        } else {
            (0.0, f64::INFINITY)
        }
    }

    /// Chooses the covering vector `d`, of size one and directed into the intervals, and `theta` such that all basic
    /// variables lie inside: a variable between two bounds moves no further than the middle. The last variable to
    /// reach its interval leaves the basis for `theta`. Returns false if all are inside for `theta = 0`.
    fn cover(&mut self) -> bool {
        let m = self.tableau.m;
        let mut theta = 0.0;
        let mut last = None;
        for row in 0..m {
            let value = self.tableau.value[row];
            let (lower, upper) = (self.tableau.lower[row], self.tableau.upper[row]);
            let outside = (lower - value).max(value - upper);
            self.perturbation.variable[row] = self.tableau.basic[row];
            let from_below = lower > f64::NEG_INFINITY && (upper == f64::INFINITY || value - lower < upper - value);
            self.perturbation.sense[row] = if from_below { 1.0 } else { -1.0 };
            // Among rows at the same distance from their intervals, choose the last: its perturbation is the
            // smallest, so that it reaches its interval last.
            if outside >= theta && outside > NOISE * self.tableau.magnitude[row] {
                (theta, last) = (outside, Some(row));
            }
        }
        let Some(last) = last else { return false };
        for row in 0..m {
            let (lower, upper) = (self.tableau.lower[row], self.tableau.upper[row]);
            let value = self.tableau.value[row];
            let sense = self.perturbation.sense[row];
            let d = if lower == f64::NEG_INFINITY && upper == f64::INFINITY {
                0.0
            } else if upper - lower == f64::INFINITY {
                sense
            } else if value < lower || value > upper {
                sense * ((0.5 * (lower + upper) - value).abs() / theta).min(1.0)
            } else {
                0.0
            };
            self.tableau.column_mut(m)[row] = d;
        }
        self.tableau.advance(m, theta);
        self.enter(last, m, theta, (0.0, f64::INFINITY));
        true
    }

    /// Exchanges the basic variable of row `r` with the nonbasic variable of column `c`, which has `value` in
    /// `interval`; the leaving variable rests at the bound that it has reached.
    fn enter(&mut self, r: usize, c: usize, value: f64, interval: (f64, f64)) {
        let m = self.tableau.m;
        let leaving = self.tableau.basic[r];
        if leaving < m {
            let (lower, upper, at) = (self.lower[leaving], self.upper[leaving], self.tableau.value[r]);
            self.resting[leaving] = if (at - lower).abs() <= (upper - at).abs() { lower } else { upper };
        }
        self.tableau.exchange(r, c, m + 1);
        self.tableau.value[r] = value;
        self.tableau.magnitude[r] = value.abs();
        (self.tableau.lower[r], self.tableau.upper[r]) = interval;
        self.pivots += 1;
    }

    /// Follows the path after `theta` has become basic in place of the variable of column `m`, whose complement is
    /// the next to enter the basis.
    fn follow(&mut self, control: &Control) -> Ending {
        let m = self.tableau.m;
        let theta = 2 * m;
        let mut left = self.tableau.nonbasic[m];
        let limit = self.pivots.saturating_add(bases(m)).min(PIVOTS + PIVOTS_PER_VARIABLE * m);
        while self.pivots < limit {
            if is_interrupted(control, self.pivots) {
                return Ending::Interrupted;
            }
            let entering = self.tableau.complement(left);
            let Some(column) = self.tableau.column_of(entering) else { return Ending::Singular };
            let i = if entering < m { entering } else { left };
            let at_upper = self.resting[i] == self.upper[i];
            let sense = if at_upper { -1.0 } else { 1.0 };
            let range = if entering < m { self.upper[i] - self.lower[i] } else { f64::INFINITY };
            let motion = Motion { column, sense, range };
            let (block, length) = first_block(&self.tableau, motion, &self.perturbation);
            match block {
                Block::None => return Ending::Ray,
                Block::Own => {
                    self.tableau.advance(column, sense * length);
                    self.resting[i] = if at_upper { self.lower[i] } else { self.upper[i] };
                    self.pivots += 1;
                    left = entering;
                }
                Block::Row(row) => {
                    self.tableau.advance(column, sense * length);
                    let from = if entering < m { self.resting[i] } else { 0.0 };
                    let interval = self.interval(entering);
                    left = self.tableau.basic[row];
                    self.enter(row, column, from + sense * length, interval);
                    if left == theta {
                        return Ending::Complementary;
                    }
                }
            }
        }
        Ending::Limit
    }
}

/// Returns twice the largest number of bases of a path over `m` intervals: each variable is at its lower bound,
/// inside, or at its upper bound, and at most one of them has both `w` and its distance from a bound nonbasic. A
/// longer path has visited a basis twice: rounding has made it cycle.
fn bases(m: usize) -> usize {
    let exponent = u32::try_from(m).unwrap_or(u32::MAX);
    3_usize.saturating_pow(exponent).saturating_mul(2 * (m + 1))
}
