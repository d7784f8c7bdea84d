//! Steps across a switch that was not located, with the variational inequality coupled over the stages: a bound on
//! the change of the states that would follow if the switch were anywhere else in the step.

use super::stepper::Radau;

/// Admissible change of a state by a switch that is not located, in tolerances.
const ALLOWED: f64 = 1.0;
/// A step four times shorter must reduce the change of the states by a switch that is not located to this fraction or
/// less; otherwise the states jump at the switch.
const GAIN: f64 = 0.5;

/// Time from the beginning of a step, relative to that of the first stage, from which variables are extrapolated to
/// the first stage: the fourth root of the rounding unit, so that the difference of the variables keeps three
/// quarters of its digits, and curvature is negligible.
const BESIDE: f64 = 1e-4;

/// Maximum number of attempts at one step at which Newton's method fails on the active face of `K`, and which are
/// then shortened to a quarter if the switch may change a state by too much; after more failures the step is accepted
/// with its switch unlocated.
const MOST_UNFOLLOWED: u32 = 4;

/// Maximum number of attempts at one step that are shortened because of an event between the stages: each is at most
/// half as long as the one before, so that the last is shorter by three orders of magnitude. If every attempt shows
/// an event, switches accumulate.
const MOST_CUT: u32 = 10;

/// Attempts at one step that were shortened because of a switch within it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shortened {
    last: Option<f64>,
    /// Number of attempts to make the present step in which Newton's method failed on the active face of `K`.
    unfollowed: u32,
    /// Number of attempts to make the present step that were shortened because of an event between the stages.
    cut: u32,
}

impl Shortened {
    /// Whether to shorten a step within which a switch that was not located may change a state by `unlocated` times its
    /// tolerance.
    pub fn is_too_long(&mut self, unlocated: Option<f64>) -> bool {
        let Some(distance) = unlocated.filter(|distance| *distance > ALLOWED) else { return false };
        // If Newton's method solved the stages on the active face, but the end of that face within the step was not
        // found, switches accumulate: every shorter step contains further switches.
        if !(1..=MOST_UNFOLLOWED).contains(&self.unfollowed) {
            return false;
        }
        distance < self.last.replace(distance).map_or(f64::INFINITY, |last| GAIN * last)
    }

    /// Whether to shorten a step once more because of an event between its stages.
    pub fn may_cut(&mut self) -> bool {
        self.cut += 1;
        self.cut <= MOST_CUT
    }

    /// Records an attempt to make the present step in which Newton's method failed on the active face of `K`.
    pub fn unfollowed(&mut self) {
        self.unfollowed += 1;
    }
}

impl Radau<'_> {
    /// Returns the largest change of a state, in units of its tolerance, that would follow if a switch within a step
    /// of size `h` were anywhere else in the step: `h max_ij |F_z (z_i - z_j)| / M` over the stages `i, j`, which are
    /// solved with the variational inequality, and points on the face before the switch. `None` if switches are not
    /// to be located, or the step has none.
    pub(super) fn unlocated(&mut self, h: f64) -> Option<f64> {
        if !self.switching.is_to_locate() || self.switching.before.is_same(&self.system.face) {
            return None;
        }
        let (n, unknowns) = (self.system.states, self.system.unknowns);
        let begin = self.variables_before(h);
        let mut worst = 0.0_f64;
        for state in (0..n).filter(|&state| self.system.mass_diagonal[state] != 0.0) {
            let along = || self.system.entries_of_row(state).filter(|&(j, _)| j >= n);
            let at_begin = begin.iter().map(|y| along().map(|(j, value)| value * y[j]).sum::<f64>());
            let increments = self.stages.z[..self.tableau().stages() * unknowns].chunks_exact(unknowns);
            let at_stages = increments.map(|z| along().map(|(j, value)| value * (self.y[j] + z[j])).sum::<f64>());
            let rates = at_begin.chain(at_stages);
            let (lo, hi) =
                rates.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), rate| (lo.min(rate), hi.max(rate)));
            let allowed =
                self.settings.atol[state] + self.settings.rtol * self.extent.largest[state].max(self.y[state].abs());
            let mass = self.system.mass_diagonal[state].abs();
            worst = worst.max(h * (hi - lo) / (mass * allowed.max(f64::MIN_POSITIVE)));
        }
        Some(worst)
    }

    /// Returns variables that are consistent with the states on the face before the switch: at the beginning of a
    /// step of size `h`, halfway to its first stage, and extrapolated from the beginning to the first stage. On a
    /// face that has just begun, variables may grow before the first stage, and be back at zero at that stage.
    fn variables_before(&mut self, h: f64) -> [Vec<f64>; 3] {
        let first = self.tableau().c[0];
        std::mem::swap(&mut self.system.face, &mut self.switching.before);
        let mut on_face = |theta: f64| {
            self.polynomial_at(theta);
            let mut y = self.switching.scratch.clone();
            if let Some(consistent) = &mut self.consistent {
                consistent.solve(&mut self.system, &self.control, self.clock.t + theta * h, &mut y);
            }
            y
        };
        let (mut begin, mut halfway, mut further) = (on_face(0.0), on_face(0.5 * first), on_face(BESIDE * first));
        further.iter_mut().zip(&begin).for_each(|(further, begin)| *further = begin + (*further - begin) / BESIDE);
        // On a face that has ended, consistent variables may lie outside `K`; those of the solution do not.
        [&mut begin, &mut halfway, &mut further].into_iter().for_each(|y| self.system.project(y));
        std::mem::swap(&mut self.system.face, &mut self.switching.before);
        [begin, halfway, further]
    }

    /// Returns the largest change of a state, in tolerances, that would follow if the switch (change of the active face
    /// of `K`) within the last step were anywhere else in the step; `None` if there was no switch, or it was located.
    pub fn unlocated_switch(&self) -> Option<f64> {
        self.last.unlocated
    }
}
