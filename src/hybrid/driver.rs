//! The driver: the only loop of the hybrid automaton.
//!
//! ```text
//! mode -> smooth equations -> monitors -> event -> transition -> mode
//! ```
//!
//! A step is proposed, solved on the present mode, screened for an event, and cut where the first event is located;
//! it is judged by its error, accepted, and followed by the transition at its end. Each engine (an implementation of
//! [`Automaton`]) defines these operations for its modes: faces of `K`, contact modes, faces of a problem with a
//! memory kernel, active sets of obstacles. It also defines the data that it keeps over its attempts at one step.

/// An engine: an integrator whose run follows a hybrid automaton: modes with smooth equations, and events between them.
pub trait Automaton {
    /// Data kept over the attempts at one step, such as the number of cuts; dropped when a step is accepted.
    type Attempts: Default;
    /// A step whose equations are solved, and that is not yet accepted.
    type Step;
    /// A violation of a monitor (event function of the mode) within a step.
    type Violation;
    /// The event (such as a switch or an impact) at the end of a step.
    type Event;
    /// The reason why the engine makes no step.
    type Error;

    /// Proposes the size of the next attempt.
    ///
    /// # Errors
    /// If the caller asks to stop, or no size is left to try.
    fn propose(&mut self, attempts: &mut Self::Attempts) -> Result<Proposal, Self::Error>;

    /// Solves the equations of the mode over a step of size `h`.
    ///
    /// # Errors
    /// If no step can follow.
    fn solve(&mut self, h: f64, attempts: &mut Self::Attempts) -> Result<Solved<Self::Step>, Self::Error>;

    /// Examines a step for the first violation of a monitor.
    ///
    /// # Errors
    /// If a value cannot be computed.
    fn screen(
        &mut self,
        step: &mut Self::Step,
        attempts: &mut Self::Attempts,
    ) -> Result<Screened<Self::Violation>, Self::Error>;

    /// Locates the event behind a violation.
    ///
    /// # Errors
    /// If no step can follow.
    fn locate(
        &mut self,
        step: Self::Step,
        violation: Self::Violation,
        attempts: &mut Self::Attempts,
    ) -> Result<Located<Self::Step, Self::Event>, Self::Error>;

    /// Makes a step without the equations of the mode, after these could not be solved or the event at the end of the
    /// mode could not be located. An automaton without such a step rejects the attempt.
    ///
    /// # Errors
    /// If no step can follow.
    fn leave_mode(&mut self, _h: f64, _attempts: &mut Self::Attempts) -> Result<Solved<Self::Step>, Self::Error> {
        Ok(Solved::Rejected)
    }

    /// Judges a step by its error; if the step is rejected, the next proposal is a smaller step.
    ///
    /// # Errors
    /// If no smaller step is left to try.
    fn is_accurate(
        &mut self,
        step: &Self::Step,
        event: Option<&Self::Event>,
        attempts: &mut Self::Attempts,
    ) -> Result<bool, Self::Error>;

    /// Appends a step to the trajectory, and makes the transition that its event demands.
    ///
    /// # Errors
    /// If no mode can follow.
    fn accept(
        &mut self,
        step: Self::Step,
        event: Option<Self::Event>,
        attempts: Self::Attempts,
    ) -> Result<(), Self::Error>;
}

/// The next attempt at a step, which the engine proposes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Proposal {
    /// Attempt to make a step of this size.
    Step(f64),
    /// No attempt: the run has passed a breakpoint without a step, and has to propose a size again.
    Again,
}

/// Result of solving the equations of a mode over a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Solved<S> {
    /// The step; its equations are solved over its whole size.
    Step(S),
    /// The equations of the mode have changed their form: the same step size is tried again.
    Again,
    /// The equations of the mode have no solution over the step, or none was found.
    Lost,
    /// The attempt is rejected, and the next proposal is a smaller step.
    Rejected,
    /// The run has advanced by other means than a step of the method.
    Passed,
}

/// Result of the screening of a step for violations of monitors (event functions).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Screened<V> {
    /// No monitor (event function) is violated: the mode continues to the end of the step.
    Clear,
    /// The mode is known to continue only over a step of this size, which is solved next.
    Shorter(f64),
    /// A monitor (event function) is violated within the step, so that the mode ends there.
    Violated(V),
}

/// Result of the location of the event that ends the mode within a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Located<S, E> {
    /// The step ends at the event, or before the event and then without one.
    Ends(S, Option<E>),
    /// The step has been cut, perhaps at an event, and the shorter step is screened for further events.
    Cut(S, Option<E>),
    /// A step of this size is solved next: the event was at the beginning, where the mode has changed, or it is sought
    /// in a shorter step.
    Retry(f64),
    /// The event was not found, and the step has to be made without the equations of the mode.
    Nowhere,
    /// The attempt at the step is over, and another one is proposed.
    Rejected,
}

/// Makes one accepted step, with the transition at its end.
///
/// # Errors
/// The reason why no step is made.
pub fn advance<A: Automaton>(automaton: &mut A) -> Result<(), A::Error> {
    let mut attempts = A::Attempts::default();
    loop {
        let Proposal::Step(h) = automaton.propose(&mut attempts)? else { continue };
        let (step, event) = match up_to_event(automaton, h, &mut attempts)? {
            Reached::Step(step, event) => (step, event),
            Reached::Nothing => continue,
            Reached::Passed => return Ok(()),
        };
        if automaton.is_accurate(&step, event.as_ref(), &mut attempts)? {
            return automaton.accept(step, event, attempts);
        }
    }
}

/// Result of one attempt of the engine at a step.
enum Reached<S, E> {
    Step(S, Option<E>),
    /// The attempt at the step was rejected.
    Nothing,
    /// The run has advanced by other means than a step of the method.
    Passed,
}

/// Solves a step of size `h`, or the part of it up to its first event.
fn up_to_event<A: Automaton>(
    automaton: &mut A,
    mut h: f64,
    attempts: &mut A::Attempts,
) -> Result<Reached<A::Step, A::Event>, A::Error> {
    let proposed = h;
    'solve: loop {
        let mut event = None;
        let mut step = match automaton.solve(h, attempts)? {
            Solved::Step(step) => step,
            Solved::Again => continue,
            Solved::Lost => break,
            Solved::Rejected => return Ok(Reached::Nothing),
            Solved::Passed => return Ok(Reached::Passed),
        };
        loop {
            match automaton.screen(&mut step, attempts)? {
                Screened::Clear => return Ok(Reached::Step(step, event)),
                Screened::Shorter(shorter) => {
                    h = shorter;
                    continue 'solve;
                }
                Screened::Violated(violation) => match automaton.locate(step, violation, attempts)? {
                    Located::Ends(step, event) => return Ok(Reached::Step(step, event)),
                    Located::Cut(cut, found) => (step, event) = (cut, found),
                    Located::Retry(size) => {
                        h = size;
                        continue 'solve;
                    }
                    Located::Nowhere => break 'solve,
                    Located::Rejected => return Ok(Reached::Nothing),
                },
            }
        }
    }
    match automaton.leave_mode(proposed, attempts)? {
        Solved::Step(step) => Ok(Reached::Step(step, None)),
        Solved::Passed => Ok(Reached::Passed),
        Solved::Again | Solved::Lost | Solved::Rejected => Ok(Reached::Nothing),
    }
}
