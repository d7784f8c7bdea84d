//! Steps without progress: each is cut, or follows rejections, and changes the states by less than Newton's method
//! resolves. No test of a step detects its errors then, and if a solution ends, for instance because a force grows
//! without bound, a run could continue past the end with such steps.

use super::settings::{RejectionCause, StepError};
use super::stepper::Radau;

/// A step shorter than this fraction of the attempted step size counts as cut, and so as one without progress.
pub(super) const SHORT: f64 = 0.75;

/// Number of successive steps without progress (short steps over which the states hardly change) before a run fails; a
/// few such steps are normal behind a switch or a breakpoint.
const MOST: u32 = 256;

/// Number of successive steps without progress, and the cause of the last rejection of a step.
#[derive(Clone, Debug, Default)]
pub(super) struct Progress {
    count: u32,
    cause: Option<RejectionCause>,
    was_rejected: bool,
}

impl Progress {
    /// Records that an attempt at a step was rejected, and why.
    pub(super) fn rejected(&mut self, cause: RejectionCause) {
        self.cause = Some(cause);
        self.was_rejected = true;
    }
}

impl Radau<'_> {
    /// Records an accepted step of size `h`; `is_short` tells that longer steps were attempted.
    ///
    /// # Errors
    /// If the steps are too small for progress, with the cause.
    pub(super) fn watch_progress(&mut self, h: f64, is_short: bool) -> Result<(), StepError> {
        let is_hindered = std::mem::take(&mut self.progress.was_rejected) || is_short;
        if !is_hindered || self.change(h) > self.control.kappa {
            self.progress.count = 0;
            return Ok(());
        }
        self.progress.count += 1;
        if self.progress.count < MOST {
            return Ok(());
        }
        let cause = self.progress.cause.unwrap_or(RejectionCause::Slow);
        self.check_evaluation()?;
        self.check_contradiction(cause)?;
        Err(StepError::StepTooSmall { t: self.clock.t, h, least: 0.0, cause })
    }

    /// Returns the largest change of a state over a step of size `h`, in tolerances, that a single term of its rate
    /// could make: at rest, terms may cancel.
    fn change(&mut self, h: f64) -> f64 {
        let n = self.system.states;
        if !self.system.evaluate(self.clock.t, &self.y) {
            return 0.0;
        }
        let mut free: Vec<f64> = self.system.values[..n].to_vec();
        let mut largest = vec![0.0_f64; n];
        for (i, j, value) in self.system.entries().filter(|&(i, j, _)| i < n && j >= n) {
            let term = value * self.y[j];
            free[i] -= term;
            largest[i] = largest[i].max(term.abs());
        }
        let of_state = |i: usize| {
            let mass = self.system.mass_diagonal[i].abs();
            let term = largest[i].max(free[i].abs());
            if mass == 0.0 { 0.0 } else { h * term / mass * self.control.weight[i] }
        };
        (0..n).map(of_state).fold(0.0, f64::max)
    }
}
