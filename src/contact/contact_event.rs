//! Events of a contact.

use problem::EventKind;

/// An event of a contact: an impact, a lift-off (it opens after it was closed for a while), a slip that stops, or one that begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactEvent {
    /// The time, in the units of the problem.
    pub t: f64,
    /// Which of the four.
    pub kind: EventKind,
    /// The contact, by its position.
    pub contact: usize,
}
