//! Contact events: impacts, lift-offs, and changes between stick and slip.

use problem::EventKind;

/// A contact event: impact, lift-off (a contact opens after it was closed for a while), stick (slip stops) or slip
/// (slip begins).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactEvent {
    /// The time of the event, in the units of the problem.
    pub t: f64,
    /// The kind of event: impact, lift-off, stick or slip.
    pub kind: EventKind,
    /// The index of the contact at which the event occurs.
    pub contact: usize,
}
