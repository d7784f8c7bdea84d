//! The bodies that move, as a step sees them: small records side by side, apart from names and shapes.

use super::rotation::rotate;
use super::scene::Body;
use nalgebra::{Isometry3, Matrix3, Quaternion, UnitQuaternion, Vector3, Vector6};

/// A body that moves.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    /// Of the frame at the centre of mass.
    pub pose: Isometry3<f64>,
    /// Of the centre of mass.
    pub velocity: Vector3<f64>,
    /// In the world.
    pub omega: Vector3<f64>,
    /// Kilograms.
    pub mass: f64,
    /// In the frame of the body.
    pub inertia: Matrix3<f64>,
    inertia_inverse: Matrix3<f64>,
    /// The inverse inertia in the world, at this pose.
    pub mobility: Matrix3<f64>,
    /// The time by which its velocity is behind its pose: half a step where the velocity is that of a step's middle.
    pub lag: f64,
    /// Whether the inertia is the same about every axis.
    is_round: bool,
}

impl Motion {
    /// A body at the start; `None` if its inertia cannot be inverted.
    pub fn new(body: &Body) -> Option<Self> {
        let inertia_inverse = body.inertia.try_inverse()?;
        let round = body.inertia - Matrix3::from_diagonal_element(body.inertia[(0, 0)]);
        let mut motion = Self {
            pose: body.pose,
            velocity: body.velocity,
            omega: body.omega,
            mass: body.mass,
            inertia: body.inertia,
            inertia_inverse,
            mobility: inertia_inverse,
            lag: 0.0,
            is_round: round.amax() <= 1e-14 * body.inertia[(0, 0)],
        };
        motion.turn_mobility();
        Some(motion)
    }

    fn turn_mobility(&mut self) {
        if !self.is_round {
            let rotation = self.pose.rotation.to_rotation_matrix();
            self.mobility = rotation.matrix() * self.inertia_inverse * rotation.matrix().transpose();
        }
    }

    /// Changes the momentum by an impulse at the centre of mass and an angular impulse.
    pub fn push(&mut self, impulse: &Vector3<f64>, angular: &Vector3<f64>) {
        self.velocity += impulse / self.mass;
        self.omega += self.mobility * angular;
    }

    /// The same with another velocity.
    pub fn kicked(&self, by: &Vector3<f64>) -> Self {
        Self { velocity: self.velocity + by, ..*self }
    }

    /// Moves freely for a time `h`, the angular velocity with the gyroscopic terms.
    pub fn drift(&mut self, h: f64) {
        self.pose.translation.vector += self.velocity * h;
        if self.omega == Vector3::zeros() {
            return;
        }
        if self.is_round {
            self.turn(&(self.omega * h));
            return;
        }
        let (turn, omega) = rotate(&self.inertia, &(self.pose.rotation.inverse() * self.omega), h);
        self.pose.rotation = UnitQuaternion::new_normalize((self.pose.rotation * turn).into_inner());
        self.omega = self.pose.rotation * omega;
        self.turn_mobility();
    }

    /// The inertia in the world, at this pose.
    pub fn inertia_in_world(&self) -> Matrix3<f64> {
        if self.is_round {
            return self.inertia;
        }
        let rotation = self.pose.rotation.to_rotation_matrix();
        rotation.matrix() * self.inertia * rotation.matrix().transpose()
    }

    /// The pose after a time `h` with these mean velocities, as centre and directions move on chords: by Cayley's rotation.
    pub fn moved_by_chords(&self, velocity: &Vector3<f64>, omega: &Vector3<f64>, h: f64) -> Isometry3<f64> {
        let turn = UnitQuaternion::new_normalize(Quaternion::from_parts(1.0, omega * (0.5 * h)));
        let rotation = UnitQuaternion::new_normalize((turn * self.pose.rotation).into_inner());
        Isometry3::from_parts((self.pose.translation.vector + velocity * h).into(), rotation)
    }

    /// Comes to be at a pose with these velocities.
    pub fn arrive(&mut self, pose: &Isometry3<f64>, velocity: &Vector3<f64>, omega: &Vector3<f64>) {
        (self.pose, self.velocity, self.omega, self.lag) = (*pose, *velocity, *omega, 0.0);
        self.turn_mobility();
    }

    /// The displacement and the rotation vector to another pose.
    pub fn way_to(&self, other: &Self) -> Vector6<f64> {
        let by = other.pose.translation.vector - self.pose.translation.vector;
        let turn = (other.pose.rotation * self.pose.rotation.inverse()).scaled_axis();
        Vector6::new(by.x, by.y, by.z, turn.x, turn.y, turn.z)
    }

    /// Moves by a displacement and a rotation vector, without a change of velocity.
    pub fn displace(&mut self, by: &Vector3<f64>, rotation: &Vector3<f64>) {
        self.pose.translation.vector += by;
        self.turn(rotation);
        self.turn_mobility();
    }

    fn turn(&mut self, rotation: &Vector3<f64>) {
        let turned = UnitQuaternion::from_scaled_axis(*rotation) * self.pose.rotation;
        self.pose.rotation = UnitQuaternion::new_normalize(turned.into_inner());
    }

    /// `(m v.v + w.J w) / 2`.
    pub fn kinetic_energy(&self) -> f64 {
        let omega = self.pose.rotation.inverse() * self.omega;
        0.5 * (self.mass * self.velocity.norm_squared() + omega.dot(&(self.inertia * omega)))
    }

    /// Whether every number of its state is finite, and its kinetic energy.
    pub fn is_finite(&self) -> bool {
        let sum = self.pose.translation.vector.sum() + self.pose.rotation.coords.sum();
        (sum + self.velocity.sum() + self.omega.sum() + self.kinetic_energy()).is_finite()
    }
}
