//! What each contact does while motion is smooth.

use nalgebra::Vector2;
use problem::MechanicalStructure;

/// The state of one contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Status {
    /// It carries nothing.
    Open,
    /// Closed; nothing resists slip.
    Smooth,
    /// Closed; it does not slip.
    Stick,
    /// Closed; it slips in this direction. In a plane the direction is kept, in space it follows the slip.
    Slip(Vector2<f64>),
}

impl Status {
    /// Whether it carries a normal force.
    pub fn is_closed(self) -> bool {
        self != Self::Open
    }
}

/// The rows of `J` that are held: joints, normals of closed contacts, tangents of those that stick.
pub fn held(structure: &MechanicalStructure, mode: &[Status]) -> Vec<usize> {
    let closed = (0..mode.len()).filter(|&k| mode[k].is_closed()).map(|k| structure.normal(k));
    let stuck = (0..mode.len()).filter(|&k| mode[k] == Status::Stick).flat_map(|k| structure.tangents(k));
    (0..structure.joints).chain(closed).chain(stuck).collect()
}
