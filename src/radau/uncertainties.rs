//! Uncertainties of the variables and of `G` if every unknown is known to its tolerance.

use super::system::System;

/// Errors of the unknowns within the tolerances, and their effect on the variables and on `G`.
#[derive(Clone, Debug, Default)]
pub(super) struct Uncertainties {
    /// Error of each unknown that the tolerances allow; that of a variable, which has no absolute tolerance, is
    /// relative to its largest value.
    pub errors: Vec<f64>,
    /// The largest magnitude of each unknown in the run so far.
    pub largest: Vec<f64>,
    /// Largest change of each variable that affects no state by more than its tolerance over the longest step so far.
    pub without_effect: Vec<f64>,
    /// The tolerance of the variational inequality, relative to the magnitude of the terms of `G`.
    pub vi_tolerance: f64,
}

impl Uncertainties {
    /// Returns the uncertainties of variable `k` and of its `G`, by the derivatives of the last differentiation.
    pub fn at_last(&self, system: &System<'_>, k: usize) -> [f64; 2] {
        self.of(system, k, |at| system.derivatives[at].abs())
    }

    /// Returns the uncertainties of variable `k` and of its `G`, where `slope` returns the magnitude of the
    /// derivative that is stored at a place of the Jacobian.
    pub fn of(&self, system: &System<'_>, k: usize, slope: impl Fn(usize) -> f64) -> [f64; 2] {
        let own = system.states + k;
        let [terms, by_errors] = system.terms_by(own, &slope, |j| [self.largest[j], self.errors[j]]);
        let of_g = (self.vi_tolerance * terms).max(by_errors);
        // An error of the states shifts the root of `G` as well.
        let by_itself = system.place_of_own(k).map_or(0.0, &slope);
        let of_root = if by_itself > 0.0 { by_errors / by_itself } else { 0.0 };
        let of_bounds: f64 =
            system.rows_of_bounds(k).map(|row| system.terms_by(row, &slope, |j| [self.errors[j]])[0]).sum();
        let of_z = (self.errors[own] + of_bounds).max(self.without_effect[k]).max(of_root);
        [of_z, of_g].map(|of| of.max(f64::MIN_POSITIVE))
    }
}
