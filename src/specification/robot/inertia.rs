//! Mass, centre of mass and inertia of bodies, and of homogeneous solids.

use super::scene::Shape;
use nalgebra::{Isometry3, Matrix3, Vector3};
use std::f64::consts::PI;

/// Mass, centre of mass and inertia of a body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Inertial {
    /// Mass of the body in kilograms.
    pub mass: f64,
    /// The centre of mass of the body, in the frame of the body.
    pub centre: Vector3<f64>,
    /// The inertia about the centre of mass, along the axes of the body's frame.
    pub inertia: Matrix3<f64>,
}

impl Inertial {
    /// Returns the mass properties in another frame, in which the body's frame has the pose `at`.
    pub fn placed(self, at: &Isometry3<f64>) -> Self {
        let turn = at.rotation.to_rotation_matrix().into_inner();
        Self {
            centre: at.transform_point(&self.centre.into()).coords,
            inertia: turn * self.inertia * turn.transpose(),
            ..self
        }
    }

    /// Returns the mass properties of this part and another part together (theorem of Huygens and Steiner).
    pub fn with(self, other: Self) -> Self {
        let mass = self.mass + other.mass;
        if mass <= 0.0 {
            return self;
        }
        let centre = (self.centre * self.mass + other.centre * other.mass) / mass;
        let about = |part: &Self| {
            let arm = part.centre - centre;
            part.inertia + (Matrix3::identity() * arm.norm_squared() - arm * arm.transpose()) * part.mass
        };
        Self { mass, centre, inertia: about(&self) + about(&other) }
    }

    /// Returns the mass properties with mass and inertia multiplied by `factor`.
    pub fn scaled(self, factor: f64) -> Self {
        Self { mass: self.mass * factor, inertia: self.inertia * factor, ..self }
    }
}

impl Shape {
    /// Returns the volume of a shape, and the moments of inertia per unit of mass of the homogeneous solid of that
    /// shape, along the axes of the shape; `None` for a half-space.
    pub fn solid(&self) -> Option<(f64, Vector3<f64>)> {
        let round = |across: f64, along: f64| Vector3::new(across, across, along);
        Some(match *self {
            Self::Sphere { radius: r } => (4.0 / 3.0 * PI * r.powi(3), Vector3::repeat(0.4 * r * r)),
            Self::Ellipsoid { radii: r } => {
                let [x, y, z] = [r.x * r.x, r.y * r.y, r.z * r.z];
                (4.0 / 3.0 * PI * r.product(), Vector3::new(y + z, x + z, x + y) / 5.0)
            }
            Self::Box { size: s } => {
                let [x, y, z] = [s.x * s.x, s.y * s.y, s.z * s.z];
                (s.product(), Vector3::new(y + z, x + z, x + y) / 12.0)
            }
            Self::Cylinder { radius: r, length: l } => {
                (PI * r * r * l, round((3.0 * r * r + l * l) / 12.0, 0.5 * r * r))
            }
            Self::Capsule { radius: r, length: l } => {
                let (tube, ball) = (PI * r * r * l, 4.0 / 3.0 * PI * r.powi(3));
                let volume = tube + ball;
                let along = (tube * 0.5 + ball * 0.4) * r * r;
                // The centres of mass of the half balls are 3 r/8 from their bases, which are l/2 from the centre of
                // the capsule.
                let of_balls = ball * (0.4 * r * r + 0.25 * l * l + 0.375 * l * r);
                let across = tube * (3.0 * r * r + l * l) / 12.0 + of_balls;
                (volume, round(across, along) / volume)
            }
            Self::HalfSpace => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_capsule_is_a_tube_and_two_halves_of_a_ball() {
        // Midpoint rule over thin slices of the capsule across its axis.
        let (r, l) = (0.3, 1.1);
        let (slices, half) = (200_000, 0.5 * l + r);
        let (mut volume, mut along, mut across) = (0.0, 0.0, 0.0);
        for k in 0..slices {
            let z = -half + 2.0 * half * (f64::from(k) + 0.5) / f64::from(slices);
            let beyond = (z.abs() - 0.5 * l).max(0.0);
            let square = r * r - beyond * beyond;
            let slice = PI * square * 2.0 * half / f64::from(slices);
            volume += slice;
            along += slice * 0.5 * square;
            across += slice * (0.25 * square + z * z);
        }
        let (of, moments) = Shape::Capsule { radius: r, length: l }.solid().unwrap();
        assert!((of - volume).abs() < 1e-8 * volume);
        assert!((moments.z - along / volume).abs() < 1e-8 && (moments.x - across / volume).abs() < 1e-8);
    }

    #[test]
    fn two_halves_of_a_rod_are_the_rod() {
        let rod = |length: f64, mass: f64, x: f64| Inertial {
            mass,
            centre: Vector3::new(x, 0.0, 0.0),
            inertia: Matrix3::from_diagonal(&Vector3::new(0.0, 1.0, 1.0)) * (mass * length * length / 12.0),
        };
        let whole = rod(1.0, 1.5, -0.5).with(rod(1.0, 1.5, 0.5));
        assert!((whole.inertia - rod(2.0, 3.0, 0.0).inertia).amax() < 1e-15 && whole.centre.norm() < 1e-15);
    }
}
