//! One-step methods, as the hybrid automaton uses them: a method advances the smooth equations of a mode; its last
//! step can be evaluated at times within it, cut and repeated.
//!
//! The equations belong to the method that was built for them. The events that end a mode, and the transition to the
//! next mode, belong to the [automaton](super::Automaton), which cuts a step where its mode ends.

use numerics::Interval;

/// A one-step method with dense output, in a run from one time to another.
pub trait OneStep {
    /// The reason why the method makes no step.
    type Error;
    /// State of a run on which later steps depend, to which the run can return.
    type Saved;

    /// Returns the order of convergence of the method, that of the values at the ends of steps.
    fn order(&self) -> usize;

    /// Returns the time that the run has reached.
    fn t(&self) -> f64;

    /// Returns the unknowns at the time that the run has reached.
    fn y(&self) -> &[f64];

    /// Whether the run has reached its end time.
    fn is_done(&self) -> bool;

    /// Returns the size of the next step, as far as it is known.
    fn next_step(&self) -> f64;

    /// Makes one step whose error is within the tolerance, of a size that the method chooses.
    ///
    /// # Errors
    /// If no step is small enough.
    fn step(&mut self) -> Result<(), Self::Error>;

    /// Returns the time at which the last step began.
    fn begin(&self) -> f64;

    /// Evaluates the unknowns at time `t` within the last step into `out`.
    fn at(&mut self, t: f64, out: &mut [f64]);

    /// Returns the time derivatives of the states at time `t` within the last step.
    fn slopes_at(&self, t: f64) -> Vec<f64>;

    /// Returns enclosures of the states over `[from, to]` within the last step.
    fn ranges(&self, from: f64, to: f64) -> Vec<Interval>;

    /// Repeats the last step from its beginning to the time `end` within it, with tolerances that are `tighter` times
    /// those of the run. If that succeeds, the run is at `end`, and the repeated step replaces the last one;
    /// otherwise the run is unchanged. An event can thus be located with the step size as the unknown, so that its
    /// time has the order of the method.
    fn cut_at(&mut self, end: f64, tighter: f64) -> bool;

    /// Returns a copy of the state on which later steps depend. Derivatives and factors are not kept: the steps
    /// behind a saved point evaluate them anew, whether the run goes on or is restored, and are the same to the last
    /// bit.
    fn save(&mut self) -> Self::Saved;

    /// Continues the run from one of its saved states.
    fn restore(&mut self, saved: &Self::Saved);
}
