//! Events of a solve: switches of the active face of `K`, impacts, contacts that open or close, stop conditions.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What happened at an event: to a variable at a switch of the active face of `K`, to a state, to a contact, or to an
/// expression of `stop`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// A variable left its bound: its inequality became an equation.
    Activated,
    /// A variable reached a bound and stays on it.
    Deactivated,
    /// A state jumped because a constraint on the state jumped.
    Jumped,
    /// An open contact closed.
    Impact,
    /// A contact opened that had been closed for some time.
    LiftOff,
    /// A contact ceased to slip.
    Stick,
    /// A contact began to slip.
    Slip,
    /// The value of an expression of `stop` changed its sign.
    Crossed,
}

/// An event of a solve: a switch of the active face of `K`, a jump, a change of a contact, or a stop condition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Event {
    /// The time of the event.
    pub t: f64,
    /// The kind of the event.
    pub kind: EventKind,
    /// The name of the variable, state or contact; for a contact between two bodies the names of both, as in `ground
    /// and ball`; for a stop condition its label.
    pub of: String,
}
