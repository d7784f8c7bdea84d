//! Body frames at an instant, and mean frames over a step.
//!
//! The axes of a mean frame are not a rotation matrix. For constraints bilinear in the vectors of two frames, the
//! gradient at the mean frames is a discrete gradient: `c(q+) - c(q) = G(mean) . (change of the vectors)` holds exactly
//! (Gonzalez 1996, *Time integration and discrete Hamiltonian systems*; Betsch and Steinmann 2002, for joints).

use nalgebra::{Isometry3, Matrix3, Vector3};

/// The frame of a body: the position of its centre of mass, and its axes as columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// The position of the centre of mass of the body.
    pub at: Vector3<f64>,
    /// The axes of the body frame in world coordinates, as columns.
    pub axes: Matrix3<f64>,
}

impl Frame {
    /// The frame of the world: the origin with the coordinate axes.
    pub const WORLD: Self =
        Self { at: Vector3::new(0.0, 0.0, 0.0), axes: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0) };

    /// Returns the frame of a body at a given pose.
    pub fn of(pose: &Isometry3<f64>) -> Self {
        Self { at: pose.translation.vector, axes: pose.rotation.to_rotation_matrix().into_inner() }
    }

    /// Returns the arithmetic mean of two frames of a body, whose axes are not orthonormal in general.
    pub fn mean(&self, other: &Self) -> Self {
        Self { at: 0.5 * (self.at + other.at), axes: 0.5 * (self.axes + other.axes) }
    }
}
