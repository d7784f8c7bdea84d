//! Uniqueness as a caveat of the verdict: a solution that is not certified to be unique is *a* solution. The
//! certificate at the start need not hold later. The run therefore monitors whether it reaches points where the
//! equations are not Lipschitz continuous, and whether the certificate holds on the faces and at the states that it
//! visits.

use super::Diagnostics;
use analysis::{Analysis, Uniqueness, analyse_face};
use expression::{Irregularities, Irregularity};
use hybrid::OneStep;
use models::DviModel;
use numerics::Interval;
use problem::{Structure, Warning};
use radau::{Activity, Radau};

/// Returns the caveat about uniqueness from the analysis before the solve, if there is one.
pub fn uniqueness_caveat(analysis: &Analysis) -> Option<Warning> {
    let certified = analysis.uniqueness.is_certified() || analysis.uniqueness == Uniqueness::NotAnalysed;
    let message = format!("uniqueness is not guaranteed: {}", analysis.because);
    (!certified).then_some(Warning { code: "uniqueness_not_guaranteed", message })
}

/// Detects points of a run where the equations are not Lipschitz continuous.
pub(super) struct LipschitzWatch<'p> {
    model: &'p DviModel,
    irregularities: Irregularities,
    rtol: f64,
    atol: &'p [f64],
    /// Time, and states and variables, at the end of the last step of the run.
    last: (f64, Vec<f64>),
    /// The ranges of states and variables over a step, widened by the tolerance.
    ranges: Vec<Interval>,
    met: Option<(f64, Irregularity)>,
}

impl<'p> LipschitzWatch<'p> {
    /// Begins the detection of points without Lipschitz continuity at the time `t` and the unknowns `y`; returns `None`
    /// if the certificate of uniqueness does not depend on Lipschitz continuity.
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

    /// Examines the equations over the step that ends at the time `t` with the unknowns `y`.
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

    /// Withdraws the certificate of uniqueness if a point without Lipschitz continuity was met.
    pub(super) fn finish(&self, diagnostics: &mut Diagnostics) {
        if let Some((t, met)) = &self.met {
            take_back(diagnostics, |analysis| self.model.uncertified(analysis, met, *t));
        }
    }
}

/// Largest number of states and variables for which the active face is analysed at every step; with more, the
/// analysis takes longer than a step and is made only at switches.
const MOST_AT_EVERY_STEP: usize = 40;

/// Detects faces on which a certificate of uniqueness no longer holds, as where an attractive sliding surface becomes
/// repulsive.
pub(super) struct FaceWatch {
    at_every_step: bool,
    /// The time and the analysis of the face on which the certificate was lost.
    lost: Option<(f64, Analysis)>,
}

impl FaceWatch {
    /// Begins the detection at the start of a run; returns `None` if there is no certificate of uniqueness, or if it cannot
    /// be lost: without variables, or with a constant Jacobian.
    pub(super) fn new(structure: &Structure, analysis: &Analysis) -> Option<Self> {
        let may_lose = analysis.uniqueness.is_certified() && structure.variables > 0 && !structure.constant_jacobian;
        may_lose.then(|| Self { at_every_step: structure.unknowns() <= MOST_AT_EVERY_STEP, lost: None })
    }

    /// Examines the active face at the end of a step for uniqueness; `known` is the analysis of the face, if it already
    /// exists.
    pub(super) fn observe(&mut self, radau: &mut Radau<'_>, switched: bool, known: Option<&Analysis>) {
        let moves = radau.face().places.iter().any(|place| place.equations() < usize::MAX);
        if self.lost.is_some() || !moves || !(self.at_every_step || switched) {
            return;
        }
        let analysis = known.cloned().unwrap_or_else(|| analysis_of_face(radau));
        if !analysis.uniqueness.is_certified() && analysis.uniqueness != Uniqueness::NotAnalysed {
            self.lost = Some((radau.t(), analysis));
        }
    }

    /// Withdraws the certificate of uniqueness if it was lost on an active face.
    pub(super) fn finish(&self, diagnostics: &mut Diagnostics) {
        if let Some((t, Analysis { uniqueness, because, .. })) = &self.lost {
            let because = format!("on the face that became active at t = {t}: {because}");
            take_back(diagnostics, |analysis| Analysis { uniqueness: *uniqueness, because, ..analysis });
        }
    }
}

/// Replaces the analysis of a run by one without the certificate of uniqueness, and adds the caveat.
fn take_back(diagnostics: &mut Diagnostics, uncertified: impl FnOnce(Analysis) -> Analysis) {
    let Some(analysis) = diagnostics.analysis.take().map(uncertified) else { return };
    if let Some(Warning { code, message }) = uniqueness_caveat(&analysis) {
        diagnostics.checks.caveat(code, message);
    }
    diagnostics.analysis = Some(analysis);
}

/// Returns the analysis of the active face at the current time of a run.
pub(super) fn analysis_of_face(radau: &mut Radau<'_>) -> Analysis {
    let (t, y, face) = (radau.t(), radau.y().to_vec(), radau.face().clone());
    let blocks = radau.equations_of_blocks();
    analyse_face(radau.problem(), t, &y, &blocks, |k| face.places[k] == Activity::Inactive)
}
