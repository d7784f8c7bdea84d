//! Other solutions beside the computed one, as a doubt of the verdict: the orientation of an active face proves them
//! ([`Orientation`]). Where an attractive sliding surface becomes repulsive, a solution may leave it at any time, and to
//! either side.

use super::{CheckCode, Diagnostics};
use analysis::{Analysis, Orientation};
use hybrid::OneStep;
use problem::Structure;
use radau::{Activity, Radau};

/// Largest number of states and variables for which faces are examined, with dense matrices.
const MOST_UNKNOWNS: usize = 40;

/// Detects active faces on which other solutions exist.
pub(super) struct OrientationWatch<'p> {
    /// Whether faces are examined at every step: those of a constant Jacobian change at switches only.
    at_every_step: bool,
    /// The relative tolerance, zero at steps of a given size, and the absolute tolerance of each state.
    tolerances: (f64, &'p [f64]),
    /// The activity of each variable after the last step.
    face: Vec<Activity>,
    /// The last examination of a face of one variable: the activities, the states, and the determinant of its matrix.
    last: Option<(Vec<Activity>, Vec<f64>, f64)>,
    /// The first time at which the existence of other solutions is proven, with a determinant and the least one of a face
    /// with a unique solution.
    found: Option<(f64, [f64; 2])>,
}

impl<'p> OrientationWatch<'p> {
    /// Begins the detection at the start of a run; returns `None` if it cannot find anything: without variables in bounded
    /// sets, or with a constant Jacobian that certifies uniqueness.
    pub(super) fn new(structure: &Structure, analysis: &Analysis, tolerances: (f64, &'p [f64])) -> Option<Self> {
        let is_certain = analysis.uniqueness.is_certified() && structure.constant_jacobian;
        let is_bounded = (0..structure.variables).any(|k| structure.is_bounded(k));
        (!is_certain && is_bounded && structure.unknowns() <= MOST_UNKNOWNS).then(|| Self {
            at_every_step: !structure.constant_jacobian,
            tolerances,
            face: Vec::new(),
            last: None,
            found: None,
        })
    }

    /// Examines the active face at the end of a step and, if the step ended with a switch, the face before the switch.
    pub(super) fn observe(&mut self, radau: &mut Radau<'_>, switched: bool) {
        if self.found.is_some() {
            return;
        }
        let has_changed = radau.face().places != self.face;
        if has_changed && !self.face.is_empty() && radau.problem().structure().set.blocks().is_empty() {
            let before = std::mem::take(&mut self.face);
            self.examine(radau, &before);
            self.face = before;
        }
        self.face.clone_from(&radau.face().places);
        if self.at_every_step || switched {
            let face = std::mem::take(&mut self.face);
            self.examine(radau, &face);
            self.face = face;
        }
    }

    fn examine(&mut self, radau: &mut Radau<'_>, face: &[Activity]) {
        if self.found.is_some() || !face.contains(&Activity::Inactive) {
            return;
        }
        let (t, y, blocks) = (radau.t(), radau.y().to_vec(), radau.equations_of_blocks());
        let inside = |k: usize| face[k] == Activity::Inactive;
        let Some(orientation) = Orientation::at(radau.problem(), t, &y, &blocks, inside) else { return };
        let (rtol, atol) = self.tolerances;
        let mut found = [orientation.determinant, orientation.least_determinant(rtol)];
        if orientation.variables == 1 {
            let determinant = orientation.of_matrix;
            let last = self.last.replace((face.to_vec(), y, determinant));
            if let (Some((before, from, was)), Some((_, to, _))) = (last, &self.last)
                && before == face
                && determinant < was
                && found[0] >= found[1]
            {
                // The part of the last step by which the tolerance may move the states.
                let moved = atol.iter().zip(from.iter().zip(to)).filter(|(_, (from, to))| from != to);
                let parts =
                    moved.map(|(atol, (from, to))| (atol + rtol * from.abs().max(to.abs())) / (to - from).abs());
                let part = parts.fold(f64::INFINITY, f64::min);
                if rtol > 0.0 && part.is_finite() {
                    found = [determinant / (was - determinant), part];
                }
            }
        }
        if found[0] < found[1] {
            self.found = Some((t, found));
        }
    }

    /// Records the doubt if other solutions were found.
    pub(super) fn finish(&self, diagnostics: &mut Diagnostics) {
        let Some((t, [determinant, least])) = self.found else { return };
        diagnostics.checks.record(CheckCode::OtherSolutions, least - determinant, 0.0, || {
            format!(
                "at t = {t} other solutions exist, up to the tolerance: on the active face the determinant of CB (or G_z), \
                 relative to its terms or to its change in the last step, is {determinant:.1e}, and of a solution that may \
                 be the only one it is at least {least:.1e}; a solution may leave the face at any time, and the program \
                 selects when this one does"
            )
        });
    }
}
