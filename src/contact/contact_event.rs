//! Events of contacts.

use problem::EventKind;

/// An event of a contact: impact, lift-off (the contact opens after it was closed for a while), stick (slip stops) or
/// slip (slip begins).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactEvent {
    /// The time, in the units of the problem.
    pub t: f64,
    /// The kind of event.
    pub kind: EventKind,
    /// The index of the contact.
    pub contact: usize,
}
