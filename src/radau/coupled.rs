//! A step whose stages were solved with the variational inequality coupled over them, across a switch that was not
//! located: by how much the states would differ had the switch been anywhere else in the step.

use super::stepper::Radau;

impl Radau<'_> {
    /// The largest `h max_ij |B (z_i - z_j)| / M` of a state over the stages `i, j` of the last step, in units of its
    /// tolerance; `None` where switches were located, were not to be, or the step has none.
    pub fn unlocated_switch(&self) -> Option<f64> {
        if self.last.is_smooth || !self.switching.is_to_locate() || self.last.face.is_same(&self.system.face) {
            return None;
        }
        let (n, unknowns, h) = (self.system.states, self.system.unknowns, self.last.h);
        let mut worst = 0.0_f64;
        let stages = self.methods[self.last_method].tableau.stages();
        for state in (0..n).filter(|&state| self.system.mass_diagonal[state] != 0.0) {
            let rate = |increments: Option<&[f64]>| -> f64 {
                let along = self.system.entries_of_row(state).filter(|&(j, _)| j >= n);
                along.map(|(j, value)| value * (self.last.y[j] + increments.map_or(0.0, |z| z[j]))).sum()
            };
            let rates = (0..stages).map(|i| rate(Some(&self.last.z[i * unknowns..(i + 1) * unknowns])));
            let (lo, hi) = rates.fold((rate(None), rate(None)), |(lo, hi), rate| (lo.min(rate), hi.max(rate)));
            let allowed = self.settings.atol[state] + self.settings.rtol * self.largest[state];
            let mass = self.system.mass_diagonal[state].abs();
            worst = worst.max(h * (hi - lo) / (mass * allowed.max(f64::MIN_POSITIVE)));
        }
        Some(worst)
    }
}
