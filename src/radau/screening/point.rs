//! A point of a step at which monitors (event functions) are evaluated.

use super::on_face::Told;
use super::part::Part;
use super::watched::Watched;
use crate::system::System;

/// A point of a step: the values of the unknowns, of the rows of the problem, of `G_t` and of the bounds.
#[derive(Clone, Debug, Default)]
pub(super) struct Point {
    pub y: Vec<f64>,
    pub values: Vec<f64>,
    /// Partial derivatives `G_t` with respect to time; empty if equations determine all free variables, since `G_t`
    /// is not needed then.
    pub drift: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    /// Whether all rows of the problem are finite at the point.
    pub is_finite: bool,
}

impl Point {
    /// Evaluates the point at the position `u` in `[0, 1]` within a part of a step that begins at time `t` and takes
    /// the time `h`.
    pub fn set(&mut self, system: &mut System<'_>, told: Told, part: &Part, (t, h): (f64, f64), u: f64) {
        let t = t + u * h;
        self.y.resize(system.unknowns, 0.0);
        part.values(u, &mut self.y);
        self.is_finite = system.evaluate(t, &self.y);
        self.values.clone_from(&system.values);
        self.lower.clone_from(&system.set.lower);
        self.upper.clone_from(&system.set.upper);
        self.drift.clear();
        if told != Told::ByEquations {
            self.drift.resize(system.unknowns - system.states, 0.0);
            system.time_derivative(t, &self.y, &mut self.drift);
        }
    }

    /// Returns the value of a monitor (event function) at the point.
    pub fn value(&self, system: &System<'_>, monitor: &Watched) -> f64 {
        let (row, k) = (system.states + monitor.variable, monitor.variable);
        monitor.of(self.values[row], self.y[row], self.lower[k], self.upper[k])
    }
}
