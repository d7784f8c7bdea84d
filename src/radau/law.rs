//! How far `(x, z)` at one time is from the variational inequality that was posed, in units of the tolerances.
//!
//! The natural map `z - P_K(z - G)` mixes the units of `z` and `G`. With the sizes `a_z` and `a_g` up to which a variable
//! and its `G` are uncertain when every state is known to its tolerance,
//!
//! ```text
//! zeta = z / a_z,    gamma = G / a_g,    excess = |zeta - P(zeta - gamma)|
//! ```
//!
//! has none, and is the same in any units: below one, the law holds for values within the tolerances.

use super::screening::ALLOWED;
use super::stepper::{Extent, Radau};

/// The variable that is furthest from its law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Excess {
    /// The variable, counted from 0; of a block its first member.
    pub variable: usize,
    /// The natural map in units of what the tolerances leave uncertain.
    pub excess: f64,
}

impl Radau<'_> {
    /// The largest excess over the variables at `(t, y)`; `None` where there are no variables. The excess of what is not
    /// finite is infinite.
    pub fn law_excess(&mut self, t: f64, y: &[f64]) -> Option<Excess> {
        if self.system.unknowns == self.system.states {
            return None;
        }
        let mut worst = Excess { variable: 0, excess: 0.0 };
        let evaluations = self.system.work.rates;
        let is_finite = self.system.evaluate(t, y);
        // Evidence is no part of the method: its work is not counted as that of the run.
        self.system.work.rates = evaluations;
        if !is_finite {
            return Some(Excess { excess: f64::INFINITY, ..worst });
        }
        let n = self.system.states;
        let mut by_time: Option<Vec<f64>> = None;
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
            let [of_z, of_g] = self.uncertainties(k, self.last.h);
            let (z, g) = (y[n + k], self.system.values[n + k]);
            let (below, above) = (z - self.system.set.lower[k], self.system.set.upper[k] - z);
            let excess = natural_map(below / of_z, above / of_z, g / of_g);
            if excess <= ALLOWED {
                keep(k, excess);
                continue;
            }
            // A source that no state enters is known at a time that was rounded.
            let by_time = by_time.get_or_insert_with(|| {
                let mut slopes = vec![0.0; self.system.unknowns - n];
                self.system.time_derivative(t, y, &mut slopes);
                slopes
            });
            let of_g = of_g.max(by_time[k].abs() * self.clock.rounding(self.last.h));
            keep(k, natural_map(below / of_z, above / of_z, g / of_g));
        }
        for b in 0..self.system.set.blocks().len() {
            let members = &self.system.set.blocks()[b].members;
            let of_members = members.iter().map(|&k| self.uncertainties(k, self.last.h));
            let [of_z, of_g] = of_members.fold([0.0_f64; 2], |most, of| [most[0].max(of[0]), most[1].max(of[1])]);
            let first = members[0];
            let defect = self.system.defect_of_block(b, &y[n..], of_z / of_g);
            keep(first, defect / of_z);
        }
        Some(worst)
    }

    /// What the tolerances leave uncertain of unknown `j`; of a variable, which has no absolute tolerance, relative to its
    /// largest value.
    pub(super) fn uncertainty(&self, j: usize) -> f64 {
        let atol = if j < self.system.states { self.settings.atol[j] } else { 0.0 };
        atol + self.settings.rtol * self.extent.largest[j]
    }

    /// What the tolerances leave uncertain of variable `k` and of its `G`: errors of the states, the tolerance of the VI, and
    /// of a variable also what changes no state over the longest step so far, where the weights are those of a step of size
    /// `h`, or of a shorter one that finds a face behind it.
    pub(super) fn uncertainties(&self, k: usize, h: f64) -> [f64; 2] {
        let Self { system, settings, extent: Extent { largest, .. }, .. } = self;
        let n = system.states;
        let error = |j: usize| self.uncertainty(j);
        let [terms, by_errors] = system.terms(k, |j| [largest[j], error(j)]);
        let of_g = (settings.vi_tolerance * terms).max(by_errors);
        let effect = self.control.weight[n + k] * self.orders.last().tolerance.factor;
        let without_effect = if effect > 0.0 { h / (effect * self.extent.longest.max(h)) } else { 0.0 };
        // An error of the states moves the root of `G` as well.
        let own = system.entries_of_variable(k).find(|&(j, _)| j == n + k).map_or(0.0, |(_, value)| value.abs());
        let of_root = if own > 0.0 { by_errors / own } else { 0.0 };
        let of_z = (error(n + k) + system.terms_of_bounds(k, error)).max(without_effect).max(of_root);
        [of_z, of_g].map(|of| of.max(f64::MIN_POSITIVE))
    }
}

/// The size of the natural map of an interval, where the distances to its ends and `G` are these.
fn natural_map(below: f64, above: f64, g: f64) -> f64 {
    let excess = if below <= g {
        below
    } else if above <= -g {
        above
    } else {
        g
    };
    excess.abs()
}
