//! Contacts of a half space `n . x <= 0` with a convex body: the lowest points of the body, with their heights above
//! the plane.
//!
//! Candidates are the vertices of a polyhedron, one point of a sphere or of each cap of a capsule, and four points on
//! each rim of a cylinder: the lowest point and the three points at right angles to it, which are within the margin
//! if the axis is nearly upright.

use super::ContactPoint;
use crate::rigid_bodies::shape::Shape;
use nalgebra::{Isometry3, Vector3};

pub(super) fn contacts(
    (normal, at_plane): (&Vector3<f64>, &Isometry3<f64>),
    (shape, at): (&Shape, &Isometry3<f64>),
    margin: f64,
    points: &mut Vec<ContactPoint>,
) {
    let n = at_plane.rotation * normal;
    let origin = at_plane.translation.vector;
    // Appends the lowest point, towards the half space, of a ball with the given radius about a core point of the body.
    let mut lowest = |core: Vector3<f64>, radius: f64, id: u32| {
        let gap = n.dot(&(core - origin)) - radius;
        if gap <= margin {
            points.push(ContactPoint {
                position: core - n * (radius + 0.5 * gap),
                normal: n,
                gap,
                id: id.into(),
                feature: 0,
            });
        }
    };
    let centre = at.translation.vector;
    let axis = at.rotation * Vector3::z();
    match shape {
        Shape::Sphere { radius } => lowest(centre, *radius, 0),
        Shape::Capsule { radius, half_height } => {
            lowest(centre - axis * *half_height, *radius, 0);
            lowest(centre + axis * *half_height, *radius, 1);
        }
        Shape::Cylinder { radius, half_height } => {
            let tilt = axis * n.dot(&axis) - n;
            let steepness = tilt.norm();
            let down = if steepness > f64::EPSILON { tilt / steepness } else { at.rotation * Vector3::x() };
            let across = axis.cross(&down);
            for (rim, sign) in [(0, -1.0), (1, 1.0)] {
                let middle = centre + axis * (sign * half_height);
                for (k, direction) in [down, across, -across, -down].into_iter().enumerate() {
                    lowest(middle + direction * *radius, 0.0, 4 * rim + k as u32);
                }
            }
        }
        Shape::Polyhedron(polyhedron) => {
            for (k, vertex) in polyhedron.vertices.iter().enumerate() {
                lowest(at.rotation * vertex + centre, 0.0, k as u32);
            }
        }
        // Half spaces and meshes belong to bodies that do not move freely, so that two of them have no contacts.
        Shape::HalfSpace { .. } | Shape::Mesh(_) => {}
    }
}
