//! Steps that come nowhere: each is found shorter than it was tried, or after rejections, and over it the states change by less
//! than what Newton's method lets pass. Then nothing that a step might do wrong is seen by any test of it, and where a solution
//! ends, as one whose force grows beyond all bounds does, a run could go on over the end with steps as short as that.

use super::settings::{RejectionCause, StepError};
use super::stepper::Radau;

/// A step that is shorter than this part of what was tried was cut.
pub(super) const SHORT: f64 = 0.75;

/// Such steps in a row before a run fails. Behind a switch or a break a few are made.
const MOST: u32 = 256;

/// The steps in a row that came nowhere, and what the last rejection was for.
#[derive(Debug, Default)]
pub(super) struct Progress {
    count: u32,
    cause: Option<RejectionCause>,
    was_rejected: bool,
}

impl Progress {
    /// Takes a rejection into account.
    pub(super) fn rejected(&mut self, cause: RejectionCause) {
        self.cause = Some(cause);
        self.was_rejected = true;
    }
}

impl Radau<'_> {
    /// Takes an accepted step of size `h` into account; `is_short` says that longer ones were tried.
    ///
    /// # Errors
    /// That the steps are too small to come anywhere, and why.
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

    /// The largest change of a state over a step of size `h` that a term of its rate makes, in tolerances: at rest, terms may
    /// cancel.
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
