//! Residual of the variational inequality at one point `(t, x, z)`, in units of the tolerances.
//!
//! The natural map `z - P_K(z - G)` mixes the units of `z` and `G`. Let `a_z` and `a_g` be the uncertainties of a
//! variable and of its `G` if every state is known to its tolerance. Then the excess
//!
//! ```text
//! zeta = z / a_z,    gamma = G / a_g,    excess = |zeta - P(zeta - gamma)|
//! ```
//!
//! does not depend on the units: below one, the variational inequality holds for values within the tolerances.

use super::screening::ALLOWED;
use super::stepper::Radau;
use super::uncertainties::Uncertainties;
use numerics::Interval;

/// The variable with the largest residual of its variational inequality.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Excess {
    /// Index of the variable, counted from 0; for a block of variables, the index of its first member.
    pub variable: usize,
    /// Residual of the natural map for the variable, in units of the uncertainty that the tolerances allow.
    pub excess: f64,
}

impl Radau<'_> {
    /// Returns the largest residual of the variational inequality ([`Self::law_excess`]) at the end of the last step.
    pub fn law_excess_at_end(&mut self) -> Option<Excess> {
        let y = std::mem::take(&mut self.y);
        let found = self.law_excess(self.clock.t, &y);
        self.y = y;
        found
    }

    /// Returns the largest excess, the residual of the variational inequality in units of the tolerances, over the
    /// variables at `(t, y)`; `None` without variables. The excess is infinite if a value is not finite.
    pub fn law_excess(&mut self, t: f64, y: &[f64]) -> Option<Excess> {
        if self.system.unknowns == self.system.states {
            return None;
        }
        let mut worst = Excess { variable: 0, excess: 0.0 };
        let evaluations = self.system.work.rates;
        let is_finite = self.system.evaluate(t, y);
        // Evaluations for the check of a solution are not counted as work of the run.
        self.system.work.rates = evaluations;
        if !is_finite {
            return Some(Excess { excess: f64::INFINITY, ..worst });
        }
        let n = self.system.states;
        let mut near: Option<Vec<Interval>> = None;
        let uncertainties = self.uncertainties(self.last.h);
        let mut slopes: Option<Vec<f64>> = None;
        let mut keep = |variable: usize, excess: f64| {
            let excess = if excess.is_nan() { f64::INFINITY } else { excess };
            if excess > worst.excess {
                worst = Excess { variable, excess };
            }
        };
        for k in 0..self.system.unknowns - n {
            if self.system.set.block_of(k).is_some() {
                continue;
            }
            let (z, g) = (y[n + k], self.system.values[n + k]);
            let (below, above) = (z - self.system.set.lower[k], self.system.set.upper[k] - z);
            if natural_map(below, above, g) == 0.0 {
                continue;
            }
            let slopes = slopes.get_or_insert_with(|| self.slopes_near(t, y, &uncertainties.errors));
            let [of_z, of_g] = uncertainties.of(&self.system, k, |at| slopes[at]);
            let of = |g: f64| natural_map(below / of_z, above / of_z, g / of_g);
            if of(g).abs() <= ALLOWED {
                keep(k, of(g).abs());
                continue;
            }
            let near = near.get_or_insert_with(|| self.enclose_near_time(t, y));
            // The natural map is nondecreasing in `G`.
            let (least, most) = (of(near[n + k].lo.min(g)), of(near[n + k].hi.max(g)));
            keep(k, if least <= 0.0 && most >= 0.0 { 0.0 } else { least.abs().min(most.abs()) });
        }
        for b in 0..self.system.set.blocks().len() {
            let slopes = slopes.get_or_insert_with(|| self.slopes_near(t, y, &uncertainties.errors));
            let members = &self.system.set.blocks()[b].members;
            let of_members = members.iter().map(|&k| uncertainties.of(&self.system, k, |at| slopes[at]));
            let [of_z, of_g] = of_members.fold([0.0_f64; 2], |most, of| [most[0].max(of[0]), most[1].max(of[1])]);
            let first = members[0];
            let defect = self.system.defect_of_block(b, &y[n..], of_z / of_g);
            keep(first, defect / of_z);
        }
        Some(worst)
    }

    /// Encloses the rows of the problem at `y` over all times within the rounding of `t`: a given function of time is
    /// known only up to that rounding, and next to a jump only up to the jump. Rows without a finite enclosure are
    /// empty.
    fn enclose_near_time(&mut self, t: f64, y: &[f64]) -> Vec<Interval> {
        let rounding = self.clock.rounding(self.last.h);
        let ranges: Vec<Interval> = y.iter().map(|y| Interval::point(*y)).collect();
        let mut values = vec![Interval::EMPTY; self.system.values.len()];
        let times = Interval::new(t - rounding, t + rounding);
        if !self.system.problem().enclose(times, &ranges, &mut values) {
            values.fill(Interval::EMPTY);
        }
        let is_known = |range: &Interval| range.defined && range.width().is_finite();
        values.iter_mut().filter(|range| !is_known(range)).for_each(|range| *range = Interval::EMPTY);
        values
    }

    /// Returns the largest magnitudes of the derivatives of the rows at `t` over all unknowns within `errors` of `y`.
    /// Derivatives that are constant or cannot be enclosed have the values of the last differentiation.
    fn slopes_near(&mut self, t: f64, y: &[f64], errors: &[f64]) -> Vec<f64> {
        let mut slopes: Vec<f64> = self.system.derivatives.iter().map(|slope| slope.abs()).collect();
        if self.system.constant_jacobian() {
            return slopes;
        }
        let ranges: Vec<Interval> =
            y.iter().zip(errors).map(|(y, error)| Interval::new(y - error, y + error)).collect();
        let mut jacobian = vec![Interval::LINE; slopes.len()];
        let mut by_time = vec![Interval::LINE; self.system.unknowns - self.system.states];
        if self.system.problem().enclose_derivatives(Interval::point(t), &ranges, &mut jacobian, &mut by_time) {
            let sizes = jacobian.iter().map(|slope| slope.size());
            slopes.iter_mut().zip(sizes).filter(|(_, size)| size.is_finite()).for_each(|(slope, size)| *slope = size);
        }
        slopes
    }

    /// Returns the uncertainty of unknown `j` if it is known to its tolerance; that of a variable, which has no
    /// absolute tolerance, is relative to its largest value.
    pub(super) fn uncertainty(&self, j: usize) -> f64 {
        let atol = if j < self.system.states { self.settings.atol[j] } else { 0.0 };
        atol + self.settings.rtol * self.extent.largest[j]
    }

    /// Returns the uncertainties of the unknowns if each is known to its tolerance. The weights of the Newton norm must
    /// have been set for a step of size `h`, or for the shorter probe step that selects the face behind such a step.
    pub(super) fn uncertainties(&self, h: f64) -> Uncertainties {
        let Self { system, settings, extent, control, .. } = self;
        let longest = extent.longest.max(h);
        let factor = self.orders.last().tolerance.factor;
        let without_effect = control.weight[system.states..].iter().map(|weight| match weight * factor {
            effect if effect > 0.0 => h / (effect * longest),
            _ => 0.0,
        });
        Uncertainties {
            errors: (0..system.unknowns).map(|j| self.uncertainty(j)).collect(),
            largest: extent.largest.clone(),
            without_effect: without_effect.collect(),
            vi_tolerance: settings.vi_tolerance,
        }
    }
}

/// Evaluates the natural map of an interval, given the distances to its ends and `G`; the map is nondecreasing in
/// `G`.
fn natural_map(below: f64, above: f64, g: f64) -> f64 {
    if below <= g {
        below
    } else if above <= -g {
        -above
    } else {
        g
    }
}
