//! The energy balance along a Radau IIA run,
//!
//! ```text
//! E(t) - E(0) = work - dissipation + defect
//! ```
//!
//! with the powers integrated over each step by Gauss quadrature, and the rates that are not states obtained by
//! differentiating the interpolating polynomial through the quadrature points. The defect is zero for an exact
//! solution, so it measures the discretisation error.

use super::Checks;
use super::mechanical_checks::{Accuracy, check_energy};
use contact::energy::Energy;
use hybrid::OneStep;
use models::elastic::{EnergyForm, Power};
use radau::Radau;

/// Points and weights of Gauss quadrature with five points on `[-1, 1]`.
const POINTS: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.906_179_845_938_664, 0.236_926_885_056_189_1),
];

/// The energy balance of a run in progress.
pub(super) struct EnergyBalance {
    form: EnergyForm,
    /// The energies of the system at the current time, and the work and losses since the start of the run.
    pub energy: Energy,
    reached: f64,
    samples: [Vec<f64>; POINTS.len()],
    rates: Vec<f64>,
}

impl EnergyBalance {
    /// Begins an energy balance at the current state of the run.
    pub fn new(form: EnergyForm, radau: &Radau<'_>) -> Self {
        let (kinetic, potential) = form.at(radau.y());
        let unknowns = radau.y().len();
        Self {
            form,
            energy: Energy::new(kinetic, potential),
            reached: radau.t(),
            samples: std::array::from_fn(|_| vec![0.0; unknowns]),
            rates: vec![0.0; unknowns],
        }
    }

    /// Adds the last step of the run to the energy balance.
    pub fn step(&mut self, radau: &mut Radau<'_>) {
        if !self.form.is_closed() {
            self.integrate(radau);
        }
        self.reached = radau.t();
        let (kinetic, potential) = self.form.at(radau.y());
        self.energy.close(kinetic, potential);
    }

    /// Records the check of the defect of the energy balance at the end of a run; `rtol` is `None` for fixed steps.
    pub fn judge(&self, radau: &Radau<'_>, rtol: Option<f64>, atol: &[f64], checks: &mut Checks) {
        let mut tolerances = vec![0.0; radau.y().len()];
        tolerances.iter_mut().zip(atol).for_each(|(tolerance, atol)| *tolerance = *atol);
        let (atol, steps) = (self.form.at(&tolerances).0, radau.counts.accepted);
        let accuracy = rtol.map_or(Accuracy::Fixed, |rtol| Accuracy::Tolerance { rtol, atol, work: 0.0, steps });
        check_energy(&self.energy, accuracy, checks);
    }

    fn integrate(&mut self, radau: &mut Radau<'_>) {
        let half = 0.5 * (radau.t() - self.reached);
        let time = |point: f64| self.reached + half * (1.0 + point);
        for (sample, (point, _)) in self.samples.iter_mut().zip(POINTS) {
            radau.at(time(point), sample);
        }
        for (i, (point, weight)) in POINTS.into_iter().enumerate() {
            self.rates.fill(0.0);
            for (j, sample) in self.samples.iter().enumerate() {
                let factor = derivative(i, j) / half;
                self.rates.iter_mut().zip(sample).for_each(|(rate, value)| *rate += factor * value);
            }
            let Power { supplied, viscous, frictional } = self.form.power(time(point), &self.samples[i], &self.rates);
            self.energy.work(half * weight * supplied, 0.0);
            self.energy.dissipate_by_viscosity(half * weight * viscous);
            self.energy.dissipate(half * weight * frictional, 0.0, 0.0);
        }
    }
}

/// Returns the derivative at Gauss point `i` of the Lagrange polynomial of Gauss point `j`.
fn derivative(i: usize, j: usize) -> f64 {
    let at = |k: usize| POINTS[k].0;
    let others = |j: usize| (0..POINTS.len()).filter(move |&k| k != j);
    if i == j {
        return others(j).map(|k| 1.0 / (at(j) - at(k))).sum();
    }
    let product: f64 = others(j).filter(|&k| k != i).map(|k| (at(i) - at(k)) / (at(j) - at(k))).product();
    product / (at(j) - at(i))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_of_time_are_differentiated_and_integrated_exactly() {
        for power in 0..=4 {
            let value = |point: f64| (2.0 + point).powi(power);
            for (i, (point, _)) in POINTS.into_iter().enumerate() {
                let found: f64 = (0..POINTS.len()).map(|j| derivative(i, j) * value(POINTS[j].0)).sum();
                let exact = f64::from(power) * (2.0 + point).powi(power - 1);
                assert!((found - exact).abs() < 1e-12, "{power}: {found} {exact}");
            }
        }
        // Gauss quadrature with five points integrates polynomials of degree 9 exactly.
        let integral: f64 = POINTS.iter().map(|(point, weight)| weight * (2.0 + point).powi(9)).sum();
        assert!((integral - (3_f64.powi(10) - 1.0) / 10.0).abs() < 1e-9 * integral);
    }
}
