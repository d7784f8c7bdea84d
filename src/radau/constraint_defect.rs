//! Error between the ends of steps in states that constraints determine.
//!
//! If `G_k = 0` holds for a variable inside its interval, but no variable occurs in `G_k`, or if a row is not a rate,
//! the stages satisfy that equation exactly, whatever the step size: the error estimate is zero, and steps grow until
//! the collocation polynomial is meaningless between the stages. The defect at the midpoints between the nodes,
//!
//! ```text
//! |G_k(t, y(t))| / sum_j |dG_k/dy_j| sc_j,
//! ```
//!
//! with the tolerances `sc` of the states, counts as an error of the step if output between the steps of a large sparse
//! system is requested. In other systems the states are brought onto their [constraints](super::constraints).

use super::face::Activity;
use super::layout::Storage;
use super::stepper::Radau;

impl Radau<'_> {
    /// Returns the largest defect of a constraint between the stages of the present step, in units of the tolerances of
    /// the states.
    pub(super) fn constraint_error(&mut self, h: f64) -> f64 {
        if !self.settings.interpolated || matches!(self.system.layout.storage, Storage::Dense) {
            return 0.0;
        }
        let rows: Vec<usize> = (0..self.system.unknowns).filter(|&row| self.is_constraint(row)).collect();
        let mut worst = 0.0_f64;
        if rows.is_empty() {
            return worst;
        }
        for theta in self.tableau().middles() {
            self.polynomial_at(theta);
            self.system.evaluate(self.clock.t + theta * h, &self.switching.scratch);
            for &row in &rows {
                let entries = self.system.entries_of_row(row);
                let allowed: f64 = entries.map(|(j, value)| value.abs() / self.control.weight[j]).sum();
                if allowed > 0.0 {
                    worst = worst.max(self.system.values[row].abs() / allowed);
                }
            }
        }
        worst
    }

    /// Whether `row` is a constraint of the active face: an equation between states alone.
    fn is_constraint(&self, row: usize) -> bool {
        let n = self.system.states;
        let is_equation = match row.checked_sub(n) {
            None => !self.system.layout.is_rate[row],
            Some(k) => self.system.face.places[k] == Activity::Inactive && self.system.set.block_of(k).is_none(),
        };
        is_equation && self.system.entries_of_row(row).all(|(j, value)| j < n || value == 0.0)
    }
}
