//! The [breakpoints](hybrid::Breaks) of a run: a step ends before each of them, and the next step begins behind it on
//! a newly determined face of `K`.

use super::settings::{StepError, Switches};
use super::stepper::Radau;

/// Maximum number of breakpoints up to the end of a run: more cannot be passed within any limit on the number of
/// steps.
const MOST_BREAKS: f64 = 1e9;

impl Radau<'_> {
    /// Cuts a step of size `h` at the first breakpoint of the rows within it and returns its size.
    pub(super) fn up_to_break(&mut self, h: f64) -> f64 {
        if self.settings.switches == Switches::StepOver {
            return h;
        }
        self.breaks.up_to_break(self.system.problem(), self.clock.t, h)
    }

    /// Returns the part of a step of size `h` before the next breakpoint: a probe (trial) step that begins at the
    /// present time must not evaluate the rows behind the breakpoint.
    pub(super) fn before_break(&mut self, h: f64) -> f64 {
        if self.settings.switches == Switches::StepOver {
            return h;
        }
        self.breaks.part_before(self.system.problem(), self.clock.t, h)
    }

    /// Restarts the run behind a breakpoint, from time `after`.
    ///
    /// # Errors
    /// If the variational inequality has no solution at that time, or breakpoints are so dense that the end is out of reach.
    pub(super) fn pass_break(&mut self, after: f64) -> Result<(), StepError> {
        self.breaks.pass(after);
        self.clock.set(after);
        if let Some(distance) = self.breaks.mean_distance()
            && self.clock.remaining() > MOST_BREAKS * distance
        {
            return Err(StepError::DenseBreaks { t: after, distance });
        }
        self.restart();
        self.switching.remember(&self.system.face);
        let at = self.breaks.at();
        self.start(at)?;
        self.clock.stay();
        self.switching.record(at, &self.system.set, &self.system.face, &[]);
        Ok(())
    }
}
