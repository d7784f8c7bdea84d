//! What can happen to a contact.

/// A change of a contact at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Happening {
    /// It closed, and an impulse acted.
    Impact {
        /// When.
        t: f64,
        /// Which.
        contact: usize,
    },
    /// It opened after it had been closed for a while.
    LiftOff {
        /// When.
        t: f64,
        /// Which.
        contact: usize,
    },
    /// It ceased to slip.
    Stick {
        /// When.
        t: f64,
        /// Which.
        contact: usize,
    },
    /// It began to slip.
    Slip {
        /// When.
        t: f64,
        /// Which.
        contact: usize,
    },
}
