//! Uniqueness as a caveat of the verdict: a solution that is not certified to be the only one is *a* solution. Where it is
//! certified until the equations are no longer Lipschitz, the run watches whether it gets there.

use super::Diagnostics;
use analysis::{Analysis, Uniqueness};
use expression::{Irregularities, Irregularity};
use models::DviModel;
use numerics::Interval;
use problem::Warning;

/// What the user should know of the uniqueness of the solution, before it is computed.
pub fn uniqueness_caveat(analysis: &Analysis) -> Option<Warning> {
    let certified = analysis.uniqueness.is_certified() || analysis.uniqueness == Uniqueness::NotAnalysed;
    let message = format!("uniqueness is not guaranteed: {}", analysis.because);
    (!certified).then_some(Warning { code: "uniqueness_not_guaranteed", message })
}

/// Watches a run for places where its equations are not Lipschitz.
pub(super) struct LipschitzWatch<'p> {
    model: &'p DviModel,
    irregularities: Irregularities,
    rtol: f64,
    atol: &'p [f64],
    /// The end of the last step: time, states, variables.
    last: (f64, Vec<f64>),
    /// The ranges over a step, widened by the tolerance.
    ranges: Vec<Interval>,
    met: Option<(f64, Irregularity)>,
}

impl<'p> LipschitzWatch<'p> {
    /// A watch from `(t, y)` on; none where what is certified cannot be lost.
    pub(super) fn new(
        model: &'p DviModel,
        analysis: &Analysis,
        (rtol, atol): (f64, &'p [f64]),
        (t, y): (f64, &[f64]),
    ) -> Option<Self> {
        let irregularities = model.irregularities().filter(|_| analysis.uniqueness == Uniqueness::LocallyUnique)?;
        let ranges = vec![Interval::LINE; y.len()];
        Some(Self { model, irregularities, rtol, atol, last: (t, y.to_vec()), ranges, met: None })
    }

    /// Takes a step to `(t, y)` into account.
    pub(super) fn observe(&mut self, t: f64, y: &[f64]) {
        if self.met.is_some() {
            return;
        }
        let (before, last) = &mut self.last;
        for (i, (range, (&from, &to))) in self.ranges.iter_mut().zip(last.iter().zip(y)).enumerate() {
            let tolerance = self.atol.get(i).map_or(0.0, |atol| atol + self.rtol * from.abs().max(to.abs()));
            *range = Interval::new(from.min(to) - tolerance, from.max(to) + tolerance);
        }
        if let Some(met) = self.irregularities.over(Interval::new(*before, t), &self.ranges) {
            self.met = Some((t, met.clone()));
        }
        *before = t;
        last.copy_from_slice(y);
    }

    /// Takes the certificate back if it was lost.
    pub(super) fn finish(&self, diagnostics: &mut Diagnostics) {
        let Some((t, met)) = &self.met else { return };
        let Some(analysis) = diagnostics.analysis.take() else { return };
        let analysis = self.model.uncertified(analysis, met, *t);
        if let Some(Warning { code, message }) = uniqueness_caveat(&analysis) {
            diagnostics.checks.caveat(code, message);
        }
        diagnostics.analysis = Some(analysis);
    }
}
