//! The outputs of a multibody system and their names.
//!
//! For each moving body: `x y z` is the origin of its frame, `qw qx qy qz` its orientation, `vx vy vz` the velocity
//! of the origin, `wx wy wz` its angular velocity, all in world axes. Then follow energies and contacts of the whole
//! system, the contact forces of selected bodies, and the reactions of named joints.

use super::joint::Joint;
use super::motion::Motion;
use super::scene::{Body, MultibodySystem};
use analysis::{Analysis, Uniqueness};
use nalgebra::{Isometry3, Vector3};

/// The names of the state outputs of a body: position, orientation as a quaternion, velocity and angular velocity.
pub const OF_BODY: [&str; 13] = ["x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz"];

/// The names of the contact outputs of a body selected for output: the contact force on the body, and the torque about
/// its centre of mass.
const OF_CONTACTS: [&str; 6] = ["contact_fx", "contact_fy", "contact_fz", "contact_tx", "contact_ty", "contact_tz"];

/// The names of the outputs of the multibody system as a whole.
pub const OF_SCENE: [&str; 7] = [
    "kinetic_energy",
    "potential_energy",
    "dissipated_by_friction",
    "lost_in_impacts",
    "contacts",
    "penetration",
    "normal_impulse",
];

impl MultibodySystem {
    /// Returns the names of the states of all moving bodies of the system.
    pub fn state_names(&self) -> Vec<String> {
        let moving = self.bodies.iter().filter(|body| !body.fixed);
        moving.flat_map(|body| OF_BODY.map(|key| format!("{}.{key}", body.name))).collect()
    }

    /// Returns the names of all outputs of the multibody system.
    pub fn output_names(&self) -> Vec<String> {
        let contacts = self.bodies.iter().filter(|body| body.tells_contacts);
        let contacts = contacts.flat_map(|body| OF_CONTACTS.map(|key| format!("{}.{key}", body.name)));
        let joints = self.joints.iter().flat_map(Joint::output_names);
        self.state_names().into_iter().chain(OF_SCENE.map(str::to_owned)).chain(contacts).chain(joints).collect()
    }

    /// Returns the initial states of all moving bodies of the system.
    pub fn initial(&self) -> Vec<f64> {
        let moving = self.bodies.iter().filter(|body| !body.fixed);
        moving.flat_map(|body| state(&body.centre, &body.pose, &body.velocity, &body.omega)).collect()
    }

    /// Analyses index, existence and uniqueness of the motion according to the theory of measure differential
    /// inclusions.
    pub fn analyse(&self) -> Analysis {
        let because = "unilateral constraints on positions: velocities jump in impacts. A solution exists for the velocities \
                       and impulses (Monteiro Marques 1993, Stewart 1998); with friction it need not be unique";
        Analysis {
            index: Some(2.0),
            uniqueness: Uniqueness::ExistsNotCertified,
            because: because.to_owned(),
            ..Analysis::default()
        }
    }
}

/// Returns the state outputs ([`OF_BODY`]) of a body at a pose of its centre of mass; `centre` is the centre of mass in
/// the user's frame.
pub fn state(centre: &Vector3<f64>, pose: &Isometry3<f64>, velocity: &Vector3<f64>, omega: &Vector3<f64>) -> [f64; 13] {
    let offset = pose.rotation * centre;
    let (x, v) = (pose.translation.vector - offset, velocity - omega.cross(&offset));
    let q = pose.rotation.quaternion();
    [x.x, x.y, x.z, q.w, q.i, q.j, q.k, v.x, v.y, v.z, omega.x, omega.y, omega.z]
}

/// Returns the state outputs ([`OF_BODY`]) of a body with the given motion.
pub fn state_of(body: &Body, motion: &Motion) -> [f64; 13] {
    state(&body.centre, &motion.pose, &motion.velocity, &motion.omega)
}

/// Returns the state outputs ([`OF_BODY`]) of a body at a fraction of a step of size `h`. Positions follow a parabola
/// if no impulse acted on the body; otherwise a line, with the velocities at the end of the step.
pub fn between(body: &Body, [from, to]: [&Motion; 2], is_pushed: bool, h: f64, fraction: f64) -> [f64; 13] {
    if fraction >= 1.0 {
        return state(&body.centre, &to.pose, &to.velocity, &to.omega);
    }
    let mut at = from.pose.translation.vector.lerp(&to.pose.translation.vector, fraction);
    let (mut velocity, mut omega) = (to.velocity, to.omega);
    if !is_pushed {
        at -= (to.velocity - from.velocity) * (0.5 * h * fraction * (1.0 - fraction));
        velocity = from.velocity.lerp(&to.velocity, fraction);
        omega = from.omega.lerp(&to.omega, fraction);
    }
    let turn = (from.pose.rotation.inverse() * to.pose.rotation).scaled_axis() * fraction;
    let rotation = from.pose.rotation * nalgebra::UnitQuaternion::from_scaled_axis(turn);
    state(&body.centre, &Isometry3::from_parts(at.into(), rotation), &velocity, &omega)
}
