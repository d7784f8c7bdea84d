//! Touches: monitors that come to zero within what the tolerances leave uncertain, and turn back. Whether such a monitor
//! changes its sign is not known, whichever way the computed solution has it.
//!
//! The monitors are followed a second time, with enclosures widened by the tolerances of the states. The search for events
//! then takes zero for a band, which a monitor reaches once, and leaves to one side or the other.

use super::evaluation::EvaluationBuffer;
use super::observables::Along;
use super::run::Stepper;
use hybrid::Monitors;

/// The search for touches during a run.
pub(super) struct Touches {
    monitors: Monitors,
    /// The largest size of each state so far.
    largest: Vec<f64>,
    /// The uncertainty of each state.
    uncertain: Vec<f64>,
    /// The first monitor that touches zero, and the time at which it leaves.
    pub found: Option<(usize, f64)>,
}

impl Touches {
    /// Begins to follow so many monitors.
    pub fn new(monitors: usize) -> Self {
        Self { monitors: Monitors::new(monitors), largest: Vec::new(), uncertain: Vec::new(), found: None }
    }

    /// Follows the monitors, the values of a program from `first` on, over the last step, from `begin` on, until one touches
    /// zero.
    pub fn follow(&mut self, stepper: &mut impl Stepper, place: &mut EvaluationBuffer, first: usize, begin: f64) {
        let end = stepper.t();
        let Some((rtol, atol)) = stepper.tolerances().filter(|_| self.found.is_none()) else { return };
        self.largest.resize(atol.len(), 0.0);
        self.largest.iter_mut().zip(stepper.states()).for_each(|(largest, x)| *largest = largest.max(x.abs()));
        self.uncertain.clear();
        self.uncertain.extend(self.largest.iter().zip(atol).map(|(largest, atol)| atol + rtol * largest));
        let mut along = Along { stepper, place, first, uncertain: &self.uncertain };
        let mut from = begin;
        while let Some(crossing) = self.monitors.next(&mut along, from, end) {
            from = crossing.t;
            if crossing.returns {
                self.found = Some((crossing.monitor, crossing.t));
                return;
            }
        }
    }
}
