//! Monitors that are violated between the stages of a step, though at none of them: a trajectory that passes a bound
//! and comes back within one step would leave its two switches unseen.
//!
//! The values of a monitor at the beginning and at the stages give a polynomial of degree `s`; where its least value
//! between them is negative the monitor itself decides.

use super::face::Monitor;
use super::stepper::Radau;

impl Radau<'_> {
    /// Where a monitor is violated within the step at hand, of size `h`, though at no stage; as a fraction of the step.
    pub(super) fn dip(&mut self, h: f64) -> Option<f64> {
        if !self.switching.locates() {
            return None;
        }
        let mut start = Vec::new();
        self.monitors_at(0.0, h, &mut start);
        let dips = start.iter().enumerate().filter_map(|(index, monitor)| self.dip_of(index, start.len(), monitor));
        let theta = dips.min_by(f64::total_cmp)?;
        self.monitors_at(theta, h, &mut start);
        start.iter().any(Monitor::is_violated).then_some(theta)
    }

    /// Where the polynomial through the values of one monitor is least between the stages, if it is negative there.
    fn dip_of(&self, index: usize, count: usize, start: &Monitor) -> Option<f64> {
        let tableau = self.tableau();
        let at_stage = |i: usize| self.stages.monitors[i * count + index].value;
        let (mut least, mut most) = (start.value, start.value);
        for i in 0..tableau.stages() {
            least = least.min(at_stage(i));
            most = most.max(at_stage(i));
        }
        // Far from its bound: the polynomial does not fall much further than the values on it differ.
        if least >= 2.0 * (most - least) {
            return None;
        }
        let mut basis = [0.0; 16];
        let basis = &mut basis[..tableau.stages()];
        let mut value = |theta: f64| {
            tableau.increments_at(theta, basis);
            start.value + basis.iter().enumerate().map(|(i, l)| l * (at_stage(i) - start.value)).sum::<f64>()
        };
        let mut points = vec![(0.0, start.value)];
        for &node in &tableau.c {
            let middle = 0.5 * (points[points.len() - 1].0 + node);
            points.extend([(middle, value(middle)), (node, value(node))]);
        }
        points.windows(3).find_map(|window| {
            let [(a, fa), (b, fb), (c, fc)] = window else { return None };
            if fb > fa || fb > fc {
                return None;
            }
            // The vertex of the parabola through the three.
            let (left, right) = ((fb - fa) / (b - a), (fc - fb) / (c - b));
            let theta = 0.5 * (a + b) - 0.5 * left * (c - a) / (right - left);
            (theta > *a && theta < *c && value(theta) < -start.noise).then_some(theta)
        })
    }
}
