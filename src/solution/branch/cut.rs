//! The cut of a periodic orbit, the point at which its period begins; the unknowns of a branch are the states at the
//! cut. If an event passes the cut, it moves from the end of a run to its beginning, and the states at the cut jump
//! or are not differentiable, although the orbit itself does not change. The cut is moved before such an event
//! reaches it.

use crate::passages::Passages;

/// The events of a periodic orbit, in their order from the cut (the point at which the continuation lets the period
/// begin) on.
#[derive(Clone, Debug)]
pub(super) struct CutOpen {
    pub passages: Passages,
    /// The time from the start time of the plan, at which the period of the orbit begins, to the cut.
    pub after: f64,
}

impl CutOpen {
    /// Returns a better position of the cut of an orbit with the given period, as the time after the current cut;
    /// `None` if the current cut is far enough from all events.
    pub fn better(&self, period: f64) -> Option<f64> {
        Some(self.passages.far_from_all()? * period)
    }
}

impl PartialEq for CutOpen {
    /// Whether the cyclic sequences of events of two orbits are equal, wherever the cuts are.
    fn eq(&self, other: &Self) -> bool {
        self.passages == other.passages
    }
}
