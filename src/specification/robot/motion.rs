//! Positions and velocities of the bodies of a robot at the start, along a chain of joints.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// A moving frame, such as that of a body: its pose and velocity at the start.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    /// Pose of the moving frame in the world.
    pub frame: Isometry3<f64>,
    /// Angular velocity of the frame, in world coordinates.
    pub angular: Vector3<f64>,
    /// Velocity of the point at the origin of the world, on a rigid body that moves with the frame.
    linear: Vector3<f64>,
}

/// The axis of a joint with one degree of freedom, in the frame of the body that the joint carries.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axis {
    pub at: Vector3<f64>,
    pub along: Vector3<f64>,
    pub is_slider: bool,
}

impl Motion {
    /// Creates a moving frame that is at rest.
    pub fn at_rest(frame: Isometry3<f64>) -> Self {
        Self { frame, angular: Vector3::zeros(), linear: Vector3::zeros() }
    }

    /// Creates a moving frame from the velocity of its origin and its angular velocity.
    pub fn moving(frame: Isometry3<f64>, velocity: Vector3<f64>, angular: Vector3<f64>) -> Self {
        Self { frame, angular, linear: velocity - angular.cross(&frame.translation.vector) }
    }

    /// Velocity of the origin of the moving frame.
    pub fn velocity(&self) -> Vector3<f64> {
        self.linear + self.angular.cross(&self.frame.translation.vector)
    }

    /// Returns a frame that has the pose `at` in the moving frame, and moves with it.
    pub fn carrying(self, at: &Isometry3<f64>) -> Self {
        Self { frame: self.frame * at, ..self }
    }

    /// Returns the moving frame beyond a joint, which has the coordinate `q` and the rate `rate`; and in world
    /// coordinates a point of the joint axis and its direction.
    pub fn behind(self, axis: &Axis, (q, rate): (f64, f64)) -> (Self, Vector3<f64>, Vector3<f64>) {
        let at = self.frame.transform_point(&Point3::from(axis.at)).coords;
        let along = self.frame.rotation * axis.along;
        let Some(unit) = along.try_normalize(0.0) else { return (self, at, along) };
        if axis.is_slider {
            let frame = Translation3::from(unit * q) * self.frame;
            return (Self { frame, linear: self.linear + unit * rate, ..self }, at + unit * q, along);
        }
        let turn = UnitQuaternion::from_scaled_axis(unit * q);
        let frame = Translation3::from(at) * turn * Translation3::from(-at) * self.frame;
        let spin = unit * rate;
        (Self { frame, angular: self.angular + spin, linear: self.linear - spin.cross(&at) }, at, along)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn velocities_are_the_rates_of_places() {
        // A chain of two hinges and a slider, each displaced in proportion to `s`.
        let place = |s: f64| {
            let axis =
                |at: [f64; 3], along: [f64; 3], is_slider| Axis { at: at.into(), along: along.into(), is_slider };
            let root = Motion::at_rest(Isometry3::translation(0.1, 0.2, 0.3));
            let (first, ..) = root.behind(&axis([0.0; 3], [0.0, 2.0, 0.0], false), (0.4 + 0.7 * s, 0.7));
            let elbow = first.carrying(&Isometry3::new(Vector3::new(0.0, 0.0, 1.0), Vector3::x() * FRAC_PI_2));
            let (second, ..) = elbow.behind(&axis([0.1, 0.0, 0.2], [1.0, 1.0, 0.0], false), (1.1 - 0.3 * s, -0.3));
            let (third, ..) = second.behind(&axis([0.0; 3], [0.0, 0.0, 1.0], true), (0.2 + 0.5 * s, 0.5));
            third.carrying(&Isometry3::translation(0.3, 0.0, 0.0))
        };
        let h = 1e-6;
        let (before, now, after) = (place(-h), place(0.0), place(h));
        let rate = (after.frame.translation.vector - before.frame.translation.vector) / (2.0 * h);
        assert!((rate - now.velocity()).norm() < 1e-9);
        let turn = (after.frame.rotation * before.frame.rotation.inverse()).scaled_axis() / (2.0 * h);
        assert!((turn - now.angular).norm() < 1e-9);
    }
}
