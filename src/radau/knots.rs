//! Steps across knots: values of the unknowns at which a derivative of the rates jumps, as between the pieces of a
//! table. Across a knot the order of a method is limited by the smoothness of the rates, and an error estimate that
//! presumes a higher order misses most of the error; such steps are made with the fewest stages.

use super::screening::part::Part;
use super::stepper::Radau;
use numerics::Interval;

/// Size of the first step that uses the fewest stages, relative to the step with more stages that may pass a knot.
const ACROSS: f64 = 0.5;

impl Radau<'_> {
    /// Selects the fewest stages if the step of size `h` with more of them may pass a knot (a value of the unknowns at
    /// which a derivative jumps); returns the size of the step that replaces it.
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
