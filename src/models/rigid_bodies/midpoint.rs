//! The motion of bodies over a time step, determined by their mean velocities: the midpoint rule on the group of
//! positions `x` and orientations `Q`, with mean velocities `v` and `w`,
//!
//! ```text
//! x+ = x + h v,    Q+ = cay(h w) Q,    2 m (v - v-) = p,    Q+ J W+ - Q J W- = l,    (W- + W+) / 2 = Q^T w
//! ```
//!
//! with the impulse `p` and the angular impulse `l` of all forces over the step. The kinetic energy changes exactly by
//! `p . v + l . w`, and the angular momentum by `l` (Simo and Wong 1991, *Unconditionally stable algorithms for rigid
//! body dynamics that exactly preserve energy and momentum*). Centres of mass and vectors fixed in a body both
//! move along chords, so that a linkage in rigid rotation is integrated exactly as one rigid body.

use super::action::{Action, Middle};
use super::contact::Contact;
use super::frame::Frame;
use super::motion::Motion;
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// Newton's tolerance for the change of velocities in the mass norm, relative to the velocities. Convergence is
/// quadratic: after a change of 1.5e-8, the square root of the rounding unit, the next change is at rounding level.
/// The tolerance leaves a factor of 15 for the constant of convergence; a smaller tolerance would only add an
/// iteration without visible effect.
pub const CONVERGED: f64 = 1e-9;

/// Velocity scale of the rounding error of positions, as a multiple of position divided by step size: velocity changes
/// due to rounding are below [`CONVERGED`] relative to this scale.
const ROUNDING: f64 = 32.0 * f64::EPSILON / CONVERGED;

/// A Newton iterate of the implicit midpoint rule for a set of bodies.
#[derive(Debug)]
pub struct Midpoint {
    /// The time at the beginning of the step of the midpoint rule.
    pub t: f64,
    /// The step size of the midpoint rule, in seconds.
    pub h: f64,
    /// The motions of the bodies at the beginning of the step.
    pub start: Vec<Motion>,
    /// The mean velocities and angular velocities of the bodies over the step.
    pub mean: Vec<Vector6<f64>>,
    /// The impulses of constant forces on the bodies over the step.
    pub forces: Vec<Vector6<f64>>,
    /// The impulses of contacts on the bodies over the step.
    pub pushes: Vec<Vector6<f64>>,
    /// The motion-dependent forces on the bodies, with the indices of the bodies on which each depends.
    actions: Vec<(Action, Vec<u32>)>,
    /// The impulses of the motion-dependent forces on the bodies over the step, evaluated at the mean velocities.
    applied: Vec<Vector6<f64>>,
    /// The derivatives of the impulses of motion-dependent forces with respect to the mean velocities of their
    /// bodies.
    gradients: Vec<Matrix6<f64>>,
    /// The bodies with their poses at the end and their velocities at the beginning of the step.
    pub moved: Vec<Motion>,
    /// The frames of the bodies at the beginning of the step.
    pub starts: Vec<Frame>,
    /// The frames of the bodies at the end of the step.
    pub ends: Vec<Frame>,
    /// The mean frames of the bodies over the step.
    pub means: Vec<Frame>,
    /// The Cayley matrix `B = (I + [h w / 2]x + (h w / 2)(h w / 2)^T) / (1 + |h w / 2|^2)` of each body, with its mean
    /// angular velocity `w` over the step.
    pub turning: Vec<Matrix3<f64>>,
    inertia: Vec<Matrix3<f64>>,
}

/// Returns the velocity and the angular velocity of a body as one vector.
pub fn twist(motion: &Motion) -> Vector6<f64> {
    join(&motion.velocity, &motion.omega)
}

/// Joins a velocity and an angular velocity (or an impulse and an angular impulse) to one vector.
pub fn join(velocity: &Vector3<f64>, omega: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(velocity.x, velocity.y, velocity.z, omega.x, omega.y, omega.z)
}

/// Splits a vector of six components into velocity and angular velocity; inverse of [`join`].
pub fn apart(twist: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (twist.fixed_rows::<3>(0).into_owned(), twist.fixed_rows::<3>(3).into_owned())
}

impl Midpoint {
    /// Creates the first Newton iterate of the midpoint rule, from the bodies at the beginning of a step and the
    /// impulses of constant forces.
    pub fn new(
        start: Vec<Motion>,
        forces: Vec<Vector6<f64>>,
        actions: Vec<(Action, Vec<u32>)>,
        [t, h]: [f64; 2],
    ) -> Self {
        let mean = start.iter().zip(&forces).map(|(motion, force)| {
            let (push, twist_push) = apart(force);
            twist(motion) + join(&(push * (0.5 / motion.mass)), &(motion.mobility * twist_push * 0.5))
        });
        let starts: Vec<Frame> = start.iter().map(|motion| Frame::of(&motion.pose)).collect();
        let mut midpoint = Self {
            t,
            h,
            actions,
            applied: vec![Vector6::zeros(); start.len()],
            gradients: vec![Matrix6::zeros(); start.len()],
            mean: mean.collect(),
            pushes: vec![Vector6::zeros(); start.len()],
            moved: start.clone(),
            ends: starts.clone(),
            means: starts.clone(),
            turning: vec![Matrix3::identity(); start.len()],
            inertia: start.iter().map(Motion::inertia_in_world).collect(),
            start,
            forces,
            starts,
        };
        midpoint.arrive();
        midpoint
    }

    /// Sets the initial guess of the mean velocities of those bodies whose accelerations are known from the last step.
    pub fn extrapolate(&mut self, accelerations: &[Option<Vector6<f64>>]) {
        for ((mean, start), acceleration) in self.mean.iter_mut().zip(&self.start).zip(accelerations) {
            if let Some(acceleration) = acceleration {
                *mean = twist(start) + acceleration * (0.5 * self.h);
            }
        }
        if accelerations.iter().any(Option::is_some) {
            self.arrive();
        }
    }

    /// Updates poses and frames of the bodies at the end of the step, and motion-dependent forces, for the current mean
    /// velocities.
    pub fn arrive(&mut self) {
        for k in 0..self.start.len() {
            let (velocity, omega) = apart(&self.mean[k]);
            self.moved[k].pose = self.start[k].moved_by_chords(&velocity, &omega, self.h);
            self.ends[k] = Frame::of(&self.moved[k].pose);
            self.means[k] = self.starts[k].mean(&self.ends[k]);
            let half = omega * (0.5 * self.h);
            let numerator = Matrix3::identity() + half.cross_matrix() + half * half.transpose();
            self.turning[k] = numerator / (1.0 + half.norm_squared());
        }
        self.apply();
    }

    /// Evaluates the impulses of the motion-dependent forces over the step at the mean velocities.
    fn apply(&mut self) {
        self.applied.fill(Vector6::zeros());
        self.gradients.fill(Matrix6::zeros());
        let (t, h) = (self.t + 0.5 * self.h, self.h);
        let mut inputs = Vec::new();
        for (action, places) in &mut self.actions {
            let middle = |&place: &u32| {
                let k = place as usize;
                Middle::new(&self.start[k], &self.moved[k], &self.means[k], &self.mean[k])
            };
            let (force, gradient) = action.evaluate(t, h, places.iter().map(middle), &mut inputs);
            if let Some(&own) = places.first() {
                self.applied[own as usize] += force * h;
                self.gradients[own as usize] += gradient * h;
            }
        }
    }

    /// Returns the kinetic energy of the change of the impulses of motion-dependent forces between the mean velocities
    /// and `velocities`, those at the end of the step.
    pub fn stiffness_of_actions(&self, velocities: &[Vector6<f64>]) -> f64 {
        let energy = |k: usize| {
            let (push, twist_push) = apart(&(self.gradients[k] * (velocities[k] - self.mean[k])));
            let motion = &self.start[k];
            0.5 * (push.norm_squared() / motion.mass + twist_push.dot(&(motion.mobility * twist_push)))
        };
        if self.actions.is_empty() { 0.0 } else { (0..velocities.len()).map(energy).sum() }
    }

    /// Returns the work of the motion-dependent forces over the step.
    pub fn work_of_actions(&self) -> f64 {
        self.applied.iter().zip(&self.mean).map(|(impulse, mean)| impulse.dot(mean)).sum()
    }

    /// Returns the residual of the momentum balances of body `k` without joint forces, and its derivative with
    /// respect to the mean velocities of the body.
    pub fn balance(&self, k: usize) -> (Vector6<f64>, Matrix6<f64>) {
        let (motion, inertia, h) = (&self.start[k], &self.inertia[k], self.h);
        let (velocity, omega) = apart(&self.mean[k]);
        let momentum = inertia * omega;
        let change = self.turning[k] * (omega.cross(&momentum) * h + inertia * (omega - motion.omega) * 2.0);
        let linear = (velocity - motion.velocity) * (2.0 * motion.mass);
        // The derivative of the Cayley matrix `B` of a body's rotation over the step is `dB = B [h dw / 2]x B`.
        let inner = change.cross_matrix() * (-0.5 * h) - momentum.cross_matrix() * h
            + omega.cross_matrix() * inertia * h
            + inertia * 2.0;
        let mut matrix = Matrix6::zeros();
        matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::from_diagonal_element(2.0 * motion.mass));
        matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(&(self.turning[k] * inner));
        (join(&linear, &change) - self.forces[k] - self.pushes[k] - self.applied[k], matrix - self.gradients[k])
    }

    /// Returns the velocities of the bodies at the end of the step.
    pub fn end_velocities(&self) -> Vec<Vector6<f64>> {
        let end = |k: usize| {
            let (motion, (velocity, omega)) = (&self.start[k], apart(&self.mean[k]));
            let turn = self.moved[k].pose.rotation * motion.pose.rotation.inverse();
            join(&(velocity * 2.0 - motion.velocity), &(turn * (omega * 2.0 - motion.omega)))
        };
        (0..self.start.len()).map(end).collect()
    }

    /// Returns the bodies with their poses at the end and their velocities at the beginning of the step.
    pub fn moved_bodies(&self) -> Vec<Motion> {
        let moved = |motion: &Motion| {
            let mut moved = *motion;
            moved.arrive(&motion.pose, &motion.velocity, &motion.omega);
            moved
        };
        self.moved.iter().map(moved).collect()
    }

    /// Returns the kinetic energy of the given bodies at the end of the step, for given velocities of all bodies.
    pub fn kinetic_energy_at_end(&self, bodies: &[u32], velocities: &[Vector6<f64>]) -> f64 {
        let energy = |&body: &u32| {
            let mut motion = self.moved[body as usize];
            (motion.velocity, motion.omega) = apart(&velocities[body as usize]);
            motion.kinetic_energy()
        };
        bodies.iter().map(energy).sum()
    }

    /// Sets the impulses of contacts on the bodies from the given contact impulses.
    pub fn push(&mut self, contacts: &[Contact], impulses: &[Vector3<f64>]) {
        self.pushes.fill(Vector6::zeros());
        for (contact, impulse) in contacts.iter().zip(impulses) {
            for side in [0, 1] {
                if let Some(body) = contact.bodies[side] {
                    let (impulse, angular) = contact.wrench(side, impulse);
                    self.pushes[body as usize] += join(&impulse, &angular);
                }
            }
        }
    }

    /// Returns the squared velocity scale of Newton's convergence test, in the mass norm: the sum of initial
    /// velocities, mean velocities, velocity changes by forces, and rounding errors of positions divided by the step
    /// size.
    pub fn size(&self) -> f64 {
        let far = self.start.iter().map(|motion| motion.pose.translation.vector.amax()).fold(0.0, f64::max);
        let mass: f64 = self.start.iter().map(|motion| motion.mass).sum();
        let rounding = mass * (ROUNDING * far / self.h).powi(2);
        let kicked = |k: usize| {
            let (push, twist_push) = apart(&(self.forces[k] + self.applied[k]));
            push.norm_squared() / self.start[k].mass + twist_push.dot(&(self.start[k].mobility * twist_push))
        };
        let start: Vec<Vector6<f64>> = self.start.iter().map(twist).collect();
        rounding + self.weigh(&start) + self.weigh(&self.mean) + (0..self.start.len()).map(kicked).sum::<f64>()
    }

    /// Returns the squared mass norm of the given velocities at the initial poses, which is twice their kinetic energy.
    pub fn weigh(&self, velocities: &[Vector6<f64>]) -> f64 {
        let twice = |k: usize| {
            let (velocity, omega) = apart(&velocities[k]);
            self.start[k].mass * velocity.norm_squared() + omega.dot(&(self.inertia[k] * omega))
        };
        (0..velocities.len()).map(twice).sum()
    }
}
