//! Data of a transition at the end of a smooth arc, for derivatives of a run: the state before the transition, and
//! the impulses.

use super::mode::Status;
use super::monitors::Ending;
use crate::velocity_step::{Contacted, State};
use nalgebra::Vector3;

/// The transition from one smooth arc to the next.
#[derive(Clone, Debug)]
pub struct Transition {
    /// The state at the end of the arc, before impulses and projections.
    pub before: State,
    /// The contact mode of the arc that ended.
    pub mode: Vec<Status>,
    /// The event that ended the arc; `None` at the start of a run, and at a breakpoint in time.
    pub ending: Option<Ending>,
    /// The impact of the transition, if there was one.
    pub impact: Option<Impact>,
    /// Whether a contact grazed on the arc or at its end.
    pub grazes: bool,
}

/// An instantaneous impact at the end of a smooth arc.
#[derive(Clone, Debug)]
pub struct Impact {
    /// The impulses of the sequential impact law in their order, each with its contact.
    pub strikes: Vec<(usize, Vector3<f64>)>,
    /// The impulses and velocities of all contacts in the impact.
    pub contacted: Contacted,
    /// Whether contacts rebound with their restitution; otherwise they come to rest.
    pub rebounds: bool,
    /// Whether the restitution was limited because full restitution would have added energy.
    pub is_limited: bool,
    /// The contact whose impacts accumulated, if the impact represents their limit.
    pub accumulates: Option<usize>,
}
