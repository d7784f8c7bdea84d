//! Sign changes of monitors on the collocation polynomial of a step: first guesses of the switches.

use super::face::{Monitor, monitors};
use super::stepper::Radau;
use super::switches::Switching;
use super::tableau::MOST_STAGES;
use numerics::Bracket;

/// A monitor (event function of the active face of `K`) that changes sign within a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossing {
    /// Index of the monitor among the monitors of the active face of `K`.
    pub index: usize,
    /// Position of the sign change of the monitor, as a fraction of the step.
    pub theta: f64,
    /// The mean rate of change of the monitor over the interval of the step in which its sign change was found.
    pub slope: f64,
    /// Interval, in fractions of the step, over which the monitor changes from positive to negative, if the monitor
    /// may have other zeros over the step.
    pub bracket: Option<(f64, f64)>,
}

/// Maximum number of halvings of an interval in the search for a point at which a monitor is positive, if it is zero
/// within noise at the beginning of the interval.
const RISES: i32 = 16;

impl Radau<'_> {
    /// Evaluates all monitors (event functions) of the active face on the collocation polynomial of the present step at
    /// the position `theta`, into `out`.
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

    /// Evaluates all monitors on the collocation polynomial at the fraction `theta` of the step, as
    /// [`Self::monitors_at`] does; if a monitor is negative within noise, the noise levels are found from the
    /// derivatives at `theta`.
    pub(super) fn judged_monitors_at(&mut self, theta: f64, h: f64, out: &mut Vec<Monitor>) {
        self.monitors_at(theta, h, out);
        let t = self.clock.t + theta * h;
        let scratch = &self.switching.scratch;
        // The noise of a monitor whose value is small at `theta` depends on the derivatives there, not on those at
        // another point.
        let may_be_violated = |monitor: &Monitor| monitor.value < 0.0 && !monitor.is_violated();
        if out.iter().any(may_be_violated) && self.system.exchange_derivatives(t, scratch) {
            monitors(&mut self.system, &self.control, scratch, out);
            self.system.restore_derivatives();
        }
    }

    /// Evaluates the collocation polynomial of the present step at the position `theta` into `switching.scratch`.
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

    /// Returns the earliest sign change of a violated monitor on the collocation polynomial of the present step;
    /// `hidden_crossing` is a point between the stages at which a violation has been seen.
    pub(super) fn earliest(&mut self, h: f64, hidden_crossing: Option<f64>) -> Option<Crossing> {
        // The ends of the intervals of the search: the stages, the midpoints between them, and the point of a hidden
        // crossing.
        let mut left = 0.0;
        let nodes = self.tableau().c.iter();
        let mut ends: Vec<f64> =
            nodes.flat_map(|&node| [0.5 * (std::mem::replace(&mut left, node) + node), node]).collect();
        ends.extend(hidden_crossing.filter(|theta| *theta < 1.0));
        ends.sort_by(f64::total_cmp);
        let (mut at_left, mut at_right) = (Vec::new(), Vec::new());
        self.judged_monitors_at(0.0, h, &mut at_left);
        left = 0.0;
        for right in ends {
            self.judged_monitors_at(right, h, &mut at_right);
            let mut first: Option<Crossing> = None;
            for (index, (start, end)) in at_left.iter().zip(&at_right).enumerate() {
                if !end.is_violated() {
                    continue;
                }
                let theta = self.root(index, (left, *start), (right, end.value), h);
                if first.is_none_or(|first| theta < first.theta) {
                    let slope = (end.value - start.value) / ((right - left) * h);
                    let bracket = hidden_crossing.map(|_| (left, right));
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

    /// Returns the first point found, in a bisection towards `left`, at which a monitor exceeds its noise level at
    /// `left`, and the value of the monitor at that point.
    fn rise(&mut self, index: usize, (left, start): (f64, Monitor), right: f64, h: f64) -> Option<(f64, f64)> {
        let mut values = Vec::new();
        (1..=RISES).find_map(|k| {
            let theta = left + (right - left) * 0.5_f64.powi(k);
            self.monitors_at(theta, h, &mut values);
            (values[index].value > start.noise).then(|| (theta, values[index].value))
        })
    }

    /// Returns the zero of a monitor between two points of opposite sign, by the Illinois method; the left point if
    /// the monitor is not positive there and does not rise from it. On a new face a monitor may be zero to within
    /// noise, and rise before it falls.
    fn root(&mut self, index: usize, left: (f64, Monitor), right: (f64, f64), h: f64) -> f64 {
        // A monitor (event function) that crossed zero together with the one that ended the last step is wrong by its
        // noise at the end of that step, which may exceed its noise at the left point.
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
