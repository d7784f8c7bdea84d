//! The state of moving bodies: small contiguous records of pose, velocities and inertia, without names and shapes.

use super::rotation::rotate;
use super::scene::Body;
use nalgebra::{Isometry3, Matrix3, Quaternion, UnitQuaternion, Vector3, Vector6};
use std::f64::consts::TAU;

/// Deviation of a path from a motion with constant accelerations, relative to the distance covered, below which it is
/// treated as zero: ten times the tolerance of the contact law.
const EVEN: f64 = 1e-9;

/// Rounding error of a body's displacement, relative to its position, or of its rotation, relative to one radian.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// The state of a moving body: pose, velocities and inertia.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    /// The pose of the body frame, whose origin is the centre of mass.
    pub pose: Isometry3<f64>,
    /// The velocity of the body's centre of mass.
    pub velocity: Vector3<f64>,
    /// The angular velocity of the body in world axes.
    pub omega: Vector3<f64>,
    /// The mass of the body in kilograms.
    pub mass: f64,
    /// The inertia of the body about its centre of mass, in the body frame.
    pub inertia: Matrix3<f64>,
    inertia_inverse: Matrix3<f64>,
    /// The inverse inertia of the body in world axes, at the current pose.
    pub mobility: Matrix3<f64>,
    /// The time of the pose less the time of the velocities: half a step if the velocities are those of the midpoint of
    /// a step, else zero.
    pub lag: f64,
    /// Whether the inertia of the body is isotropic, so that it is constant in world axes.
    is_round: bool,
}

impl Motion {
    /// Returns the initial state of a body; `None` if its inertia is singular.
    pub fn new(body: &Body) -> Option<Self> {
        // Scale the inertia to unit size before inversion, since the determinant of a small inertia would underflow to
        // zero.
        let unit = body.inertia.amax();
        let inertia_inverse = (body.inertia / unit).try_inverse()? / unit;
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

    /// Changes the momentum of the body by an impulse at the centre of mass and an angular impulse.
    pub fn push(&mut self, impulse: &Vector3<f64>, angular: &Vector3<f64>) {
        self.velocity += impulse / self.mass;
        self.omega += self.mobility * angular;
    }

    /// Returns a copy of the body's motion with `by` added to the velocity.
    pub fn kicked(&self, by: &Vector3<f64>) -> Self {
        Self { velocity: self.velocity + by, ..*self }
    }

    /// Moves the body without forces for a time `h`; gyroscopic terms change its angular velocity.
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

    /// Moves the body under gravity for a time `h`, from its velocities at the beginning of this time to those at its
    /// end.
    pub fn fly(&mut self, h: f64, gravity: &Vector3<f64>) {
        let half = gravity * (0.5 * h);
        self.velocity += half;
        self.drift(h);
        self.velocity += half;
    }

    /// Returns a copy of the body's motion that has moved under gravity for a time `h`.
    pub fn flown(&self, h: f64, gravity: &Vector3<f64>) -> Self {
        let mut flown = *self;
        flown.fly(h, gravity);
        flown
    }

    /// Returns the body moved for a time `h` with the given velocities, after which `kick` is added to its velocity
    /// and `turn` to its angular momentum.
    pub fn moved(&self, [velocity, omega]: [&Vector3<f64>; 2], h: f64, [kick, turn]: [&Vector3<f64>; 2]) -> Self {
        let momentum = self.inertia_in_world() * self.omega + turn;
        let mut moved = *self;
        moved.displace(&(velocity * h), &(omega * h));
        moved.velocity += kick;
        moved.omega = moved.mobility * momentum;
        moved
    }

    /// Returns the inertia of the body in world axes, at the current pose.
    pub fn inertia_in_world(&self) -> Matrix3<f64> {
        if self.is_round {
            return self.inertia;
        }
        let rotation = self.pose.rotation.to_rotation_matrix();
        rotation.matrix() * self.inertia * rotation.matrix().transpose()
    }

    /// Returns the pose of the body after a time `h` with given mean velocities; the centre of mass and directions
    /// fixed in the body move along chords (Cayley's rotation).
    pub fn moved_by_chords(&self, velocity: &Vector3<f64>, omega: &Vector3<f64>, h: f64) -> Isometry3<f64> {
        let turn = UnitQuaternion::new_normalize(Quaternion::from_parts(1.0, omega * (0.5 * h)));
        let rotation = UnitQuaternion::new_normalize((turn * self.pose.rotation).into_inner());
        Isometry3::from_parts((self.pose.translation.vector + velocity * h).into(), rotation)
    }

    /// Sets pose and velocities of the body, which then belong to the same time (zero lag).
    pub fn arrive(&mut self, pose: &Isometry3<f64>, velocity: &Vector3<f64>, omega: &Vector3<f64>) {
        (self.pose, self.velocity, self.omega, self.lag) = (*pose, *velocity, *omega, 0.0);
        self.turn_mobility();
    }

    /// Returns the displacement and the rotation vector from the pose of this motion to the pose of another motion.
    pub fn way_to(&self, other: &Self) -> Vector6<f64> {
        let by = other.pose.translation.vector - self.pose.translation.vector;
        let turn = (other.pose.rotation * self.pose.rotation.inverse()).scaled_axis();
        Vector6::new(by.x, by.y, by.z, turn.x, turn.y, turn.z)
    }

    /// Returns the motion at a time `d` after this one, interpolated by a parabola to the motion `end` of the same
    /// body, which is at a time `s` after this one.
    pub fn between(&self, end: &Self, s: f64, d: f64) -> Self {
        let (part, way) = (d / s, self.way_to(end));
        let bend = |way: Vector3<f64>, rate: &Vector3<f64>| rate * d + (way - rate * s) * (part * part);
        let turn = whole_turns(way.fixed_rows::<3>(3).into_owned(), &((self.omega + end.omega) * (0.5 * s)));
        let mut between = *self;
        between.displace(&bend(way.fixed_rows::<3>(0).into_owned(), &self.velocity), &bend(turn, &self.omega));
        between.velocity = self.velocity.lerp(&end.velocity, part);
        between.omega = self.omega.lerp(&end.omega, part);
        between
    }

    /// Returns whether the motion to `end`, a time `s` later, has constant accelerations and a constant axis of
    /// rotation, up to tolerances relative to the velocities, to which the linear and angular velocities `least` are
    /// added.
    pub fn is_even(&self, end: &Self, s: f64, least: [f64; 2]) -> bool {
        let way = self.way_to(end);
        let mean = |from: &Vector3<f64>, to: &Vector3<f64>| (from + to) * (0.5 * s);
        let turned = mean(&self.omega, &end.omega);
        let turn = whole_turns(way.fixed_rows::<3>(3).into_owned(), &turned) - turned;
        let bend = way.fixed_rows::<3>(0) - mean(&self.velocity, &end.velocity);
        let speed = self.velocity.norm().max(end.velocity.norm()) + least[0];
        let spin = self.omega.norm().max(end.omega.norm()) + least[1];
        bend.norm() <= EVEN * s * speed + ROUNDING * self.pose.translation.vector.norm()
            && turn.norm() <= EVEN * s * spin + ROUNDING
            && self.omega.cross(&end.omega).norm() <= EVEN * spin * spin
    }

    /// Moves the pose of the body by a displacement and a rotation vector, without changing velocities.
    pub fn displace(&mut self, by: &Vector3<f64>, rotation: &Vector3<f64>) {
        self.pose.translation.vector += by;
        self.turn(rotation);
        self.turn_mobility();
    }

    fn turn(&mut self, rotation: &Vector3<f64>) {
        let turned = UnitQuaternion::from_scaled_axis(*rotation) * self.pose.rotation;
        self.pose.rotation = UnitQuaternion::new_normalize(turned.into_inner());
    }

    /// Returns the kinetic energy `(m v.v + w.J w) / 2` of the body, with mass `m` and inertia `J`.
    pub fn kinetic_energy(&self) -> f64 {
        let omega = self.pose.rotation.inverse() * self.omega;
        0.5 * (self.mass * self.velocity.norm_squared() + omega.dot(&(self.inertia * omega)))
    }

    /// Returns whether the state and the kinetic energy of the body are finite.
    pub fn is_finite(&self) -> bool {
        let sum = self.pose.translation.vector.sum() + self.pose.rotation.coords.sum();
        (sum + self.velocity.sum() + self.omega.sum() + self.kinetic_energy()).is_finite()
    }
}

/// Adds full turns to a rotation vector, so that it is as near as possible to another rotation vector.
fn whole_turns(turn: Vector3<f64>, near: &Vector3<f64>) -> Vector3<f64> {
    let Some(axis) = turn.try_normalize(0.0).or_else(|| near.try_normalize(0.0)) else { return turn };
    turn + axis * (TAU * ((near - turn).dot(&axis) / TAU).round())
}
