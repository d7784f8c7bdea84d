//! The defect of an accepted step as an integral:
//!
//! ```text
//! M (x(t + h) - x(t)) = h sum_q w_q F(t_q, y(t_q)),    t_q, w_q of the rule of Gauss with five points,
//! ```
//!
//! where `F` is enclosed over all `y` within the tolerances of the dense output. If the rates are smooth, the error
//! estimate bounds the defect. If they have kinks or an infinite slope, Newton's method may use derivatives from the
//! wrong side: its increments vanish though the stages are not solved, and the error estimate uses the same wrong
//! numbers.

use super::screening::ALLOWED;
use super::stepper::Radau;
use numerics::Interval;

/// Points and weights of the Gauss rule on `[0, 1]`, for the integrals of the rates over a step.
const GAUSS: [(f64, f64); 5] = [
    (0.046_910_077_030_668_0, 0.118_463_442_528_094_54),
    (0.230_765_344_947_158_45, 0.239_314_335_249_683_23),
    (0.5, 0.284_444_444_444_444_44),
    (0.769_234_655_052_841_5, 0.239_314_335_249_683_23),
    (0.953_089_922_969_332, 0.118_463_442_528_094_54),
];

impl Radau<'_> {
    /// Returns the state with the largest defect over the last step (difference of its change and the integral of its
    /// rate), and that defect in units of the tolerance of the state; `None` if the problem cannot be enclosed.
    pub fn defect(&mut self) -> Option<(usize, f64)> {
        let (n, h) = (self.system.states, self.last.h);
        let errors = self.allowed_errors();
        let tableau = self.orders.last().tableau;
        let mut y = vec![0.0; self.system.unknowns];
        let mut values = vec![Interval::LINE; self.system.values.len()];
        let mut integral = vec![Interval::point(0.0); n];
        for (point, weight) in GAUSS {
            let t = self.last.t + point * h;
            self.last.at(tableau, t, &mut y);
            if !self.enclose_near(t, &y, &errors, &mut values) {
                return None;
            }
            for (sum, value) in integral.iter_mut().zip(&values) {
                *sum = *sum + Interval::point(weight * h) * *value;
            }
        }
        let (before, after) = (&self.last.y, self.last.t + h);
        let begin = before[..n].to_vec();
        self.last.at(tableau, after, &mut y);
        let change: Vec<f64> = y[..n].iter().zip(&begin).map(|(end, begin)| end - begin).collect();
        let mut momentum = vec![0.0; self.system.unknowns];
        let mut padded = change.clone();
        padded.resize(self.system.unknowns, 0.0);
        self.system.multiply_by_mass(&padded, &mut momentum);
        let rates = (0..n).filter(|&i| self.system.mass_diagonal[i] != 0.0);
        let excess = rates.map(|i| {
            let Interval { lo, hi, .. } = integral[i];
            let beyond = (lo - momentum[i]).max(momentum[i] - hi).max(0.0);
            (i, beyond / (self.system.mass_diagonal[i].abs() * errors[i]).max(f64::MIN_POSITIVE))
        });
        excess.max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Returns the admissible error of each unknown in the computation of the defect, a multiple of its tolerance.
    fn allowed_errors(&self) -> Vec<f64> {
        (0..self.system.unknowns).map(|j| ALLOWED * self.uncertainty(j)).collect()
    }

    /// Encloses the rows of the problem at `t` for unknowns within `errors` of `y`; returns false if the problem
    /// cannot be enclosed.
    fn enclose_near(&mut self, t: f64, y: &[f64], errors: &[f64], values: &mut [Interval]) -> bool {
        let ranges: Vec<Interval> = y.iter().zip(errors).map(|(y, e)| Interval::new(y - e, y + e)).collect();
        self.system.problem().enclose(Interval::point(t), &ranges, values)
    }

    /// Whether the solved stages of a step of size `h` satisfy their equations for rates somewhere within the
    /// tolerances of the states. If derivatives belong to the wrong side of a kink, or to an infinite slope, small
    /// increments prove nothing: they are small whatever the residual. True without a check if the rows have no kinks.
    pub(super) fn are_stages_solved(&mut self, h: f64) -> bool {
        if !self.system.has_kinks {
            return true;
        }
        let (n, unknowns) = (self.system.states, self.system.unknowns);
        let tableau = self.tableau();
        let errors = self.allowed_errors();
        let mut rates = vec![vec![Interval::LINE; self.system.values.len()]; tableau.stages()];
        for (i, (c, values)) in tableau.c.iter().zip(&mut rates).enumerate() {
            let y = self.stages.stage(&self.y, i).to_vec();
            if !self.enclose_near(self.clock.t + c * h, &y, &errors, values) {
                return true;
            }
        }
        let mut momentum = vec![0.0; unknowns];
        (0..tableau.stages()).all(|i| {
            self.system.multiply_by_mass(&self.stages.z[i * unknowns..(i + 1) * unknowns], &mut momentum);
            (0..n).filter(|&row| self.system.mass_diagonal[row] != 0.0).all(|row| {
                let of_stage = |j: usize| Interval::point(h * tableau.a[(i, j)]) * rates[j][row];
                let sum = (0..tableau.stages()).map(of_stage).fold(Interval::point(0.0), |sum, term| sum + term);
                let allowed = self.system.mass_diagonal[row].abs() * errors[row];
                momentum[row] >= sum.lo - allowed && momentum[row] <= sum.hi + allowed
            })
        })
    }
}
