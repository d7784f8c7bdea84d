//! Contact modes: the status of each contact in smooth motion.

use nalgebra::Vector2;
use problem::MechanicalStructure;

/// The status of one contact in smooth motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Status {
    /// The contact is open and carries no force.
    Open,
    /// The contact is closed, without friction, and may carry a normal force.
    Frictionless,
    /// The contact is closed and sticks: its slip velocity is zero.
    Stick,
    /// The contact is closed and slips in this direction. The direction is constant in a plane; in 3D it follows the
    /// slip.
    Slip(Vector2<f64>),
}

impl Status {
    /// Whether the status continues the status `before`: both are equal, or both slip and the slip has not reversed.
    pub fn continues(&self, before: &Self) -> bool {
        match (self, before) {
            (Self::Slip(direction), Self::Slip(before)) => direction.dot(before) > 0.0,
            (now, before) => now == before,
        }
    }

    /// Whether the contact is closed and may carry a normal force.
    pub fn is_closed(self) -> bool {
        self != Self::Open
    }
}

/// Returns the rows of `J` (constraint Jacobian) that a contact mode holds: joints, normals of closed contacts,
/// tangents of sticking contacts.
pub fn held(structure: &MechanicalStructure, mode: &[Status]) -> Vec<usize> {
    let closed = (0..mode.len()).filter(|&k| mode[k].is_closed()).map(|k| structure.normal(k));
    let stuck = (0..mode.len()).filter(|&k| mode[k] == Status::Stick).flat_map(|k| structure.tangents(k));
    (0..structure.joints).chain(closed).chain(stuck).collect()
}
