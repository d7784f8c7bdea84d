//! The numbers that a scene puts out, by name.
//!
//! Of a body that moves: `x y z` the origin of its frame, `qw qx qy qz` its orientation, `vx vy vz` the velocity of that
//! origin, `wx wy wz` its angular velocity, all in the world. Then the energies and the contacts of the whole scene,
//! the contact forces of bodies for which they are asked for, and what joints with a name do.

use super::joint::Joint;
use super::motion::Motion;
use super::scene::{Body, MultibodySystem};
use analysis::{Analysis, Uniqueness};
use nalgebra::{Isometry3, Vector3};

/// What is told of a body.
pub const OF_BODY: [&str; 13] = ["x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz"];

/// What is told of the contacts of a body where it is asked for: their force on it, and their torque about its centre of mass.
const OF_CONTACTS: [&str; 6] = ["contact_fx", "contact_fy", "contact_fz", "contact_tx", "contact_ty", "contact_tz"];

/// What is told of the scene.
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
    /// The names of the states of the bodies that move.
    pub fn state_names(&self) -> Vec<String> {
        let moving = self.bodies.iter().filter(|body| !body.fixed);
        moving.flat_map(|body| OF_BODY.map(|key| format!("{}.{key}", body.name))).collect()
    }

    /// The names of all outputs.
    pub fn output_names(&self) -> Vec<String> {
        let contacts = self.bodies.iter().filter(|body| body.tells_contacts);
        let contacts = contacts.flat_map(|body| OF_CONTACTS.map(|key| format!("{}.{key}", body.name)));
        let joints = self.joints.iter().flat_map(Joint::output_names);
        self.state_names().into_iter().chain(OF_SCENE.map(str::to_owned)).chain(contacts).chain(joints).collect()
    }

    /// The states at the start.
    pub fn initial(&self) -> Vec<f64> {
        let moving = self.bodies.iter().filter(|body| !body.fixed);
        moving.flat_map(|body| state(&body.centre, &body.pose, &body.velocity, &body.omega)).collect()
    }

    /// What the theory says.
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

/// The thirteen numbers of a body with its centre of mass, so given in its frame, at a pose.
pub fn state(centre: &Vector3<f64>, pose: &Isometry3<f64>, velocity: &Vector3<f64>, omega: &Vector3<f64>) -> [f64; 13] {
    let offset = pose.rotation * centre;
    let (x, v) = (pose.translation.vector - offset, velocity - omega.cross(&offset));
    let q = pose.rotation.quaternion();
    [x.x, x.y, x.z, q.w, q.i, q.j, q.k, v.x, v.y, v.z, omega.x, omega.y, omega.z]
}

/// The numbers of a body a fraction of the way through a step `h`: on a parabola if nothing pushed it; else on a line,
/// with the velocities of the end.
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
