//! Contact events.

use problem::EventKind;

/// A contact event: impact, lift-off (a contact opens after it was closed for a while), stick (slip stops) or slip
/// (slip begins).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactEvent {
    /// The time of the event, in the units of the problem.
    pub t: f64,
    /// The kind of event.
    pub kind: EventKind,
    /// The index of the contact.
    pub contact: usize,
}
