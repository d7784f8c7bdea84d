//! A step whose stages were solved with the variational inequality coupled over them, across a switch that was not
//! located: by how much the states would differ had the switch been anywhere else in the step.

use super::stepper::Radau;

/// The tolerances by which a switch that is not located may change a state.
const ALLOWED: f64 = 1.0;
/// A step that was made four times shorter must bring its switch nearer by this at least: else the states jump.
const GAIN: f64 = 0.5;

/// A face that cannot be followed over a step four times shorter, as often as this, is no face to go on with.
const MOST_UNFOLLOWED: u32 = 4;

/// The attempts at one step that a switch within it made shorter.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shortened {
    last: Option<f64>,
    /// The attempts for which Newton's method could not follow the face.
    unfollowed: u32,
}

impl Shortened {
    /// Whether a step within which a switch may change a state by this many tolerances is to be made shorter.
    pub fn is_too_long(&mut self, unlocated: Option<f64>) -> bool {
        let Some(distance) = unlocated.filter(|distance| *distance > ALLOWED) else { return false };
        // Where the face was followed past its end, and its end was not found, switches accumulate: there are more in any step.
        if !(1..=MOST_UNFOLLOWED).contains(&self.unfollowed) {
            return false;
        }
        distance < self.last.replace(distance).map_or(f64::INFINITY, |last| GAIN * last)
    }

    /// Takes an accepted step into account.
    pub fn accepted(&mut self) {
        *self = Self::default();
    }

    /// Takes an attempt into account for which Newton's method could not follow the face.
    pub fn unfollowed(&mut self) {
        self.unfollowed += 1;
    }
}

impl Radau<'_> {
    /// The largest `h max_ij |B (z_i - z_j)| / M` of a state over the stages `i, j` of a step of size `h` whose stages are
    /// solved with the VI, in units of its tolerance; `None` where switches are not to be located, or the step has none.
    pub(super) fn unlocated(&mut self, h: f64) -> Option<f64> {
        if !self.switching.is_to_locate() || self.switching.before.is_same(&self.system.face) {
            return None;
        }
        let (n, unknowns) = (self.system.states, self.system.unknowns);
        // The variables at the beginning that belong to the states on the face that was left.
        let mut begin = self.y.clone();
        std::mem::swap(&mut self.system.face, &mut self.switching.before);
        if let Some(consistent) = &mut self.consistent {
            consistent.solve(&mut self.system, &self.control, self.clock.t, &mut begin);
        }
        // On a face that has ended they may have left `K`, which the solution does not.
        self.system.project(&mut begin);
        std::mem::swap(&mut self.system.face, &mut self.switching.before);
        let mut worst = 0.0_f64;
        for state in (0..n).filter(|&state| self.system.mass_diagonal[state] != 0.0) {
            let rate = |increments: Option<&[f64]>| -> f64 {
                let along = self.system.entries_of_row(state).filter(|&(j, _)| j >= n);
                along.map(|(j, value)| value * increments.map_or(begin[j], |z| self.y[j] + z[j])).sum()
            };
            let rates =
                (0..self.tableau().stages()).map(|i| rate(Some(&self.stages.z[i * unknowns..(i + 1) * unknowns])));
            let (lo, hi) = rates.fold((rate(None), rate(None)), |(lo, hi), rate| (lo.min(rate), hi.max(rate)));
            let allowed =
                self.settings.atol[state] + self.settings.rtol * self.extent.largest[state].max(self.y[state].abs());
            let mass = self.system.mass_diagonal[state].abs();
            worst = worst.max(h * (hi - lo) / (mass * allowed.max(f64::MIN_POSITIVE)));
        }
        Some(worst)
    }

    /// By how many tolerances a state would differ, had the switch within the last step been anywhere else in it; `None`
    /// where there was none, or it was located.
    pub fn unlocated_switch(&self) -> Option<f64> {
        self.last.unlocated
    }
}
