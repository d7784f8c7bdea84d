//! Preparation of an attempt: derivatives, factors, tolerances, starting values, and the first step size.

use super::{Freshness, Radau};
use crate::settings::StepError;
use crate::stages::Contraction;
use problem::{Shape, Side};

impl Radau<'_> {
    /// Prepares derivatives, factors and tolerances for a step of size `h`.
    pub(crate) fn prepare(&mut self, h: f64) -> Result<(), StepError> {
        self.differentiate()?;
        if self.system.repivot_spheres(&self.y) {
            self.factored = None;
        }
        if self.factored != Some(h) {
            if !self.system.face.blocks.is_empty() {
                self.system.evaluate(self.clock.t, &self.y);
                self.system.linearise_blocks(&self.y, None);
            }
            let tableau = self.orders.current().tableau;
            self.factors.compute(&self.system, &self.system.face, tableau, h);
            self.system.work.factorisations += 1;
            self.factored = Some(h);
        }
        self.set_tolerances(h);
        Ok(())
    }

    /// Evaluates the derivatives of the rows at the beginning of the present step if they are stale.
    pub(super) fn differentiate(&mut self) -> Result<(), StepError> {
        if self.jacobian == Freshness::Stale {
            if !self.system.differentiate(self.clock.t, &self.y) {
                let row = self.system.entries().find(|(_, _, value)| !value.is_finite()).map_or(0, |(row, _, _)| row);
                let (what, component) = self.name_row(row);
                let what = match what {
                    "rate" => "derivative of the rate",
                    "inequality" => "derivative of the inequality",
                    _ => "derivative of the bound",
                };
                return Err(StepError::NotFinite { what, component, t: self.clock.t });
            }
            self.jacobian = Freshness::Fresh;
            self.factored = None;
        }
        Ok(())
    }

    /// Sets the weights of the Newton norm at `y`: `1/sc` for states; for variables, the effect on the states of an
    /// error of the variable over a step (never the size of `z` itself, which is of lower order and jumps).
    pub(crate) fn set_tolerances(&mut self, h: f64) {
        let tolerance = &self.orders.current().tolerance;
        let n = self.system.states;
        self.system.tolerances.resize(n, 0.0);
        let scales = self.control.weight[..n].iter_mut().zip(&mut self.system.tolerances);
        for ((weight, scale), (y, atol)) in scales.zip(self.y.iter().zip(&self.settings.atol)) {
            *scale = (tolerance.factor * atol + tolerance.rtol * y.abs()).max(f64::MIN_POSITIVE);
            *weight = 1.0 / *scale;
        }
        for (size, y) in self.control.size.iter_mut().zip(&self.y) {
            *size = y.abs();
        }
        self.control.kappa = tolerance.kappa;
        self.control.most = tolerance.most;
        if self.system.unknowns > n {
            let rounding = self.clock.rounding(0.0);
            self.system.time_derivative(self.clock.t, &self.y, &mut self.control.by_time);
            for slope in &mut self.control.by_time {
                *slope = if slope.is_finite() { slope.abs() * rounding } else { 0.0 };
            }
            let (states, effects) = self.control.weight.split_at_mut(n);
            effects.fill(0.0);
            for (i, j, value) in self.system.entries() {
                if i < n && j >= n {
                    let mass = self.system.mass_diagonal[i];
                    let effect = if mass == 0.0 { value } else { h * value / mass };
                    effects[j - n] = effects[j - n].max(effect.abs() * states[i]);
                }
            }
        }
    }

    /// Sets the starting values of the stages: the last collocation polynomial, extrapolated; zero if the polynomial
    /// does not apply to the present step.
    pub(crate) fn predict(&mut self, h: f64) {
        let n = self.system.unknowns;
        let tableau = self.tableau();
        if !(self.continues && self.orders.is_kept()) {
            self.stages.z.fill(0.0);
            self.stages.w.fill(0.0);
            return;
        }
        let end = (tableau.stages() - 1) * n;
        self.estimates.shifted.copy_from_slice(&self.last.z[end..end + n]);
        self.last.increments_beyond(tableau, h, &mut self.stages.z);
        for z in self.stages.z.chunks_exact_mut(n) {
            z.iter_mut().zip(&self.estimates.shifted).for_each(|(z, end)| *z -= end);
        }
        self.stages.transform(tableau);
    }

    /// Marks the derivatives as stale, so that the next attempt evaluates them anew.
    pub(crate) fn forget_jacobian(&mut self) {
        if !self.system.constant_jacobian() {
            self.jacobian = Freshness::Stale;
        }
    }

    /// Discards data that are invalid after a switch (change of the active face of `K`): derivatives, factors, the
    /// extrapolated polynomial.
    pub(crate) fn restart(&mut self) {
        self.forget_jacobian();
        self.factored = None;
        self.continues = false;
        self.last.end_slope.clear();
        self.contraction = Contraction::default();
        self.controller.restart();
    }

    pub(super) fn check_finite(&mut self) -> Result<(), StepError> {
        self.system.evaluate(self.clock.t, &self.y);
        self.check_evaluation()
    }

    /// Fails if a row (a rate, a `G` or a moving bound) of the last evaluation is not finite, or if an interval or a
    /// ball is empty.
    pub(crate) fn check_evaluation(&self) -> Result<(), StepError> {
        let t = self.clock.t;
        if let Some(row) = self.system.values.iter().position(|value| !value.is_finite()) {
            let (what, component) = self.name_row(row);
            return Err(StepError::NotFinite { what, component, t });
        }
        let set = &self.system.set;
        if let Some(&variable) = self.system.bounded.iter().find(|&&k| set.lower[k] > set.upper[k]) {
            return Err(StepError::EmptySet { variable, side: Side::Lower, t });
        }
        match set.blocks().iter().find(|block| matches!(block.shape, Shape::Ball { radius } if radius < 0.0)) {
            Some(block) => Err(StepError::EmptySet { variable: block.members[0], side: Side::Radius, t }),
            None => Ok(()),
        }
    }

    /// Returns, for messages, the kind (rate, inequality or bound) of a row of the problem, and the index of the row
    /// within that kind.
    fn name_row(&self, row: usize) -> (&'static str, usize) {
        let (n, unknowns) = (self.system.states, self.system.unknowns);
        if row < n {
            ("rate", row)
        } else if row < unknowns {
            ("inequality", row - n)
        } else {
            ("bound", row - unknowns)
        }
    }

    /// Returns the initial step size: the predicted change of the states is about the geometric mean of the tolerance
    /// and `tolerance^(1/(s+1))` (cf. Hairer, Norsett and Wanner, II.4).
    pub(super) fn first_step(&mut self) -> f64 {
        let span = self.clock.remaining();
        if let Some(h) = self.settings.step.or(self.settings.first_step) {
            return h.min(span);
        }
        let n = self.system.states;
        self.set_tolerances(span);
        let speed = (0..n)
            .map(|j| {
                let mass = self.system.mass_diagonal[j];
                let rate = if mass == 0.0 { 0.0 } else { self.system.values[j] / mass };
                (rate * self.control.weight[j]).powi(2)
            })
            .sum::<f64>()
            .sqrt()
            / (n as f64).sqrt();
        let s = self.tableau().stages() as f64;
        // A first step over which the states change by one tolerance would be far too careful; how much more is
        // possible depends on the order.
        let reach = (1.0 / self.settings.rtol).powf(1.0 - 1.0 / (s + 1.0)).sqrt();
        let least = (1e-12 * span).max(f64::EPSILON * self.clock.t.abs());
        (reach / speed).min(1e-3 * span).max(least).min(span)
    }
}
