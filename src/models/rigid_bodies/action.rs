//! Forces and torques on a body as functions of time and of the motion of bodies.
//!
//! A time step evaluates the forces and torques at its midpoint, with mean velocities: their work `f . v + l . w` is
//! then exactly the change of the kinetic energy. Newton's method uses the derivatives of force and torque with
//! respect to velocity and position of the body on which they act. Terms that depend on orientations or on other
//! bodies are treated by fixed-point iteration, which converges if the terms change little within a step.

use super::frame::Frame;
use super::midpoint::{apart, join};
use super::motion::Motion;
use super::outputs::{OF_BODY, state};
use super::scene::Body;
use expression::Tape;
use nalgebra::{Isometry3, Matrix3, Matrix6, Vector3, Vector6};

/// The state components of a body with respect to which the forces on bodies are differentiated: position and velocity
/// of the origin of the body frame, and angular velocity; indices into [`OF_BODY`].
pub const DERIVED: [usize; 9] = [0, 1, 2, 7, 8, 9, 10, 11, 12];

/// The number of outputs of the compiled expressions of a motion-dependent force: force, torque, and the derivatives of
/// their six components.
pub const OUTPUTS: usize = 6 * (1 + DERIVED.len());

/// A user-defined force and torque on a body that depend on time and on the motion of bodies.
#[derive(Clone, Debug)]
pub struct Action {
    /// The body on which force and torque act, then the other bodies on whose motion they depend: indices in the
    /// multibody system, and centres of mass in the user's body frames.
    pub bodies: Vec<(usize, Vector3<f64>)>,
    /// The compiled expressions of force, torque, and their derivatives with respect to the [`DERIVED`] state
    /// components. Inputs are `t` and the state of each body.
    pub program: Tape,
    /// The point of application of the force relative to the body's centre of mass, in the body frame.
    pub at: Vector3<f64>,
    /// Whether force and torque are given in the frame of the body rather than in world axes.
    pub is_local: bool,
}

/// The state of a body at the midpoint of a time step.
#[derive(Clone, Copy, Debug)]
pub struct Middle {
    /// The position of the centre of mass and the orientation of the body.
    pub pose: Isometry3<f64>,
    /// The mean velocity and mean angular velocity of the body over the step.
    pub velocities: Vector6<f64>,
}

impl Middle {
    /// Computes the state of a body at the midpoint between its motions at both ends of a step, with the mean frame and
    /// the mean velocities.
    pub fn new(start: &Motion, end: &Motion, mean: &Frame, velocities: &Vector6<f64>) -> Self {
        let half = start.pose.rotation.nlerp(&end.pose.rotation, 0.5);
        Self { pose: Isometry3::from_parts(mean.at.into(), half), velocities: *velocities }
    }
}

impl Action {
    /// Evaluates force and torque about the centre of mass, and their derivative with respect to the mean velocities of
    /// the bodies in a step of size `h`; `middles` are the states of the bodies at the midpoint, in the order of
    /// `bodies`.
    pub fn evaluate(
        &mut self,
        t: f64,
        h: f64,
        middles: impl Iterator<Item = Middle>,
        inputs: &mut Vec<f64>,
    ) -> (Vector6<f64>, Matrix6<f64>) {
        inputs.clear();
        let mut turn = Matrix3::identity();
        for (k, (middle, (_, centre))) in middles.zip(&self.bodies).enumerate() {
            let (velocity, omega) = apart(&middle.velocities);
            inputs.extend(state(centre, &middle.pose, &velocity, &omega));
            if k == 0 {
                turn = middle.pose.rotation.to_rotation_matrix().into_inner();
            }
        }
        let mut out = [0.0; OUTPUTS];
        self.program.evaluate(t, inputs, &mut out);
        let (values, derivatives) = out.split_at(6);
        let part = |k: usize, column: usize| Vector3::from_fn(|i, _| derivatives[(3 * k + i) * DERIVED.len() + column]);
        let block = |k: usize, column: usize| {
            Matrix3::from_columns(&[part(k, column), part(k, column + 1), part(k, column + 2)])
        };
        let axes = if self.is_local { turn } else { Matrix3::identity() };
        let (arm, origin) = (turn * self.at, turn * self.bodies[0].1);
        let force = axes * Vector3::from_column_slice(&values[..3]);
        let torque = axes * Vector3::from_column_slice(&values[3..]) + arm.cross(&force);
        let mut matrix = Matrix6::zeros();
        for k in 0..2 {
            // The origin of the user's body frame is at `x - o` with velocity `v - w x o`, where `o` is the vector from
            // the origin to the centre of mass `x`; at the midpoint of the step, the centre of mass has moved by
            // `v h / 2`.
            let by_velocity = axes * (block(k, 3) + block(k, 0) * (0.5 * h));
            let by_omega = axes * (block(k, 6) + (block(k, 3) + block(k, 0) * (0.5 * h)) * origin.cross_matrix());
            matrix.fixed_view_mut::<3, 3>(3 * k, 0).copy_from(&by_velocity);
            matrix.fixed_view_mut::<3, 3>(3 * k, 3).copy_from(&by_omega);
        }
        let lever = arm.cross_matrix() * matrix.fixed_view::<3, 6>(0, 0);
        let mut torques = matrix.fixed_view_mut::<3, 6>(3, 0);
        torques += lever;
        (join(&force, &torque), matrix)
    }

    /// Returns whether force and torque are finite at the initial states of the bodies.
    pub fn is_finite_at(&self, t: f64, bodies: &[Body]) -> bool {
        let of = |&(place, _): &(usize, Vector3<f64>)| {
            let body = &bodies[place];
            Middle { pose: body.pose, velocities: join(&body.velocity, &body.omega) }
        };
        let (force, _) = self.clone().evaluate(t, 0.0, self.bodies.iter().map(of), &mut Vec::new());
        force.iter().all(|force| force.is_finite())
    }
}

/// Returns the index of the first input of the compiled expressions with the state of a body, given its index in
/// [`Action::bodies`].
pub const fn inputs_of(place: usize) -> usize {
    1 + place * OF_BODY.len()
}
