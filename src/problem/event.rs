//! Events of a solve: switches of the active face of `K`, impacts, contacts that open or close, stop conditions.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What happened to a variable at a switch of the active face of `K`, to a state, to a contact, or to what the user watches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// It left its bound: the inequality became an equation.
    Activated,
    /// It came to rest on a bound.
    Deactivated,
    /// A state jumped, since a constraint did.
    Jumped,
    /// A contact closed.
    Impact,
    /// A contact opened that had been closed for a while.
    LiftOff,
    /// A contact ceased to slip.
    Stick,
    /// A contact began to slip.
    Slip,
    /// What `stop` watches changed its sign.
    Crossed,
}

/// A switch of the active face, or what else happened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Event {
    /// When.
    pub t: f64,
    /// What.
    pub kind: EventKind,
    /// The variable, the state or the contact; between bodies both, as in `ground and ball`; of what `stop` watches its label.
    pub of: String,
}
