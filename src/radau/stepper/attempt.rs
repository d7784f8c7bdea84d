//! The stages of one step: on the present face up to the end of that face, or with the variational inequality coupled
//! over all stages if no face is found to continue on.

use super::Radau;
use crate::location::EventTime;
use crate::screening::{Between, LEAST};
use crate::settings::{RejectionCause, StepError};
use crate::stages::{Contraction, Newton};

/// Maximum number of halvings of a step along a curved face, before its stages are solved without the face.
const HALVINGS: usize = 12;
/// Maximum number of halvings of a step whose end of face cannot be located, before its stages are solved without the
/// face.
const SEARCHES: usize = 4;

/// Result of an attempt at a step.
pub(super) enum Attempt {
    /// The stages are solved, on one face or `coupled` over the stages; `between` is the result of screening between
    /// them.
    Solved { h: f64, iterations: usize, coupled: bool, between: Option<Between> },
    /// The step is to be repeated with its size multiplied by this factor, for this cause.
    Failed(f64, RejectionCause),
}

impl Radau<'_> {
    /// Solves the stages of a step of size `h`, or of the shorter one that ends at a switch.
    pub(super) fn attempt(&mut self, h: f64) -> Result<Attempt, StepError> {
        let mut size = h;
        let mut may_turn = true;
        self.screened_short = false;
        let (mut missed, mut proven) = (None, 0.0);
        let mut searches = if self.settings.step.is_some() { 0 } else { SEARCHES };
        for _ in 0..=self.system.bounded.len() + HALVINGS {
            // Stop at a step too small to advance the time.
            if size < h && !self.clock.resolves(size) {
                break;
            }
            self.prepare(size)?;
            self.predict(size);
            let (located, iterations) = match self.newton(size) {
                Newton::Converged { iterations, violated } => {
                    let violated = violated && self.is_violated_within(size, None);
                    let between = if violated || self.stage_vi.is_none() { None } else { Some(self.screen(size)) };
                    let violation = between.and_then(Between::violation).filter(|_| self.switching.locates());
                    if let Some(Between::ProvenUpTo(theta)) = between
                        && self.settings.step.is_none()
                        && self.switching.locates()
                    {
                        size *= theta;
                        self.screened_short = true;
                        continue;
                    }
                    if !violated && violation.is_none() {
                        return Ok(Attempt::Solved { h: size, iterations, coupled: false, between });
                    }
                    missed = between;
                    proven = violation.map_or(0.0, |(_, proven)| proven);
                    let mut located = self.locate(size, violation.map(|(theta, _)| theta))?;
                    // If there are several switches within the step, its stages need not show the first.
                    if matches!(located, EventTime::Nowhere)
                        && violation.is_none()
                        && self.switching.locates()
                        && let Some(first) = self.first_violation(size)?
                    {
                        proven = first.1;
                        located = self.locate(size, Some(first.0))?;
                    }
                    (located, iterations)
                }
                Newton::Slow(factor) if self.stage_vi.is_none() => {
                    return Ok(Attempt::Failed(factor, RejectionCause::Slow));
                }
                Newton::Failed(cause) if self.stage_vi.is_none() => return Ok(Attempt::Failed(0.5, cause)),
                // A curved face may end where it can no longer be followed: go up to that point.
                Newton::Slow(_) | Newton::Failed(_) if self.system.is_curved() && self.switching.locates() => {
                    if std::mem::take(&mut may_turn) && self.system.swap_primal_dual_form() {
                        self.factored = None;
                        continue;
                    }
                    self.predict(size);
                    match self.locate(size, None)? {
                        EventTime::Nowhere => {
                            size *= 0.5;
                            continue;
                        }
                        located => (located, self.control.most),
                    }
                }
                Newton::Slow(_) | Newton::Failed(_) => {
                    self.shortened.unfollowed();
                    break;
                }
            };
            match located {
                EventTime::At { h, between } => {
                    return Ok(Attempt::Solved { h, iterations, coupled: false, between: Some(between) });
                }
                EventTime::Now => {}
                EventTime::Behind(part) => {
                    size *= part;
                    self.screened_short = true;
                }
                // The step is proven up to shortly before the violation.
                EventTime::Nowhere if proven >= LEAST && self.settings.step.is_none() && self.switching.locates() => {
                    size *= std::mem::take(&mut proven);
                    self.screened_short = true;
                }
                EventTime::Nowhere if searches > 0 && self.switching.locates() => {
                    searches -= 1;
                    size *= 0.5;
                }
                EventTime::Nowhere => break,
            }
        }
        self.predict(h);
        Ok(self.couple(h, missed))
    }

    /// The point at which screening first detects a violation in a step of size `h`, and the point up to which it
    /// proves that there is none. The stages are solved again.
    fn first_violation(&mut self, h: f64) -> Result<Option<(f64, f64)>, StepError> {
        self.prepare(h)?;
        self.predict(h);
        if !matches!(self.newton(h), Newton::Converged { .. }) {
            return Ok(None);
        }
        Ok(self.screen(h).violation())
    }

    /// Newton's method on the present face.
    pub(crate) fn newton(&mut self, h: f64) -> Newton {
        let tableau = self.tableau();
        let newton = self.stages.newton(
            &mut self.system,
            tableau,
            &mut self.factors,
            self.clock.t,
            h,
            &self.y,
            &self.control,
            &mut self.contraction,
        );
        match newton {
            Newton::Converged { .. } if !self.are_stages_solved(h) => Newton::Failed(RejectionCause::Diverged),
            newton => newton,
        }
    }

    /// Solves the stages with the VI coupled over them, starting from their present increments; `missed` is a violation
    /// already detected between them.
    fn couple(&mut self, h: f64, missed: Option<Between>) -> Attempt {
        let tableau = self.tableau();
        let Some(stage_vi) = &mut self.stage_vi else { return Attempt::Failed(0.5, RejectionCause::Unsolved) };
        self.contraction = Contraction::default();
        self.switching.remember(&self.system.face);
        match stage_vi.solve(&mut self.system, tableau, &mut self.stages, self.clock.t, h, &self.y, &self.control) {
            Ok(()) if !self.are_stages_solved(h) => {
                self.system.face.clone_from(&self.switching.before);
                Attempt::Failed(0.5, RejectionCause::Diverged)
            }
            Ok(()) => {
                // A step on a single face is like any other, but may have crossed switches that no stage shows: screen
                // it, unless switches accumulate, where the whole accumulation is assessed instead.
                let is_one_face = self.system.face.is_same(&self.switching.before);
                let is_alone = self.switching.locates() && self.accumulations() == 0;
                let is_screened = is_one_face && is_alone && self.settings.step.is_none();
                let between = missed.or_else(|| is_screened.then(|| self.screen(h)));
                Attempt::Solved { h, iterations: self.control.most, coupled: true, between }
            }
            Err(cause) => Attempt::Failed(0.5, cause),
        }
    }
}
