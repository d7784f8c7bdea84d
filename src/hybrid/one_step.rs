//! One-step methods, as the automaton sees them: a method advances the smooth equations of a mode, and can be read, cut
//! and repeated within its last step.
//!
//! The equations belong to the method that was built for them. What ends a mode, and what follows, does not: it is the
//! [automaton](super::Automaton) that cuts a step where its mode ends.

use numerics::Interval;

/// A one-step method with dense output, in a run from one time to another.
pub trait OneStep {
    /// The reason why no step is made.
    type Error;
    /// All that the steps to come depend on.
    type Saved;

    /// The order of the values at the ends of steps.
    fn order(&self) -> usize;

    /// The time reached.
    fn t(&self) -> f64;

    /// The unknowns at the time reached.
    fn y(&self) -> &[f64];

    /// Whether the end of the run is reached.
    fn is_done(&self) -> bool;

    /// The size of the next step, as far as it is known.
    fn next_step(&self) -> f64;

    /// Makes one step whose error is within the tolerance, of a size that the method chooses.
    ///
    /// # Errors
    /// If no step is small enough.
    fn step(&mut self) -> Result<(), Self::Error>;

    /// The time at which the last step began.
    fn begin(&self) -> f64;

    /// Evaluates the unknowns at time `t` within the last step into `out`.
    fn at(&mut self, t: f64, out: &mut [f64]);

    /// The slopes of the states at time `t` within the last step.
    fn slopes_at(&self, t: f64) -> Vec<f64>;

    /// Enclosures of the states over `[from, to]` within the last step.
    fn ranges(&self, from: f64, to: f64) -> Vec<Interval>;

    /// Repeats the last step from its beginning to the time `end` within it, with tolerances that are `tighter` times
    /// those of the run. If that succeeds, the run is at `end`, and the repeated step replaces the last one; otherwise
    /// nothing has changed. So the size of the step is the unknown in the location of an event, whose time has the
    /// order of the method.
    fn cut_at(&mut self, end: f64, tighter: f64) -> bool;

    /// A copy of what the steps to come depend on. Derivatives and factors are not kept: the steps behind a saved point
    /// evaluate them anew, whether the run goes on or is restored, and are the same to the last bit.
    fn save(&mut self) -> Self::Saved;

    /// Continues from a saved point of the same run.
    fn restore(&mut self, saved: &Self::Saved);
}
