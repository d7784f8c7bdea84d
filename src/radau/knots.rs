//! Steps across knots: values of the unknowns at which a derivative of the rates jumps, as between the pieces of a table. No
//! method has a higher order there than the rates are smooth, and where an estimate presumes one, it sees little of the error;
//! such steps are made with the fewest stages.

use super::screening::part::Part;
use super::stepper::Radau;
use numerics::Interval;

/// The size of the first of these steps, as a part of that with more stages.
const ACROSS: f64 = 0.5;

impl Radau<'_> {
    /// Takes the fewest stages if the step of size `h` with more of them may pass a knot; returns the size of the step in its place.
    pub(super) fn step_across_knots(&mut self, h: f64) -> Option<f64> {
        let tableau = self.tableau();
        if !self.system.has_knots || tableau.stages() == self.orders.fewest_stages() {
            return None;
        }
        let mut step = Part::default();
        step.set_whole(tableau, &self.y, &self.stages.z[..tableau.stages() * self.system.unknowns]);
        let mut ranges = vec![Interval::LINE; self.system.unknowns];
        step.ranges(&mut ranges);
        let times = Interval::new(self.clock.t, self.clock.t + h);
        let passes = self.system.problem().may_pass_knot(times, &ranges);
        if passes && self.orders.take_fewest() {
            self.forget_order();
        }
        passes.then_some(ACROSS * h)
    }
}
