//! Chattering: if a rate jumps with the sign of a state, as `-sign(x)` does, and drives the states back to the jump
//! from either side, the solution in the sense of Filippov slides along the jump. Steps cannot follow it: they cross
//! the jump back and forth, each as short as the error test requires, and a run of any length would take millions of
//! them.
//!
//! A kink is one of the quantities of [`Dvi::kinks`](problem::Dvi::kinks). Steps chatter across it if it has changed
//! sign [`CROSSINGS`] times with few steps in between, if the rates on either side drive it towards zero, which is the
//! condition for sliding (Filippov 1988, section 4), and if the jump is large enough to affect the error test.

use super::settings::StepError;
use super::stepper::Radau;

/// Number of sign changes of one kink in close succession that count as chattering (sliding along a jump of the rates);
/// a solution that passes a jump makes one.
const CROSSINGS: u32 = 64;

/// Maximum number of steps between two sign changes of a kink that count as chattering: behind a jump, steps grow
/// eightfold at a time until they cross it again, and some are rejected on the way.
const IDLE: u32 = 64;

/// Largest distance from a kink, in tolerances of the states, at which the kink may be the cause of vanishing step
/// sizes.
const NEAR: f64 = 100.0;

/// Least change of the states over a step, in tolerances, that a jump of the rates must cause to count as chattering:
/// where the error test limits the steps, the change is one, up to the constant of the method.
const FELT: f64 = 1e-2;

/// Least jump of a rate across a kink, relative to the rate on either side, that can make step sizes vanish.
const SHARP: f64 = 1e-2;

/// Distance from a kink (zero of a function at which rates may jump) at which the rates on either side are compared,
/// relative to the distance of the present states from the kink.
const NARROW: f64 = 1e-3;

/// Recent sign changes of the functions whose zeros mark kinks of the rates.
#[derive(Clone, Debug, Default)]
pub(super) struct Chattering {
    streaks: Vec<Streak>,
    gradient: Vec<(usize, f64)>,
}

/// Sign changes of the function whose zero marks one kink, in close succession.
#[derive(Clone, Copy, Debug, Default)]
struct Streak {
    is_positive: bool,
    crossings: u32,
    /// Number of steps since the last sign change of the kink.
    idle: u32,
    /// Size of the longest step since the first sign change of the kink.
    longest: f64,
}

/// Jump of the rates across a kink.
struct Jump {
    /// Change of the function whose zero marks the kink, for errors of one tolerance in all states.
    noise: f64,
    /// Largest jump of a rate across the kink, in tolerances of its state.
    size: f64,
    /// Whether the rates on either side drive the function whose zero marks the kink towards zero.
    attracts: bool,
    /// Largest jump of a rate across the kink, relative to the rate.
    relative: f64,
}

impl Radau<'_> {
    /// Records the end of a step, and fails if the steps chatter across a kink.
    ///
    /// # Errors
    /// [`StepError::Chattering`].
    pub(super) fn watch_kinks(&mut self) -> Result<(), StepError> {
        let values = self.system.problem().kinks(self.clock.t, &self.y);
        if values.is_empty() || self.settings.step.is_some() {
            return Ok(());
        }
        let streaks = &mut self.chattering.streaks;
        streaks.resize(values.len(), Streak::default());
        let mut suspect = None;
        for (kink, (streak, &value)) in streaks.iter_mut().zip(values).enumerate() {
            streak.observe(value, self.last.h);
            if streak.crossings >= CROSSINGS {
                suspect = Some((kink, streak.longest));
                *streak = Streak { is_positive: streak.is_positive, ..Streak::default() };
            }
        }
        let Some((kink, longest)) = suspect else { return Ok(()) };
        match self.jump_across(kink) {
            Some(Jump { size, attracts: true, .. }) if longest * size >= FELT => {
                Err(StepError::Chattering { t: self.clock.t, kink })
            }
            _ => Ok(()),
        }
    }

    /// Returns the index of the kink at which step sizes have become too small to continue, if a kink is the cause.
    pub(super) fn collapsed_at(&mut self) -> Option<usize> {
        let values = self.system.problem().kinks(self.clock.t, &self.y).to_vec();
        let found = (0..values.len()).find(|&kink| {
            self.jump_across(kink).is_some_and(|jump| values[kink].abs() <= NEAR * jump.noise && jump.relative >= SHARP)
        });
        self.system.evaluate(self.clock.t, &self.y);
        found
    }

    /// Returns the change of the rates across a kink near the present states: the second difference of the rates over
    /// three points that are close together, one of them beyond the kink. The second difference nearly vanishes for
    /// smooth rates, and for a kink without a jump.
    fn jump_across(&mut self, kink: usize) -> Option<Jump> {
        let n = self.system.states;
        let value = *self.system.problem().kinks(self.clock.t, &self.y).get(kink)?;
        let mut gradient = std::mem::take(&mut self.chattering.gradient);
        self.system.problem().kink_gradient(kink, self.clock.t, &self.y, &mut gradient);
        gradient.retain(|&(j, _)| j < n);
        let tolerance = |j: usize| 1.0 / self.control.weight[j];
        let noise = gradient.iter().map(|&(j, slope)| (slope * tolerance(j)).powi(2)).sum::<f64>().sqrt();
        let distance = NARROW * if value == 0.0 { noise } else { value };
        let mut rows = [3.0, 1.0, -1.0].map(|side| {
            let mut y = self.y.clone();
            for &(j, slope) in &gradient {
                y[j] += (side * distance - value) * slope * (tolerance(j) / noise).powi(2);
            }
            self.system.evaluate(self.clock.t, &y).then(|| self.system.values[..n].to_vec())
        });
        self.chattering.gradient = gradient;
        self.system.evaluate(self.clock.t, &self.y);
        let [Some(before), Some(here), Some(beyond)] = rows.each_mut().map(Option::take) else { return None };
        let (mut size, mut relative) = (0.0_f64, 0.0_f64);
        for j in 0..n {
            let jump = (before[j] - 2.0 * here[j] + beyond[j]).abs();
            let mass = self.system.mass_diagonal[j];
            if mass != 0.0 {
                size = size.max(jump / mass.abs() * self.control.weight[j]);
            }
            relative = relative.max(if jump == 0.0 { 0.0 } else { jump / here[j].abs().max(beyond[j].abs()) });
        }
        let h = self.last.h;
        let later = *self.system.problem().kinks(self.clock.t + h, &self.y).get(kink)?;
        let drift = (later - value) / h;
        let mass = &self.system.mass_diagonal;
        let speed = |rates: &[f64]| {
            let terms = self.chattering.gradient.iter().filter(|(j, _)| mass[*j] != 0.0);
            drift + terms.map(|&(j, slope)| slope * rates[j] / mass[j]).sum::<f64>()
        };
        let attracts = speed(&here) * distance < 0.0 && speed(&beyond) * distance > 0.0;
        (noise > 0.0 && noise.is_finite()).then_some(Jump { noise, size, attracts, relative })
    }
}

impl Streak {
    fn observe(&mut self, value: f64, step: f64) {
        let is_positive = value >= 0.0;
        if is_positive == self.is_positive {
            self.idle += 1;
            if self.idle > IDLE {
                *self = Self { is_positive, ..Self::default() };
            }
        } else {
            (self.is_positive, self.idle) = (is_positive, 0);
            self.crossings += 1;
        }
        self.longest = self.longest.max(step);
    }
}
