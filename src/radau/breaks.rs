//! The [breaks](hybrid::Breaks) of a run: a step ends before one, and the next begins behind it with a face of its own.

use super::settings::{StepError, Switches};
use super::stepper::Radau;

impl Radau<'_> {
    /// The part of a step of size `h` up to the first break.
    pub(super) fn up_to_break(&mut self, h: f64) -> f64 {
        if self.settings.switches == Switches::StepOver {
            return h;
        }
        self.breaks.up_to_break(self.system.problem(), self.clock.t, h)
    }

    /// Begins anew behind a break.
    ///
    /// # Errors
    /// If the variational inequality has no solution there.
    pub(super) fn pass_break(&mut self, after: f64) -> Result<(), StepError> {
        self.breaks.pass(after);
        self.clock.set(after);
        self.restart();
        self.switching.remember(&self.system.face);
        self.start()?;
        self.switching.record(self.clock.t, &self.system.set, &self.system.face, &[]);
        Ok(())
    }
}
