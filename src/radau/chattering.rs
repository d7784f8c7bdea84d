//! Chattering: where a rate jumps as the sign of a state changes, as `-sign(x)` does, and drives the states back to the jump
//! from either side, the solution in the sense of Filippov slides along it. Steps cannot: they cross it to and fro, each as
//! short as the error test wants, and a run of any length would end in millions of them.
//!
//! A kink is one of the quantities of [`Dvi::kinks`](problem::Dvi::kinks). Steps chatter across it if it has changed its
//! sign [`CROSSINGS`] times with few steps in between, if the rates on either side drive it towards zero, which is the
//! condition for sliding (Filippov 1988, section 4), and if the jump is large enough for the error test to feel it.

use super::settings::StepError;
use super::stepper::Radau;

/// Changes of sign that are taken for chattering; a solution that passes a jump makes one.
const CROSSINGS: u32 = 64;

/// The most steps between two of them: behind a jump steps grow eightfold at a time until they are across it again, and some are
/// rejected on the way.
const IDLE: u32 = 64;

/// How far from a kink steps may have collapsed, in tolerances of the states.
const NEAR: f64 = 100.0;

/// The least change of the states over a step, in tolerances, that a jump must make: it is one where the error test limits
/// the steps, but for the constant of the method.
const FELT: f64 = 1e-2;

/// The least jump of a rate, of its size on either side, that steps can collapse at.
const SHARP: f64 = 1e-2;

/// How near to a kink the rates on either side are compared, of the distance of the states.
const NARROW: f64 = 1e-3;

/// The recent changes of sign of the kinks.
#[derive(Debug, Default)]
pub(super) struct Chattering {
    streaks: Vec<Streak>,
    gradient: Vec<(usize, f64)>,
}

/// Changes of sign that follow each other closely.
#[derive(Clone, Copy, Debug, Default)]
struct Streak {
    is_positive: bool,
    crossings: u32,
    /// Steps since the last.
    idle: u32,
    /// The longest step since the first.
    longest: f64,
}

/// What crossing a kink changes.
struct Jump {
    /// The size of the kink that errors of one tolerance in all states make.
    noise: f64,
    /// The largest change of a rate, in tolerances of the state.
    size: f64,
    /// Whether the rates on either side drive the kink towards zero.
    attracts: bool,
    /// The largest change of a rate, of its size.
    relative: f64,
}

impl Radau<'_> {
    /// Takes the end of a step into account.
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

    /// The kink at which steps have become too small to go on, if it is one.
    pub(super) fn collapsed_at(&mut self) -> Option<usize> {
        let values = self.system.problem().kinks(self.clock.t, &self.y).to_vec();
        let found = (0..values.len()).find(|&kink| {
            self.jump_across(kink).is_some_and(|jump| values[kink].abs() <= NEAR * jump.noise && jump.relative >= SHARP)
        });
        self.system.evaluate(self.clock.t, &self.y);
        found
    }

    /// What crossing a kink here would change: the second difference of the rates over three points, one of them beyond
    /// it, close together beside where the states are. What is smooth leaves nothing in it, and a mere kink hardly more.
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
