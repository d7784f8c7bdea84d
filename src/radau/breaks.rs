//! Breaks: the times at which a rate, a `G` or a bound has a kink or a jump whatever the states are, as one with
//! `heaviside(t - 1)` has. A step across one would be of order one, and one longer than a pulse need not see it at all.
//!
//! What changes its sign there is sampled over the step; its first change is bisected down to rounding. The step ends on
//! the last number before it, and the next begins, with a face of its own, on the first after it.

use super::settings::{StepError, Switches};
use super::stepper::Radau;

/// Samples a step. No step is longer than twice the time between the last two breaks, or since the last: periodic
/// forcing is sampled eight times between two of its breaks.
const SAMPLES: u32 = 16;

/// What is remembered of breaks.
#[derive(Debug)]
pub(super) struct Breaks {
    signs: Vec<bool>,
    /// The last break or the start, and the time to it from the one before.
    last: f64,
    gap: f64,
    /// The first number after the break that the step at hand ends before.
    pub(super) after: Option<f64>,
}

impl Breaks {
    /// For a run that starts at `t`.
    pub(super) fn new(t: f64) -> Self {
        Self { signs: Vec::new(), last: t, gap: f64::INFINITY, after: None }
    }
}

impl Radau<'_> {
    /// The part of a step of size `h` up to the first break.
    pub(super) fn up_to_break(&mut self, h: f64) -> f64 {
        self.breaks.after = None;
        if self.settings.switches == Switches::StepOver || self.system.problem().breaks(self.t).is_empty() {
            return h;
        }
        let h = h.min(2.0 * self.breaks.gap.max(self.t - self.breaks.last));
        let signs = self.system.problem().breaks(self.t).iter().map(|value| *value >= 0.0);
        self.breaks.signs.clear();
        self.breaks.signs.extend(signs);
        let mut left = self.t;
        for sample in 1..=SAMPLES {
            let right = self.t + h * f64::from(sample) / f64::from(SAMPLES);
            if self.has_broken(right) {
                let (before, after) = self.bisect(left, right, h);
                self.breaks.after = Some(after);
                return before - self.t;
            }
            left = right;
        }
        h
    }

    fn has_broken(&mut self, t: f64) -> bool {
        let values = self.system.problem().breaks(t).iter();
        values.zip(&self.breaks.signs).any(|(value, sign)| (*value >= 0.0) != *sign)
    }

    /// The numbers before and after the first break between two times.
    fn bisect(&mut self, mut before: f64, mut after: f64, h: f64) -> (f64, f64) {
        loop {
            let middle = before + 0.5 * (after - before);
            if middle <= before || middle >= after || after - before <= f64::EPSILON * h {
                return (before, after);
            }
            if self.has_broken(middle) { after = middle } else { before = middle }
        }
    }

    /// Begins anew behind a break.
    ///
    /// # Errors
    /// If the variational inequality has no solution there.
    pub(super) fn pass_break(&mut self, after: f64) -> Result<(), StepError> {
        let gap = after - self.breaks.last;
        // Two quantities that change at one time are one break, but for rounding.
        if gap > 1e3 * f64::EPSILON * after.abs() {
            self.breaks.gap = gap;
        }
        self.breaks.last = after;
        (self.t, self.lag) = (after, 0.0);
        self.restart();
        self.switching.remember(&self.system.face);
        self.start()?;
        self.switching.record(self.t, &self.system.set, &self.system.face, &[]);
        Ok(())
    }
}
