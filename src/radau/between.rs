//! The monitors between the stages of a step, at all of which they may be positive though the trajectory passes a bound
//! and comes back within the step: its two switches would stay unseen.
//!
//! The values `g` of a monitor at the beginning and at the stages give a polynomial `p` of degree `s`. Where its least
//! value between them is negative, the monitor itself decides. And `g` is compared with `p` in the middles of the gaps
//! `theta*`, of which each gives the rest of the interpolation over the whole step,
//!
//! ```text
//! g(theta) - p(theta) = (g - p)(theta*) w(theta) / w(theta*),    w(theta) = theta (theta - c_1) .. (theta - c_s)
//! ```
//!
//! if the derivative of order `s + 1` varies little. Variables inside their intervals are there what their equations make
//! of them, not what their polynomials say. The sign of `g` is known while that is less than `p`; what it is in
//! units of `p` counts as an error of the step. The errors of the states may be none: while `z = 0` they can be constant.

use super::face::Monitor;
use super::stepper::Radau;
use super::tableau::MOST_STAGES;

/// The part of its polynomial by which a monitor may differ from it.
const DOUBT: f64 = 0.5;
/// The multiple of its noise by which it may.
const NOISE: f64 = 16.0;

/// What is known of the monitors between the stages of a step.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Between {
    /// Where one is violated though at no stage, as a fraction of the step.
    pub dip: Option<f64>,
    /// How far one is from its polynomial, in units of what it may be.
    pub doubt: f64,
}

/// The most attempts at one step that doubt alone makes shorter. It does not vanish with the step where a monitor jumps.
const MOST_DOUBTS: u32 = 8;

/// The doubts of the attempts at one step.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Doubts {
    count: u32,
}

impl Doubts {
    /// What the doubt of the next attempt counts for.
    pub fn next(&mut self, doubt: f64) -> f64 {
        self.count += u32::from(doubt > 1.0);
        if self.count > MOST_DOUBTS { 0.0 } else { doubt }
    }
}

impl Radau<'_> {
    /// Looks at the monitors between the stages of the step at hand, of size `h`.
    pub(super) fn between(&mut self, h: f64) -> Between {
        if self.stage_vi.is_none() || !self.switching.locates() {
            return Between::default();
        }
        let mut room = std::mem::take(&mut self.switching.between);
        let between = self.look_between(h, &mut room);
        self.switching.between = room;
        between
    }

    /// The same, with room for the monitors at the beginning and at one point.
    fn look_between(&mut self, h: f64, [values, there]: &mut [Vec<Monitor>; 2]) -> Between {
        self.monitors_at(0.0, h, values);
        let dips = values.iter().enumerate().filter_map(|(index, monitor)| self.dip_of(index, values.len(), monitor));
        if let Some(theta) = dips.min_by(f64::total_cmp) {
            self.monitors_at(theta, h, there);
            if there.iter().any(Monitor::is_violated) {
                return Between { dip: Some(theta), doubt: 0.0 };
            }
        }
        let (mut doubt, mut left) = (0.0_f64, 0.0);
        for &node in &self.tableau().c {
            let theta = 0.5 * (left + node);
            left = node;
            self.monitors_at(theta, h, there);
            if there.iter().any(Monitor::is_violated) {
                return Between { dip: Some(theta), doubt: 0.0 };
            }
            let basis = self.basis_at(theta);
            for (index, (start, there)) in values.iter().zip(there.iter()).enumerate() {
                let polynomial = self.combined(&basis, index, values.len(), start.value);
                let rest = (there.value - polynomial).abs() - NOISE * there.noise;
                if rest > 0.0 {
                    doubt = doubt.max(self.doubt_of(index, values.len(), start.value, theta, rest, there.noise));
                }
            }
        }
        Between { dip: None, doubt }
    }

    /// What the increments at the stages count for at `theta`.
    fn basis_at(&self, theta: f64) -> [f64; MOST_STAGES] {
        let mut basis = [0.0; MOST_STAGES];
        self.tableau().increments_at(theta, &mut basis[..self.tableau().stages()]);
        basis
    }

    /// The polynomial through the values of monitor `index` of `count`, where the increments count for `basis`.
    fn combined(&self, basis: &[f64], index: usize, count: usize, start: f64) -> f64 {
        let at_stages = self.stages.monitors.chunks_exact(count);
        start + basis.iter().zip(at_stages).map(|(l, stage)| l * (stage[index].value - start)).sum::<f64>()
    }

    /// The same at `theta`.
    fn interpolated(&self, index: usize, count: usize, start: f64, theta: f64) -> f64 {
        self.combined(&self.basis_at(theta), index, count, start)
    }

    /// The `rest` of the interpolation of one monitor at `theta` in units of what it may be over the step.
    fn doubt_of(&self, index: usize, count: usize, start: f64, theta: f64, rest: f64, noise: f64) -> f64 {
        let tableau = self.tableau();
        let polynomial = |theta: f64| self.interpolated(index, count, start, theta);
        let w = |theta: f64| tableau.c.iter().fold(theta, |product, c| product * (theta - c));
        let (mut doubt, mut left) = (0.0_f64, 0.0);
        for &node in &tableau.c {
            for part in [0.25, 0.5, 0.75] {
                let at = left + part * (node - left);
                doubt = doubt.max((rest * w(at) / w(theta)).abs() / (DOUBT * polynomial(at).max(0.0) + noise));
            }
            left = node;
        }
        doubt
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
        let value = |theta: f64| self.interpolated(index, count, start.value, theta);
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
