//! Forces and torques on a body as programs in time and in the motion of bodies.
//!
//! Over a step they are taken in its middle, with the mean velocities: their work is `f . v + l . w`, exactly what they change
//! the kinetic energy by. Newton's method knows the derivative by the velocity and the place of the body itself; what depends on
//! orientations or on other bodies converges by iteration, as long as it changes little within a step.

use super::frame::Frame;
use super::midpoint::{apart, join};
use super::motion::Motion;
use super::outputs::{OF_BODY, state};
use super::scene::Body;
use expression::Tape;
use nalgebra::{Isometry3, Matrix3, Matrix6, Vector3, Vector6};

/// The numbers of a body that its own programs are derived by: place and velocity of its origin, and angular velocity.
pub const DERIVED: [usize; 9] = [0, 1, 2, 7, 8, 9, 10, 11, 12];

/// The outputs of a program: a force, a torque, and the derivatives of each of the six.
pub const OUTPUTS: usize = 6 * (1 + DERIVED.len());

/// A force and a torque.
#[derive(Clone, Debug)]
pub struct Action {
    /// The body that it acts on, and then those that the program asks for; places in the scene, and their centres of mass in the
    /// frames of the user.
    pub bodies: Vec<(usize, Vector3<f64>)>,
    /// Force, torque, and their derivatives by what is [`DERIVED`], in the inputs `t` and, of each body, what is told of it.
    pub program: Tape,
    /// Where the force acts, from the centre of mass, in the frame of the body.
    pub at: Vector3<f64>,
    /// Whether its components are along the axes of the body.
    pub is_local: bool,
}

/// A body in the middle of a step.
#[derive(Clone, Copy, Debug)]
pub struct Middle {
    /// Its centre of mass and orientation.
    pub pose: Isometry3<f64>,
    /// Its mean velocities.
    pub velocities: Vector6<f64>,
}

impl Middle {
    /// That of a motion from a start, with mean frames.
    pub fn new(start: &Motion, end: &Motion, mean: &Frame, velocities: &Vector6<f64>) -> Self {
        let half = start.pose.rotation.nlerp(&end.pose.rotation, 0.5);
        Self { pose: Isometry3::from_parts(mean.at.into(), half), velocities: *velocities }
    }
}

impl Action {
    /// Force and torque about the centre of mass, and their derivative by the mean velocities of a step `h`; `middles` are its
    /// bodies, in its order.
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
            // The origin is at `x - o` and has the velocity `v - w x o`; the centre of mass is half a step on its way.
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

    /// Whether its force is finite with the bodies as they are at the start.
    pub fn is_finite_at(&self, t: f64, bodies: &[Body]) -> bool {
        let of = |&(place, _): &(usize, Vector3<f64>)| {
            let body = &bodies[place];
            Middle { pose: body.pose, velocities: join(&body.velocity, &body.omega) }
        };
        let (force, _) = self.clone().evaluate(t, 0.0, self.bodies.iter().map(of), &mut Vec::new());
        force.iter().all(|force| force.is_finite())
    }
}

/// The inputs of the numbers of a body, by its place in an action.
pub const fn inputs_of(place: usize) -> usize {
    1 + place * OF_BODY.len()
}
