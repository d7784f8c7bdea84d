//! What happened at the end of a smooth arc, for those who differentiate a run: the state before, and the impulses.

use super::mode::Status;
use super::monitors::Ending;
use crate::velocity_step::{Contacted, State};
use nalgebra::Vector3;

/// The passage from one smooth arc to the next.
#[derive(Clone, Debug)]
pub struct Transition {
    /// The state at the end of the arc, before impulses and projections.
    pub before: State,
    /// The mode of the arc.
    pub mode: Vec<Status>,
    /// The event that ended the arc; `None` at the start of a run, and at a breakpoint of time.
    pub ending: Option<Ending>,
    /// The impact, if there was one.
    pub impact: Option<Impact>,
    /// Whether a contact grazed on the arc or at its end.
    pub grazes: bool,
}

/// An instantaneous impact.
#[derive(Clone, Debug)]
pub struct Impact {
    /// The impulses of one contact after the other, and their contacts, by the sequential law.
    pub strikes: Vec<(usize, Vector3<f64>)>,
    /// The impulses and velocities of all contacts.
    pub contacted: Contacted,
    /// Whether contacts rebound with their restitution; otherwise they come to rest.
    pub rebounds: bool,
    /// Whether the restitution was limited, as the whole would have added energy.
    pub is_limited: bool,
    /// The contact whose impacts accumulated, if the impact stands for their limit.
    pub accumulates: Option<usize>,
}
