//! Where in its period an orbit is cut open: the unknowns of a branch are the states there. An event that comes to the cut
//! moves from the end of a run to its beginning, and the states there jump or have no derivative, although nothing happens to
//! the orbit. The cut goes to another place before.

use crate::passages::Passages;

/// The events of an orbit, from the cut on.
#[derive(Clone, Debug)]
pub(super) struct CutOpen {
    pub passages: Passages,
    /// The time of the cut after the beginning of the period.
    pub after: f64,
}

impl CutOpen {
    /// A better place for the cut of an orbit of a period, as the time after this one.
    pub fn better(&self, period: f64) -> Option<f64> {
        Some(self.passages.far_from_all()? * period)
    }
}

impl PartialEq for CutOpen {
    /// Whether the events are the same, wherever the cut is.
    fn eq(&self, other: &Self) -> bool {
        self.passages == other.passages
    }
}
