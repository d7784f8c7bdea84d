//! Restoration of the energy that the velocity projection removes in a step with an impact. The impulses of a contact
//! act at the mean frames of the step, and the joint constraints hold at its end: in between bodies have rotated by
//! about `h w`, so that the projection removes the energy of `h w` times the jump of velocities, whatever the
//! restitution. An instantaneous impact loses no energy beyond the work of its impulses. The energy `lost` in the
//! projection is therefore given back to the motion that the joints admit,
//!
//! ```text
//! v = v_r + s (v - v_r),    s^2 = 1 + lost / T(v - v_r)
//! ```
//!
//! where `v_r` is the motion of a free linkage as one rigid body with the momentum and the angular momentum of the
//! linkage; it is orthogonal to `v - v_r` in the mass norm, and zero if a joint is attached to the world. The joints
//! admit `v_r` and `v`, and therefore all of their combinations.

use super::super::super::linkage::Linked;
use super::super::super::midpoint::{apart, join};
use super::super::super::motion::Motion;
use nalgebra::{Matrix3, Vector3, Vector6};

/// Maximum energy lost in the velocity projection that is given back in one step, as a fraction of the energy of the
/// relative motion. A larger loss is that of a motion that the step does not resolve, such as rattling at its end.
const MOST: f64 = 0.1;

/// Gives the energy `lost` in the projection onto the joint constraints back to the bodies of a linkage at the end of a
/// step.
pub(super) fn restore(linked: &Linked<'_>, moved: &[Motion], velocities: &mut [Vector6<f64>], lost: f64) {
    if lost <= 0.0 || !linked.has_joints() || linked.is_driven() {
        return;
    }
    let places: Vec<usize> = linked.bodies.iter().map(|&body| body as usize).collect();
    let rigid = if linked.is_grounded() {
        vec![Vector6::zeros(); places.len()]
    } else {
        match rigid_motion(&places, moved, velocities) {
            Some(rigid) => rigid,
            None => return,
        }
    };
    let energy = |place: usize, velocities: &Vector6<f64>| {
        let (velocity, omega) = apart(velocities);
        let motion = &moved[place];
        0.5 * (motion.mass * velocity.norm_squared() + omega.dot(&(motion.inertia_in_world() * omega)))
    };
    let relative: f64 =
        places.iter().zip(&rigid).map(|(&place, rigid)| energy(place, &(velocities[place] - rigid))).sum();
    if relative > 0.0 && relative.is_finite() {
        let scale = (1.0 + (lost / relative).min(MOST)).sqrt();
        for (&place, rigid) in places.iter().zip(&rigid) {
            velocities[place] = rigid + (velocities[place] - rigid) * scale;
        }
    }
}

/// Returns the velocities of bodies that move as one rigid body with their momentum and angular momentum; `None` if
/// the bodies have no inertia about some axis.
fn rigid_motion(places: &[usize], moved: &[Motion], velocities: &[Vector6<f64>]) -> Option<Vec<Vector6<f64>>> {
    let (mut mass, mut first, mut momentum) = (0.0, Vector3::zeros(), Vector3::zeros());
    for &place in places {
        let motion = &moved[place];
        mass += motion.mass;
        first += motion.pose.translation.vector * motion.mass;
        momentum += apart(&velocities[place]).0 * motion.mass;
    }
    let (centre, velocity) = (first / mass, momentum / mass);
    let (mut inertia, mut angular) = (Matrix3::zeros(), Vector3::zeros());
    for &place in places {
        let (motion, (v, w)) = (&moved[place], apart(&velocities[place]));
        let arm = motion.pose.translation.vector - centre;
        let own = motion.inertia_in_world();
        inertia += own + (Matrix3::identity() * arm.norm_squared() - arm * arm.transpose()) * motion.mass;
        angular += own * w + arm.cross(&(v - velocity)) * motion.mass;
    }
    let omega = inertia.try_inverse()? * angular;
    let of = |&place: &usize| {
        let arm = moved[place].pose.translation.vector - centre;
        join(&(velocity + omega.cross(&arm)), &omega)
    };
    Some(places.iter().map(of).collect())
}
