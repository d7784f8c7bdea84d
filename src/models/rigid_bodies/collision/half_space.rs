//! A half space `n . x <= 0` against a convex body: the lowest points of the body, at their heights over the plane.
//!
//! A polyhedron has its vertices, a sphere and the caps of a capsule one point each. A cylinder has on each of its rims
//! the lowest point and, where the axis stands upright to within the flatness of the margin, the three others at right
//! angles to it, on which it then stands.

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
    // From a point of the core of the body, `radius` inside its surface.
    let mut lowest = |core: Vector3<f64>, radius: f64, id: u32| {
        let gap = n.dot(&(core - origin)) - radius;
        if gap <= margin {
            points.push(ContactPoint { position: core - n * (radius + 0.5 * gap), normal: n, gap, id: id.into() });
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
        // Neither moves: there is nothing to be found.
        Shape::HalfSpace { .. } | Shape::Mesh(_) => {}
    }
}
