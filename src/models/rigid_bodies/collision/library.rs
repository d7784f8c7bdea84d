//! Contact points, by the collision library, of pairs of shapes without a closed form. Contact manifolds are computed
//! anew each time, because the library's update of existing manifolds uses tolerances that are too coarse.

use super::{ContactPoint, Part};
use crate::rigid_bodies::shape::Shape;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use parry3d_f64::math::{Pose, Rot3, Vector};
use parry3d_f64::query::{ContactManifold, DefaultQueryDispatcher, PersistentQueryDispatcher};
use std::f64::consts::FRAC_PI_2;

pub(super) fn contacts(
    (first, at_first): (&Part, &Isometry3<f64>),
    (second, at_second): (&Part, &Isometry3<f64>),
    margin: f64,
    points: &mut Vec<ContactPoint>,
) {
    let (Some(a), Some(b)) = (&first.library, &second.library) else { return };
    let (at_a, at_b) = (turned(&first.shape, at_first), turned(&second.shape, at_second));
    let relative = library_pose(&(at_a.inverse() * at_b));
    let mut manifolds: Vec<ContactManifold<(), ()>> = Vec::new();
    let found = DefaultQueryDispatcher.contact_manifolds(&relative, &**a, &**b, margin, &mut manifolds, &mut None);
    if found.is_err() {
        return;
    }
    for (m, manifold) in manifolds.iter().enumerate() {
        let normal = at_a.rotation * vector(manifold.local_n1);
        for (k, contact) in manifold.points.iter().enumerate().filter(|(_, contact)| contact.dist <= margin) {
            let surface = at_a.rotation * vector(contact.local_p1) + at_a.translation.vector;
            let position = surface + normal * (0.5 * contact.dist);
            // Meshes have one contact manifold per face, other shapes a single one.
            points.push(ContactPoint { position, normal, gap: contact.dist, id: (m << 8 | k) as u64, feature: 0 });
        }
    }
}

/// Returns the pose of a shape in the convention of the collision library, where the axis of a cylinder is y instead
/// of z.
fn turned(shape: &Shape, at: &Isometry3<f64>) -> Isometry3<f64> {
    match shape {
        Shape::Cylinder { .. } => {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
            Isometry3::from_parts(at.translation, at.rotation * turn)
        }
        _ => *at,
    }
}

/// Converts a pose from the type of `nalgebra` to that of the collision library.
pub(in super::super) fn library_pose(at: &Isometry3<f64>) -> Pose {
    let (t, q) = (at.translation.vector, at.rotation);
    Pose::from_parts(Vector::new(t.x, t.y, t.z), Rot3::from_xyzw(q.i, q.j, q.k, q.w))
}

fn vector(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}
