//! Other solutions beside the computed one, as a doubt of the verdict: the orientation of an active face proves them
//! ([`Orientation`]). Where an attractive sliding surface becomes repulsive, a solution may leave it at any time, and to
//! either side.

use super::{CheckCode, Diagnostics};
use analysis::{Analysis, Orientation};
use hybrid::OneStep;
use problem::Structure;
use radau::{Activity, Radau};

/// Part of its value at the beginning of a step below which a determinant must fall before its sign is examined within
/// the tolerances of the states: one that reaches zero falls below any part.
const FALLEN: f64 = 0.5;
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
    /// The last examination of a face of one variable: the activities, and the determinant of its matrix.
    last: Option<(Vec<Activity>, f64)>,
    /// The first time at which the existence of other solutions is proven, with the determinant that proves them.
    found: Option<(f64, f64)>,
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
        let face = radau.face().places.clone();
        let before = std::mem::replace(&mut self.face, face.clone());
        if before != face && !before.is_empty() && radau.problem().structure().set.blocks().is_empty() {
            self.examine(radau, &before);
        }
        if self.at_every_step || switched {
            self.examine(radau, &face);
        }
    }

    fn examine(&mut self, radau: &mut Radau<'_>, face: &[Activity]) {
        if self.found.is_some() || !face.contains(&Activity::Inactive) {
            return;
        }
        let (t, y, blocks) = (radau.t(), radau.y().to_vec(), radau.equations_of_blocks());
        let inside = |k: usize| face[k] == Activity::Inactive;
        let mut of = |y: &[f64]| Orientation::at(radau.problem(), t, y, &blocks, inside);
        let Some(orientation) = of(&y) else { return };
        let mut found = orientation;
        let (rtol, atol) = self.tolerances;
        if orientation.variables == 1 && rtol > 0.0 {
            let last = self.last.replace((face.to_vec(), orientation.of_matrix));
            let has_fallen = last.is_some_and(|(before, was)| before == face && orientation.of_matrix < FALLEN * was);
            if has_fallen || orientation.determinant < rtol {
                // The sign within the tolerances of the states.
                for (i, atol) in atol.iter().enumerate() {
                    for sign in [-1.0, 1.0] {
                        let mut moved = y.clone();
                        moved[i] += sign * (atol + rtol * y[i].abs());
                        let moved = of(&moved).filter(|moved| moved.determinant < found.determinant);
                        found = moved.unwrap_or(found);
                    }
                }
            }
        }
        if found.has_other_solutions() {
            self.found = Some((t, found.determinant));
        }
    }

    /// Records the doubt if other solutions were found.
    pub(super) fn finish(&self, diagnostics: &mut Diagnostics) {
        let Some((t, determinant)) = self.found else { return };
        diagnostics.checks.record(CheckCode::OtherSolutions, -determinant, 0.0, || {
            format!(
                "at t = {t} other solutions exist: within the tolerances of the states the determinant of CB (or G_z) on the \
                 active face, relative to its terms, is {determinant:.1e}, and of a unique solution it is not negative; a \
                 solution may leave the face at any time, and the program selects when this one does"
            )
        });
    }
}
