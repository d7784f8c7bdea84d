//! One step of the hybrid automaton whose modes are contact modes: the one-step method proposes a step, and the step
//! is cut at the end of the mode.

use super::hidden::{Enclosed, Hidden};
use super::integrals::Integrals;
use super::monitors::Ending;
use super::search::{SMALLEST, Search, Violation};
use super::smooth_phase::{GROWTH, SmoothPhase};
use crate::ContactError;
use hybrid::{Automaton, Located, OneStep, Proposal, Screened, Solved};
use numerics::Interval;

/// Largest number of cuts of a step for hidden violations (between the points at which it was evaluated), which
/// enclosures of the step find.
const ROUNDS: usize = 2;

/// Largest number of cuts of a step for a violation at its beginning: the initial opening of a gap that opens with
/// its third derivative lies below the error of the polynomials of a long step, and above that of a step a hundred
/// times as short.
const RECUTS: usize = 6;

/// Counters of the attempts at one step.
#[derive(Debug, Default)]
pub struct Attempts {
    /// The number of cuts so far of the step for hidden violations: those between the points at which the step was
    /// evaluated.
    rounds: usize,
    /// The number of cuts so far of the step at monitors (event functions) whose violation was seen at an evaluated
    /// point.
    recuts: usize,
    /// Whether the step was cut at a monitor (event function) seen violated, and has not been searched for events
    /// since.
    is_recut: bool,
}

/// A step of the one-step method, or its part before a cut.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    begin: f64,
    end: f64,
    /// Whether the step was solved anew up to its end, with a tighter tolerance.
    is_cut: bool,
}

/// The first violation of the contact mode found within a step: of a monitor (event function), a gap or a joint.
pub enum Found {
    /// A monitor is violated in a step whose stages are only as accurate as the monitor's tolerance: whether a gap
    /// closes must be decided with a tighter tolerance.
    Seen(Violation),
    /// A monitor (event function) is violated in a step whose stages are accurate enough to locate the event.
    Monitor(Violation),
    /// A gap or a joint is violated between the points at which the step was evaluated.
    Hidden(Hidden),
    /// The step was searched for violations of gaps and monitors up to this time only.
    Unsearched(f64),
}

impl Automaton for SmoothPhase<'_, '_> {
    type Attempts = Attempts;
    type Step = Part;
    type Violation = Found;
    type Event = Ending;
    type Error = ContactError;

    fn propose(&mut self, _: &mut Attempts) -> Result<Proposal, ContactError> {
        Ok(Proposal::Step(self.method.as_ref().map_or(0.0, OneStep::next_step)))
    }

    fn solve(&mut self, _: f64, _: &mut Attempts) -> Result<Solved<Part>, ContactError> {
        let begin = self.located.state.t;
        let Some(method) = &mut self.method else { return Ok(Solved::Lost) };
        if method.step().is_err() {
            return Ok(Solved::Lost);
        }
        let last = method.t();
        let sizes = method.ranges(begin, last).into_iter().map(Interval::size);
        self.reached = sizes.map(|size| if size.is_finite() { size } else { 0.0 }).collect();
        self.located.begin();
        self.located.accepted += 1;
        let mut step = Part { begin, end: self.grown(begin, last), is_cut: false };
        self.located.h = Some(step.end - begin);
        if step.end < last {
            (step.is_cut, self.over) = (self.cut_at(step.end), true);
        }
        self.parts = self.parts_in_time(begin, step.end);
        if let Some(burst) = self.burst(begin, step.end) {
            (self.over, self.located.h) = (true, Some(burst.next));
            if burst.until <= begin {
                // A burst (dependence on time that the step missed) begins with the step: repeat the step with a
                // smaller size.
                self.located.mode = Some(self.mode.clone());
                return Ok(Solved::Passed);
            }
            step.end = burst.until;
            step.is_cut |= self.cut_at(step.end);
        }
        Ok(Solved::Step(step))
    }

    fn screen(&mut self, step: &mut Part, attempts: &mut Attempts) -> Result<Screened<Found>, ContactError> {
        let Part { begin, end, is_cut } = *step;
        let found = self.search(begin, end);
        let until = match found {
            Search::Clear => end,
            Search::Ends(violation)
                if !(is_cut || attempts.is_recut) || self.may_be_error(step, &violation, attempts) =>
            {
                return Ok(Screened::Violated(Found::Seen(violation)));
            }
            Search::Ends(Violation { t, .. }) | Search::Until(t) => t,
        };
        if std::mem::take(&mut attempts.is_recut) && matches!(found, Search::Clear) {
            // The violation of the monitor was an error of the longer step before its cut: the cut step does not have
            // it.
            self.located.h = Some(GROWTH * (end - begin));
        }
        let enclosed = self.hidden(begin, until);
        if let Enclosed::Violated(hidden) = enclosed
            && attempts.rounds < ROUNDS
        {
            return Ok(Screened::Violated(Found::Hidden(hidden)));
        }
        self.note_screened(&enclosed);
        Ok(match found {
            Search::Clear => Screened::Clear,
            Search::Ends(violation) => Screened::Violated(Found::Monitor(violation)),
            Search::Until(t) => Screened::Violated(Found::Unsearched(t)),
        })
    }

    fn locate(
        &mut self,
        mut step: Part,
        found: Found,
        attempts: &mut Attempts,
    ) -> Result<Located<Part, Ending>, ContactError> {
        Ok(match found {
            Found::Seen(violation) => {
                step.end = violation.seen;
                step.is_cut = self.cut_at(step.end);
                (self.over, attempts.is_recut) = (true, true);
                attempts.recuts += 1;
                Located::Cut(step, None)
            }
            Found::Hidden(hidden) => {
                (step.end, attempts.rounds) = (hidden.until, attempts.rounds + 1);
                (self.over, self.located.h) = (true, Some(hidden.next));
                step.is_cut |= self.cut_at(step.end);
                Located::Cut(step, None)
            }
            Found::Monitor(violation) => {
                step.end = self.refine(step.begin, step.end, &violation);
                Located::Ends(step, Some(violation.ending))
            }
            Found::Unsearched(t) => {
                self.cut_at(t);
                (self.located.h, self.over, step.end) = (Some(t - step.begin), true, t);
                Located::Ends(step, None)
            }
        })
    }

    /// Makes one step of time stepping instead of smooth motion: where the smooth motion has no continuation, a
    /// motion with impulses may exist.
    fn leave_mode(&mut self, _: f64, _: &mut Attempts) -> Result<Solved<Part>, ContactError> {
        (self.over, self.method) = (true, None);
        self.located.step_over(self.control)?;
        Ok(Solved::Passed)
    }

    fn is_accurate(&mut self, _: &Part, _: Option<&Ending>, _: &mut Attempts) -> Result<bool, ContactError> {
        Ok(true)
    }

    fn accept(&mut self, step: Part, event: Option<Ending>, _: Attempts) -> Result<(), ContactError> {
        let Part { begin, end: t, is_cut } = step;
        if t > begin {
            self.note_grazing(begin, t, event);
            self.travel(begin, t);
        }
        self.acted = (begin, Integrals::none(self.mode.len()));
        if t - begin > 10.0 * self.located.pass {
            self.located.pass = 0.0;
        }
        if let Some(ending) = event {
            self.over = true;
            return self.located.switch_mode(ending, self.control);
        }
        self.located.evaluate_constraints();
        self.follow_slips();
        if !is_cut && self.is_behind_break(t) {
            self.over = true;
            return self.located.pass_break(&self.mode, self.control);
        }
        if let Some(growth) = self.drift() {
            if !self.over {
                let next = self.method.as_ref().map(OneStep::next_step);
                self.located.h = next.map(|next| next.min(growth * (t - begin)));
            }
            self.over = true;
            self.located.project_onto_constraints(&self.mode)?;
        }
        if self.over {
            self.located.mode = Some(self.mode.clone());
        }
        Ok(())
    }
}

impl SmoothPhase<'_, '_> {
    /// Whether a gap, at rest at the beginning of the step, may seem to close at that time only because of errors in
    /// the polynomials of a long step.
    fn may_be_error(&mut self, step: &Part, violation: &Violation, attempts: &Attempts) -> bool {
        let Ending::Impact(k) = violation.ending else { return false };
        let begins = violation.t - step.begin <= SMALLEST * (step.end - step.begin);
        if !begins || violation.seen >= step.end || attempts.recuts >= RECUTS {
            return false;
        }
        // Until the step is accepted, `located.state` is the state at its beginning.
        self.located.evaluate_constraints();
        let v = &self.located.state.v;
        self.located.normal(k, v).abs() <= self.located.rounding(k, v)
    }
}
