//! One step of the automaton whose modes are the faces of `K`: on the present face up to the end of that face, or with
//! the variational inequality coupled over all stages if no face is found to continue on.

use super::{Freshness, Radau};
use crate::coupled::Shortened;
use crate::location::EventTime;
use crate::progress::SHORT;
use crate::screening::{Between, LEAST, UNRESOLVED};
use crate::settings::{RejectionCause, Settings, StepError};
use crate::stages::{Contraction, Newton, THETA};
use crate::start::LONGER_GAP;
use hybrid::{Automaton, Located, Proposal, Screened, Solved};

/// Maximum number of halvings of a step on a curved face of `K` at which Newton's method fails, before the stages are
/// solved with the variational inequality coupled over all of them.
const HALVINGS: usize = 12;
/// Maximum number of halvings of a step in which the active face of `K` ends at a point that cannot be located,
/// before the stages are solved with the variational inequality coupled over all of them.
const SEARCHES: usize = 4;

/// Data kept over the attempts at one step of the run.
#[derive(Debug, Default)]
pub struct Attempts {
    /// The step size before, and after, the step was cut at a breakpoint of the rows.
    wished: f64,
    proposed: f64,
    /// Number of further solves of the stages that are allowed before a new step size is proposed.
    solves: usize,
    /// Number of further halvings that are allowed in the search for the end of the active face.
    searches: usize,
    /// Whether the equations on curved faces of `K` have been swapped between the forms solved for `z` and for `G`, for
    /// the proposed step size.
    has_turned: bool,
    /// Whether the step was shortened to the part over which screening proved that no monitor changes sign.
    is_proven_part: bool,
    /// Result of the last screening that did not prove the step free of switches, and the fraction of the step up to
    /// which it excludes violations of monitors.
    missed: Option<Between>,
    proven: f64,
    shortened: Shortened,
}

impl Attempts {
    /// Whether screening for switches showed that the proposed step is too long.
    fn is_screened(&self) -> bool {
        self.is_proven_part || self.missed.is_some()
    }
}

/// A step whose stages are solved, and that is not yet accepted.
#[derive(Clone, Copy, Debug)]
pub struct Trial {
    pub(super) h: f64,
    iterations: usize,
    /// Whether the variational inequality was solved coupled over all stages, instead of the equations of one active
    /// face.
    pub(super) coupled: bool,
    /// Whether all stages are on the active face that the step began on.
    pub(super) is_one_face: bool,
    /// Whether a monitor of the active face is violated at a stage.
    violated: bool,
    /// Whether the stages could be solved on the active face; otherwise the face ends within the step, at a point
    /// that is still to be located.
    is_followed: bool,
    pub(super) between: Option<Between>,
}

impl Trial {
    fn on_face(h: f64, iterations: usize) -> Self {
        Self { h, iterations, coupled: false, is_one_face: true, violated: false, is_followed: true, between: None }
    }
}

/// The event of the automaton: a switch (change of the active face of `K`) at the end of a step.
#[derive(Clone, Copy, Debug)]
pub struct AtSwitch;

/// The point between the stages at which a violation of a monitor (event function) was seen, as a fraction of the step;
/// `None` if a stage shows the violation.
type Hidden = Option<f64>;

impl Automaton for Radau<'_> {
    type Attempts = Attempts;
    type Step = Trial;
    type Violation = Hidden;
    type Event = AtSwitch;
    type Error = StepError;

    fn propose(&mut self, attempts: &mut Attempts) -> Result<Proposal, StepError> {
        // In an accumulation of switches (Zeno), steps are too short to gain from more stages.
        if self.switching.is_accumulating() && self.orders.take_fewest() {
            self.forget_order();
        }
        let remaining = self.clock.remaining();
        let Settings { step, min_step, max_step, .. } = self.settings;
        let mut h = step.unwrap_or(self.h.max(min_step)).min(max_step);
        // Behind switches that are too close to be located, steps grow from the time between these switches: a longer
        // step may pass all switches of the accumulation, and more.
        if step.is_none() && self.switching.is_accumulating() && self.last.h > 0.0 {
            h = h.min((LONGER_GAP * self.last.h).max(self.clock.rounding(0.0)).max(min_step));
        }
        if 1.000_1 * h >= remaining {
            h = remaining;
        } else if !self.clock.resolves(h) {
            return Err(StepError::StepTooSmall { t: self.clock.t, h, least: 0.0, cause: RejectionCause::Error });
        }
        let wished = h;
        h = self.up_to_break(h);
        if let Some(after) = self.breaks.after()
            && h <= 0.0
        {
            self.pass_break(after)?;
            return Ok(Proposal::Again);
        }
        *attempts = Attempts {
            wished,
            proposed: h,
            solves: self.system.bounded.len() + HALVINGS + 1,
            searches: if step.is_some() { 0 } else { SEARCHES },
            shortened: attempts.shortened,
            ..Attempts::default()
        };
        Ok(Proposal::Step(h))
    }

    fn solve(&mut self, h: f64, attempts: &mut Attempts) -> Result<Solved<Trial>, StepError> {
        // Give up the equations of the active face of `K` if the step is too small to advance the time.
        if attempts.solves == 0 || h < attempts.proposed && !self.clock.resolves(h) {
            return Ok(Solved::Lost);
        }
        attempts.solves -= 1;
        self.prepare(h)?;
        self.predict(h);
        match self.newton(h) {
            Newton::Converged { iterations, violated } => {
                Ok(Solved::Step(Trial { violated, ..Trial::on_face(h, iterations) }))
            }
            Newton::Slow(factor) if self.stage_vi.is_none() => self.fail(factor, RejectionCause::Slow, attempts),
            Newton::Failed(cause) if self.stage_vi.is_none() => self.fail(0.5, cause, attempts),
            // Behind the end of a curved face, its equations may have no solution: locate the point at which the face
            // ends.
            Newton::Slow(_) | Newton::Failed(_) if self.system.is_curved() && self.switching.locates() => {
                if !std::mem::replace(&mut attempts.has_turned, true) && self.system.swap_primal_dual_form() {
                    self.factored = None;
                    return Ok(Solved::Again);
                }
                self.predict(h);
                Ok(Solved::Step(Trial { is_followed: false, ..Trial::on_face(h, self.control.most) }))
            }
            // Screening has shown that the step of the proposed size is too long: do not return to that size.
            Newton::Slow(part) if h < attempts.proposed && attempts.is_screened() => {
                self.reject(h, part, RejectionCause::Slow)
            }
            Newton::Failed(cause) if h < attempts.proposed && attempts.is_screened() => self.reject(h, 0.5, cause),
            Newton::Slow(_) | Newton::Failed(_) => {
                attempts.shortened.unfollowed();
                Ok(Solved::Lost)
            }
        }
    }

    fn screen(&mut self, step: &mut Trial, attempts: &mut Attempts) -> Result<Screened<Hidden>, StepError> {
        if !step.is_followed {
            return Ok(Screened::Violated(None));
        }
        let h = step.h;
        let violated = step.violated && self.is_violated_within(h, None);
        let between = if violated || self.stage_vi.is_none() { None } else { Some(self.screen_step(h)) };
        let violation = between.and_then(Between::violation).filter(|_| self.switching.locates());
        match between {
            Some(Between::ProvenUpTo(theta)) if self.may_shorten() => {
                attempts.is_proven_part = true;
                return Ok(Screened::Shorter(theta * h));
            }
            Some(Between::Unresolved) if self.may_shorten() && attempts.searches > 0 => {
                attempts.searches -= 1;
                attempts.missed = between;
                return Ok(Screened::Shorter(UNRESOLVED * h));
            }
            _ => {}
        }
        if !violated && violation.is_none() {
            step.between = between;
            return Ok(Screened::Clear);
        }
        attempts.missed = between;
        attempts.proven = violation.map_or(0.0, |(_, proven)| proven);
        Ok(Screened::Violated(violation.map(|(theta, _)| theta)))
    }

    fn locate(
        &mut self,
        step: Trial,
        hidden: Hidden,
        attempts: &mut Attempts,
    ) -> Result<Located<Trial, AtSwitch>, StepError> {
        let size = step.h;
        let mut located = self.locate_switch(size, hidden)?;
        // If there are several switches within the step, its stages need not show the first of them.
        if matches!(located, EventTime::Nowhere)
            && step.is_followed
            && hidden.is_none()
            && self.switching.locates()
            && let Some(first) = self.first_violation(size)?
        {
            attempts.proven = first.1;
            located = self.locate_switch(size, Some(first.0))?;
        }
        Ok(match located {
            EventTime::At { h, between } => {
                Located::Ends(Trial { between: Some(between), ..Trial::on_face(h, step.iterations) }, Some(AtSwitch))
            }
            EventTime::Now => Located::Retry(size),
            EventTime::Behind(part) => {
                attempts.is_proven_part = true;
                Located::Retry(part * size)
            }
            EventTime::Nowhere if !step.is_followed => Located::Retry(0.5 * size),
            // Screening has proven the active face up to shortly before the violation: make that part of the step
            // first.
            EventTime::Nowhere if attempts.proven >= LEAST && self.may_shorten() => {
                attempts.is_proven_part = true;
                Located::Retry(std::mem::take(&mut attempts.proven) * size)
            }
            EventTime::Nowhere if attempts.searches > 0 && self.switching.locates() => {
                attempts.searches -= 1;
                Located::Retry(0.5 * size)
            }
            EventTime::Nowhere => Located::Nowhere,
        })
    }

    /// Solves the stages of a step with the variational inequality coupled over all of them.
    fn leave_mode(&mut self, h: f64, attempts: &mut Attempts) -> Result<Solved<Trial>, StepError> {
        self.predict(h);
        let tableau = self.tableau();
        let Some(stage_vi) = &mut self.stage_vi else { return self.fail(0.5, RejectionCause::Unsolved, attempts) };
        self.contraction = Contraction::default();
        self.switching.remember(&self.system.face);
        match stage_vi.solve(&mut self.system, tableau, &mut self.stages, self.clock.t, h, &self.y, &self.control) {
            Ok(()) if !self.are_stages_solved(h) => {
                self.system.face.clone_from(&self.switching.before);
                self.fail(0.5, RejectionCause::Diverged, attempts)
            }
            Ok(()) => {
                // A step on a single face is like any other, but may have crossed switches that no stage shows: screen
                // it, unless switches accumulate, where the whole accumulation is assessed instead.
                let ends_on_face = self.system.face.is_same(&self.switching.before);
                let is_one_face = ends_on_face && self.stage_vi.as_ref().is_some_and(|vi| vi.is_one_face);
                let is_screened = ends_on_face && self.may_shorten() && self.accumulations() == 0;
                let between = attempts.missed.or_else(|| is_screened.then(|| self.screen_step(h)));
                if is_screened
                    && let Some(part) = between.and_then(Between::part_before)
                    && attempts.shortened.may_cut()
                {
                    self.system.face.clone_from(&self.switching.before);
                    return self.reject(h, part, RejectionCause::Error);
                }
                Ok(Solved::Step(Trial { coupled: true, is_one_face, between, ..Trial::on_face(h, self.control.most) }))
            }
            Err(cause) => self.fail(0.5, cause, attempts),
        }
    }

    fn is_accurate(
        &mut self,
        &Trial { h, iterations, coupled, .. }: &Trial,
        event: Option<&AtSwitch>,
        attempts: &mut Attempts,
    ) -> Result<bool, StepError> {
        if self.settings.step.is_some() {
            self.estimate_given_step(h, coupled);
            return Ok(true);
        }
        if let Some(across) = self.step_across_knots(h) {
            if coupled {
                self.system.face.clone_from(&self.switching.before);
            }
            self.shrink(h, RejectionCause::Error, |_| across)?;
            return Ok(false);
        }
        let unlocated = if coupled { self.unlocated(h) } else { None };
        let is_blind = coupled && self.switching.locates() && self.varies_unseen(h);
        if is_blind || attempts.shortened.is_too_long(unlocated) {
            self.system.face.clone_from(&self.switching.before);
            self.shrink(h, RejectionCause::Error, |_| 0.25 * h)?;
            return Ok(false);
        }
        let mut error = self.error(h, coupled);
        if !coupled {
            error = error.max(self.constraint_error(h));
        }
        let missed = if error < 1.0 && !coupled { self.missed(h) } else { 0.0 };
        let is_missed = missed > 1.0;
        if is_missed {
            error = missed;
        }
        let (s, most) = (self.tableau().stages(), self.control.most);
        if error < 1.0 {
            let mut new = self.controller.accept(s, h, error, iterations, most);
            // If a step is nearly as large as the last, new factors do not pay off.
            if !coupled && self.contraction.theta <= THETA && (1.0..=1.2).contains(&(new / h)) {
                new = h;
            }
            // A step that was cut at a switch or a breakpoint is no reason to propose smaller steps: return to the
            // size before the cut.
            let is_cut = event.is_some() || self.breaks.after().is_some();
            self.h = if is_cut { attempts.wished } else { new };
            return Ok(true);
        }
        if coupled {
            self.system.face.clone_from(&self.switching.before);
        }
        let first = self.counts.accepted == 0;
        let seen = self.unseen.seen;
        self.shrink(h, RejectionCause::Error, |controller| match is_missed {
            // Cut the step where the variation of the rates that its stages missed begins; a variation that shows
            // only in the sum over all parts of the step has no beginning.
            true if (LEAST..1.0).contains(&seen) => controller.cut(seen * h),
            true => controller.miss(s, h, error.min(1e10), iterations, most),
            false => controller.reject(s, h, error.min(1e10), iterations, most, first),
        })?;
        Ok(false)
    }

    /// Appends the step to the trajectory and continues on the next face. A step that ends before a breakpoint
    /// continues behind it, unless the step is shorter than proposed.
    fn accept(&mut self, step: Trial, event: Option<AtSwitch>, attempts: Attempts) -> Result<(), StepError> {
        let (h, contraction) = (step.h, self.contraction);
        self.append(&step, event.is_some());
        self.update_face(step.coupled, event.is_some());
        self.extent.watch(&self.y);
        if self.settings.step.is_none() {
            let is_cut = event.is_some() || self.breaks.after().is_some();
            let is_short = !is_cut && h < SHORT * attempts.proposed && !attempts.is_proven_part;
            self.watch_progress(h, is_short)?;
            self.watch_switches()?;
            self.watch_kinks()?;
            self.change_order(contraction);
        }
        // A breakpoint at the end of the run belongs to the run: pass it, unless it is later than that end.
        let is_within = !self.clock.is_done() || self.breaks.at() <= self.clock.t;
        match self.breaks.after() {
            Some(after) if h >= attempts.proposed && is_within => self.pass_break(after),
            _ => Ok(()),
        }
    }
}

impl Radau<'_> {
    /// Whether a step may be shortened to find an event in it.
    fn may_shorten(&self) -> bool {
        self.settings.step.is_none() && self.switching.locates()
    }

    /// Solves the stages on the present active face of `K` by Newton's method.
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

    /// Rejects an attempt at a step whose stages are not solved; the next step size is `fraction` times the proposed
    /// one.
    fn fail(&mut self, fraction: f64, cause: RejectionCause, attempts: &Attempts) -> Result<Solved<Trial>, StepError> {
        self.controller.surprise();
        if self.jacobian == Freshness::Kept {
            self.forget_jacobian();
            // With a fixed step size, evaluating the derivatives at the present step is the only remedy.
            if self.settings.step.is_some() && self.jacobian == Freshness::Stale {
                self.counts.rejected[cause as usize] += 1;
                return Ok(Solved::Rejected);
            }
        }
        self.reject(attempts.proposed, fraction, cause)
    }

    /// Rejects an attempt at a step of size `h`; the next step size is `fraction` times `h`.
    fn reject(&mut self, h: f64, fraction: f64, cause: RejectionCause) -> Result<Solved<Trial>, StepError> {
        self.shrink(h, cause, |_| fraction * h)?;
        Ok(Solved::Rejected)
    }

    /// Solves the stages of a step of size `h` again, and returns the first violation of a monitor (event function)
    /// that screening detects in it, and the point up to which screening excludes violations.
    fn first_violation(&mut self, h: f64) -> Result<Option<(f64, f64)>, StepError> {
        self.prepare(h)?;
        self.predict(h);
        if !matches!(self.newton(h), Newton::Converged { .. }) {
            return Ok(None);
        }
        Ok(self.screen_step(h).violation())
    }
}
