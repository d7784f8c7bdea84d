//! The embedded error estimate.

use super::Radau;

impl Radau<'_> {
    /// The embedded estimate of the error of the states, in units of the tolerance,
    /// `E^-1 (Phi(t_n, y_n) + (1/h) diag(M, 0) sum_i D_i Z_i)`, filtered once more where it looks too large.
    pub(super) fn error(&mut self, h: f64, coupled: bool) -> f64 {
        if coupled && let Some(vi) = &mut self.stage_vi {
            vi.swap_face(&mut self.system);
        }
        let error = self.filtered_error(h, coupled);
        if coupled && let Some(vi) = &mut self.stage_vi {
            vi.swap_face(&mut self.system);
        }
        error
    }

    fn filtered_error(&mut self, h: f64, coupled: bool) -> f64 {
        let n = self.system.unknowns;
        let states = self.system.states;
        let factors = match &mut self.stage_vi {
            Some(vi) if coupled => vi.factors(),
            _ => &mut self.factors,
        };
        let weights = &self.methods[self.current].tableau.estimate;
        self.shifted.fill(0.0);
        for (weight, z) in weights.iter().zip(self.stages.z.chunks_exact(n)) {
            for (sum, z) in self.shifted[..states].iter_mut().zip(z) {
                *sum += weight / h * z;
            }
        }
        self.embedded.fill(0.0);
        self.system.add_mass(1.0, &self.shifted, &mut self.embedded);
        let mut error = f64::INFINITY;
        for pass in 0..2 {
            if pass == 1 {
                for (shifted, (y, e)) in self.shifted.iter_mut().zip(self.y.iter().zip(&self.estimate)) {
                    *shifted = y + e;
                }
            }
            let y = if pass == 0 { &self.y } else { &self.shifted };
            if !self.system.phi(self.t, y, &mut self.estimate) {
                return f64::INFINITY;
            }
            for (sum, e) in self.estimate.iter_mut().zip(&self.embedded) {
                *sum += e;
            }
            if !factors.solve_real(&mut self.estimate) {
                return f64::INFINITY;
            }
            let sum: f64 =
                self.estimate[..states].iter().zip(&self.control.weight).map(|(e, w)| (e * w) * (e * w)).sum();
            error = (sum / states as f64).sqrt();
            if error < 1.0 || !(self.counts.accepted == 0 || self.controller.rejected) {
                break;
            }
        }
        if error.is_nan() { f64::INFINITY } else { error }
    }
}
