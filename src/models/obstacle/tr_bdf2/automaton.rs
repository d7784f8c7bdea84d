//! One step of TR-BDF2 as a hybrid automaton with two modes: some node touches an obstacle, or none does. A step ends
//! where contact begins or ends; the active set of the nodes may change at other times within a step, since the
//! method keeps its order there.
//!
//! The monitor (event function) is the least gap of a node or, in contact, the largest displacement that contact
//! forces prevent, with the sign of the mode. The size of the step is the unknown of the event location, so that the
//! time of the event has the accuracy of the method.

use super::{Attempt, TrBdf2};
use crate::obstacle::ObstacleError;
use crate::obstacle::resting::Moment;
use expression::cube_root;
use hybrid::{Automaton, Located, Proposal, Screened, Solved};
use numerics::Bracket;
use std::ops::Range;

/// The range of factors between the next and the current step size in which the step size is kept, to save the
/// factorisation of a new matrix.
const UNCHANGED: Range<f64> = 0.95..1.2;

/// Gap, in units of the error tolerance of a step, below which contact counts as beginning or ending at the end of
/// the step. The error of the gap is about a tolerance: a smaller fraction costs solves without gain, a larger one
/// shifts the event. A change of contact is not located unless the monitor exceeds this value at both ends of the
/// step, so that contact that flickers within the tolerance does not shorten steps.
const CLOSE: f64 = 1e-3;

/// Smallest and largest size of the next attempt, relative to a rejected step that has missed a variation of the data.
const LEAST: f64 = 0.1;
const MOST: f64 = 0.9;

/// Maximum number of steps solved to locate one change of contact: every other step at least halves the bracket, and a
/// double has 53 binary digits.
const MOST_GUESSES: usize = 120;

/// The beginning or the end of contact of the solution with an obstacle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContactChange {
    /// The first node comes into contact with an obstacle.
    Begins,
    /// The last node in contact leaves its obstacle.
    Ends,
}

/// An attempted step whose stages are solved.
#[derive(Clone, Copy, Debug)]
pub struct Trial {
    h: f64,
    next: f64,
    /// The error estimate of the attempted step, in units of the tolerance.
    error: f64,
    is_located: bool,
}

/// A beginning or end of contact within a step, and the values of its event function at both ends of the step.
#[derive(Clone, Copy, Debug)]
pub struct Changes {
    to: ContactChange,
    begin: f64,
    end: f64,
}

impl Automaton for TrBdf2<'_> {
    type Attempts = ();
    type Step = Trial;
    type Violation = Changes;
    type Event = ContactChange;
    type Error = ObstacleError;

    fn propose(&mut self, (): &mut ()) -> Result<Proposal, ObstacleError> {
        if self.control.poll().is_some() {
            return Err(ObstacleError::Interrupted { t: self.t });
        }
        let remaining = self.end - self.t;
        // Extend the step to the end time of the run if the time left after it would be within rounding.
        let mut h = if self.h >= remaining * (1.0 - 1e-9) { remaining } else { self.h };
        if self.settings.step.is_none() && remaining > 0.0 {
            h = self.breaks.up_to_break(&mut self.system.problem, self.t, h);
            if let Some(after) = self.breaks.after()
                && h <= 0.0
            {
                self.pass_break(after)?;
                return Ok(Proposal::Again);
            }
        }
        if self.restarts && h > 0.0 {
            self.find_initial_slope(h)?;
        }
        Ok(Proposal::Step(h))
    }

    fn solve(&mut self, h: f64, (): &mut ()) -> Result<Solved<Trial>, ObstacleError> {
        if h <= 0.0 {
            return Ok(Solved::Passed);
        }
        let next = if h >= self.end - self.t { self.end } else { self.t + h };
        match self.attempt(h, next)? {
            Attempt::Made(error) => Ok(Solved::Step(Trial { h, next, error, is_located: false })),
            Attempt::Unsolved(why) if self.settings.step.is_some() => {
                Err(ObstacleError::Unsolved { t: self.t, h, why })
            }
            Attempt::Unsolved(why) => {
                self.counts.unsolved += 1;
                self.shrink(0.25 * h, why)?;
                Ok(Solved::Rejected)
            }
        }
    }

    /// Detects the beginning or end of contact within a step. With a fixed step size, contact changes at the end of the
    /// step without being located; an inaccurate step is not searched, since it will be rejected.
    fn screen(&mut self, step: &mut Trial, (): &mut ()) -> Result<Screened<Changes>, ObstacleError> {
        let is_searched = self.settings.step.is_none() && step.error <= 1.0 && !step.is_located;
        let change = change(self.gap, self.least_gap(&self.trial[1])).filter(|_| is_searched);
        let Some(to) = change else { return Ok(Screened::Clear) };
        let begin = match to {
            ContactChange::Begins => self.gap,
            ContactChange::Ends => largest_displacement(&self.moments[0]),
        };
        let (end, close) = (self.monitor(to), self.close(step.h));
        let is_far = begin > close && end < -close;
        Ok(if is_far { Screened::Violated(Changes { to, begin, end }) } else { Screened::Clear })
    }

    fn locate(
        &mut self,
        mut step: Trial,
        Changes { to, begin, end }: Changes,
        (): &mut (),
    ) -> Result<Located<Trial, ContactChange>, ObstacleError> {
        let mut bracket = Bracket::new((0.0, begin), (step.h, end));
        let close = self.close(step.h);
        let least = 4.0 * f64::EPSILON * self.t.abs().max(step.h);
        step.is_located = true;
        for _ in 0..MOST_GUESSES {
            let is_narrow = bracket.width() <= least;
            if step.h == bracket.behind.0 && (is_narrow || bracket.behind.1.abs() <= close) {
                break;
            }
            let guess = Some(bracket.guess()).filter(|guess| *guess > bracket.before.0 && *guess < bracket.behind.0);
            let middle = 0.5 * (bracket.before.0 + bracket.behind.0);
            step.h = if is_narrow { bracket.behind.0 } else { guess.unwrap_or(middle) };
            step.next = self.t + step.h;
            match self.attempt(step.h, step.next)? {
                Attempt::Made(error) => step.error = error,
                Attempt::Unsolved(why) => {
                    self.counts.unsolved += 1;
                    self.shrink(0.25 * step.h, why)?;
                    return Ok(Located::Rejected);
                }
            }
            if !is_narrow {
                bracket.narrow(step.h, self.monitor(to));
            }
        }
        Ok(Located::Ends(step, Some(to)))
    }

    fn is_accurate(
        &mut self,
        &Trial { h, error, .. }: &Trial,
        _: Option<&ContactChange>,
        (): &mut (),
    ) -> Result<bool, ObstacleError> {
        if error <= 1.0 || self.settings.step.is_some() {
            return Ok(true);
        }
        self.counts.inaccurate += 1;
        let factor = if error.is_finite() { (0.9 / cube_root(error)).max(0.1) } else { 0.1 };
        // The next attempt ends where the first variation of the data that the rejected step has missed begins.
        let factor = self.hidden.unseen.begin.map_or(factor, |begin| begin.clamp(LEAST, MOST));
        self.shrink(factor * h, "the error was too large")?;
        Ok(false)
    }

    /// Accepts the attempted step. The size of the next step follows from the error estimate, unless the step ends at
    /// an event.
    fn accept(
        &mut self,
        Trial { h, next, error, .. }: Trial,
        event: Option<ContactChange>,
        (): (),
    ) -> Result<(), ObstacleError> {
        self.append(h, next);
        self.counts.accepted += 1;
        // The extrapolation of the solution to the end of the accepted step may bring nodes into contact, too.
        self.note_contact();
        self.restarts = false;
        if event.is_none() && self.settings.step.is_none() && next < self.end {
            let most = if self.was_rejected { 1.0 } else { 5.0 };
            let factor = (0.9 / cube_root(error)).clamp(0.2, most);
            let factor = if UNCHANGED.contains(&factor) { 1.0 } else { factor };
            let wished = (factor * h).min(self.settings.max_step);
            // A step that was shortened to end at a breakpoint of the data does not limit the size of the next step.
            let was_cut = self.breaks.after().is_some() && factor >= 1.0;
            self.h = if was_cut { self.h.max(wished) } else { wished };
        }
        self.was_rejected = false;
        Ok(())
    }
}

impl TrBdf2<'_> {
    /// Reduces the size of the next attempted step to `h`; fails if `h` is below the minimum step size.
    fn shrink(&mut self, h: f64, why: &'static str) -> Result<(), ObstacleError> {
        self.was_rejected = true;
        self.h = h;
        if h < self.settings.min_step.max(16.0 * f64::EPSILON * self.t.abs()) || h < f64::MIN_POSITIVE {
            return Err(ObstacleError::StepTooSmall { t: self.t, h, why });
        }
        Ok(())
    }

    /// Returns the least distance from the obstacles below which contact counts as beginning or ending at the end of a
    /// step of size `h`.
    fn close(&self, h: f64) -> f64 {
        CLOSE * (self.settings.atol + self.settings.rtol * self.largest(h))
    }

    /// Continues the run after a breakpoint of the data. Where a bound jumps over `u`, `u` is projected onto the new
    /// set `K`, which is the limit of a step whose size tends to zero.
    fn pass_break(&mut self, after: f64) -> Result<(), ObstacleError> {
        let before = self.t;
        self.breaks.pass(after);
        self.t = if after >= self.end { self.end } else { after };
        self.last.0 = before;
        self.last.1.copy_from_slice(&self.u);
        self.last.2.copy_from_slice(&self.u);
        self.system.vectors_at(after, self.control)?;
        for (i, u) in self.u.iter_mut().enumerate() {
            *u = self.system.set.project(i, *u);
        }
        self.note_contact();
        self.restarts = true;
        Ok(())
    }

    /// Records whether contact with an obstacle has begun or ended at the current time.
    fn note_contact(&mut self) {
        let gap = self.least_gap(&self.u);
        self.changes.extend(change(self.gap, gap).map(|change| (self.t, change)));
        self.gap = gap;
    }

    /// Returns the event function of a change of contact at the end of the step whose stages are solved: positive
    /// before the change, negative after it.
    fn monitor(&self, to: ContactChange) -> f64 {
        let gap = self.least_gap(&self.trial[1]);
        let separation = if gap == 0.0 { -largest_displacement(&self.moments[2]) } else { gap };
        match to {
            ContactChange::Begins => separation,
            ContactChange::Ends => -separation,
        }
    }

    /// Returns the least distance of a node without a Dirichlet condition from the obstacles, at nodal values `u`.
    pub(super) fn least_gap(&self, u: &[f64]) -> f64 {
        let set = &self.system.set;
        let free = (0..u.len()).filter(|&i| !self.system.is_given[i]);
        free.map(|i| (u[i] - set.lower[i]).min(set.upper[i] - u[i])).fold(f64::INFINITY, f64::min)
    }
}

/// Returns the beginning or end of contact between two successive values of the least distance from the obstacles.
fn change(before: f64, after: f64) -> Option<ContactChange> {
    match (before == 0.0, after == 0.0) {
        (false, true) => Some(ContactChange::Begins),
        (true, false) => Some(ContactChange::Ends),
        _ => None,
    }
}

/// Returns the largest displacement that the contact force of a node prevents, over all nodes.
fn largest_displacement(moment: &Moment) -> f64 {
    moment.kept.iter().fold(0.0, |largest, kept| largest.max(kept.abs()))
}
