//! Where a monitor changes sign on the collocation polynomial of a step: about where a switch is.

use super::face::{Monitor, monitors};
use super::stepper::Radau;
use super::switches::Switching;
use super::tableau::MOST_STAGES;
use numerics::Bracket;

/// A monitor that changes sign within a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossing {
    /// Which of the monitors of the face.
    pub index: usize,
    /// Where, as a fraction of the step.
    pub theta: f64,
    /// The rate of change of the monitor there.
    pub slope: f64,
    /// Where it was positive before, and where it was seen to be negative, if it may have other zeros over the step.
    pub bracket: Option<(f64, f64)>,
}

/// So many times an interval is halved in the search for a monitor that rises.
const RISES: i32 = 16;

impl Radau<'_> {
    /// The values of all monitors on the collocation polynomial of the present step.
    pub(super) fn monitors_at(&mut self, theta: f64, h: f64, out: &mut Vec<Monitor>) {
        self.polynomial_at(theta);
        let t = self.clock.t + theta * h;
        let Switching { inside, constraints, scratch, .. } = &mut self.switching;
        constraints.correct(&mut self.system, &self.control, t, scratch);
        self.system.evaluate(t, scratch);
        if !inside.correct(&mut self.system, scratch)
            && let Some(consistent) = &mut self.consistent
            && consistent.is_cheap()
            && consistent.solve(&mut self.system, &self.control, t, scratch)
        {
            self.system.evaluate(t, scratch);
        }
        monitors(&mut self.system, &self.control, scratch, out);
    }

    /// The collocation polynomial of the present step, into the scratch of the switches.
    pub(super) fn polynomial_at(&mut self, theta: f64) {
        let tableau = self.tableau();
        let mut basis = [0.0; MOST_STAGES];
        let basis = &mut basis[..tableau.stages()];
        tableau.increments_at(theta, basis);
        self.switching.scratch.copy_from_slice(&self.y);
        for (factor, z) in basis.iter().zip(self.stages.z.chunks_exact(self.system.unknowns)) {
            for (y, z) in self.switching.scratch.iter_mut().zip(z) {
                *y += factor * z;
            }
        }
    }

    /// The earliest sign change of a violated monitor on the collocation polynomial of the present step.
    pub(super) fn earliest(&mut self, h: f64, dip: Option<f64>) -> Option<Crossing> {
        // The stages, the middles between them, and where a dip was seen.
        let mut left = 0.0;
        let nodes = self.tableau().c.iter();
        let mut ends: Vec<f64> =
            nodes.flat_map(|&node| [0.5 * (std::mem::replace(&mut left, node) + node), node]).collect();
        ends.extend(dip.filter(|theta| *theta < 1.0));
        ends.sort_by(f64::total_cmp);
        let (mut at_left, mut at_right) = (Vec::new(), Vec::new());
        self.monitors_at(0.0, h, &mut at_left);
        left = 0.0;
        for right in ends {
            self.monitors_at(right, h, &mut at_right);
            let mut first: Option<Crossing> = None;
            for (index, (start, end)) in at_left.iter().zip(&at_right).enumerate() {
                if !end.is_violated() {
                    continue;
                }
                let theta = self.root(index, (left, *start), (right, end.value), h);
                if first.is_none_or(|first| theta < first.theta) {
                    let slope = (end.value - start.value) / ((right - left) * h);
                    let bracket = dip.map(|_| (left, right));
                    first = Some(Crossing { index, theta, slope, bracket });
                }
            }
            if first.is_some() {
                return first;
            }
            left = right;
            std::mem::swap(&mut at_left, &mut at_right);
        }
        None
    }

    /// Where a monitor rises from its noise, nearer and nearer to `left`, and its value there.
    fn rise(&mut self, index: usize, (left, start): (f64, Monitor), right: f64, h: f64) -> Option<(f64, f64)> {
        let mut values = Vec::new();
        (1..=RISES).find_map(|k| {
            let theta = left + (right - left) * 0.5_f64.powi(k);
            self.monitors_at(theta, h, &mut values);
            (values[index].value > start.noise).then(|| (theta, values[index].value))
        })
    }

    /// The zero of a monitor between two points where it has opposite signs, by the Illinois method; the left point if
    /// it is not positive there. A face begins where a monitor of it is zero to within noise, and may rise before it falls.
    fn root(&mut self, index: usize, left: (f64, Monitor), right: (f64, f64), h: f64) -> f64 {
        // What crossed with the monitor that ended the last step is off by what is noise there, not here.
        let start = if left.1.value > 0.0 { Some((left.0, left.1.value)) } else { self.rise(index, left, right.0, h) };
        let Some(start) = start else { return left.0 };
        let mut bracket = Bracket::new(start, right);
        let mut values = Vec::new();
        for _ in 0..40 {
            let theta = bracket.guess();
            if !theta.is_finite() || bracket.width() <= 1e-9 * bracket.behind.0 {
                break;
            }
            self.monitors_at(theta, h, &mut values);
            let Monitor { value, .. } = values[index];
            bracket.narrow(theta, value);
            if value == 0.0 {
                break;
            }
        }
        bracket.behind.0
    }
}
