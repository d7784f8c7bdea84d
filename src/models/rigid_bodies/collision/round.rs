//! Contacts of spheres and capsules, which are balls about the nearest point of a core (point or segment). In
//! contact, the distance between the cores is still positive, so that the normal is accurate to rounding.

use super::ContactPoint;
use crate::rigid_bodies::polyhedron::Face;
use crate::rigid_bodies::shape::Shape;
use nalgebra::{Isometry3, Vector3};

/// Appends the contact point of a sphere with a convex shape other than a half space.
pub(super) fn sphere(
    (radius, at_sphere): (f64, &Isometry3<f64>),
    (shape, at): (&Shape, &Isometry3<f64>),
    margin: f64,
    points: &mut Vec<ContactPoint>,
) {
    let local = at.rotation.inverse() * (at_sphere.translation.vector - at.translation.vector);
    let Some((surface, outward, distance)) = nearest(shape, &local) else { return };
    let gap = distance - radius;
    if gap <= margin {
        let normal = -(at.rotation * outward);
        let position = at.rotation * surface + at.translation.vector - normal * (0.5 * gap);
        let feature = feature(shape, &local, &surface);
        points.push(ContactPoint { position, normal, gap, id: 0, feature });
    }
}

/// Distance of a point from the plane of a polyhedron's face, relative to the distance of the face from the centre,
/// below which the point counts as on the face.
const ON_FACE: f64 = 1e-12;

/// Returns the number of the smooth part of a surface that contains the point nearest to `p`: between two smooth
/// parts the curvature jumps.
fn feature(shape: &Shape, p: &Vector3<f64>, nearest: &Vector3<f64>) -> u32 {
    match shape {
        Shape::Capsule { half_height, .. } if p.z.abs() > *half_height => 1 + u32::from(p.z > 0.0),
        Shape::Cylinder { radius, half_height } => match (p.x.hypot(p.y) > *radius, p.z.abs() > *half_height) {
            (true, false) => 0,
            (is_outside, _) => 1 + u32::from(p.z > 0.0) + 2 * u32::from(is_outside),
        },
        // A face, an edge or a vertex of a polyhedron is identified by the faces that meet there.
        Shape::Polyhedron(polyhedron) => {
            let is_on = |face: &Face| {
                (face.normal.dot(nearest) - face.offset).abs() <= ON_FACE * (face.offset.abs() + nearest.norm())
            };
            let faces = polyhedron.faces.iter().enumerate().filter(|(_, face)| is_on(face));
            faces.fold(0, |id: u32, (k, _)| id.wrapping_mul(31).wrapping_add(1 + k as u32))
        }
        _ => 0,
    }
}

/// Returns the point of a surface nearest to `p`, the outward normal at the nearest point, and the signed distance,
/// all in the frame of the shape.
fn nearest(shape: &Shape, p: &Vector3<f64>) -> Option<(Vector3<f64>, Vector3<f64>, f64)> {
    let rounded = |core: Vector3<f64>, radius: f64| {
        let outward = direction(&(p - core));
        (core + outward * radius, outward, (p - core).norm() - radius)
    };
    match shape {
        Shape::Sphere { radius } => Some(rounded(Vector3::zeros(), *radius)),
        Shape::Capsule { radius, half_height } => {
            Some(rounded(Vector3::z() * p.z.clamp(-half_height, *half_height), *radius))
        }
        Shape::Cylinder { radius, half_height } => Some(nearest_on_cylinder(*radius, *half_height, p)),
        Shape::Polyhedron(polyhedron) => Some(polyhedron.nearest(p)),
        Shape::HalfSpace { .. } | Shape::Mesh(_) => None,
    }
}

fn nearest_on_cylinder(radius: f64, half_height: f64, p: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>, f64) {
    let rho = p.x.hypot(p.y);
    let radial = if rho > 0.0 { Vector3::new(p.x / rho, p.y / rho, 0.0) } else { Vector3::x() };
    let axial = Vector3::z() * if p.z < 0.0 { -1.0 } else { 1.0 };
    let (out, over) = (rho - radius, p.z.abs() - half_height);
    if out > 0.0 && over > 0.0 {
        let distance = out.hypot(over);
        return (radial * radius + axial * half_height, (radial * out + axial * over) / distance, distance);
    }
    if over > out { (p - axial * over, axial, over) } else { (p - radial * out, radial, out) }
}

/// Appends the contact points of two capsules: the nearest points of their segments, or the ends of the common range
/// of parallel segments.
pub(super) fn capsules(
    (first, at_first): (&Shape, &Isometry3<f64>),
    (second, at_second): (&Shape, &Isometry3<f64>),
    margin: f64,
    points: &mut Vec<ContactPoint>,
) {
    let (Shape::Capsule { radius: r1, half_height: l1 }, Shape::Capsule { radius: r2, half_height: l2 }) =
        (first, second)
    else {
        return;
    };
    let (d1, d2) = (at_first.rotation * Vector3::z(), at_second.rotation * Vector3::z());
    let (c1, c2) = (at_first.translation.vector, at_second.translation.vector);
    let mut touch = |s: f64, id: u32| {
        let p = c1 + d1 * s;
        let q = c2 + d2 * d2.dot(&(p - c2)).clamp(-l2, *l2);
        let p = c1 + d1 * d1.dot(&(q - c1)).clamp(-l1, *l1);
        let gap = (q - p).norm() - r1 - r2;
        if gap <= margin {
            let normal = direction(&(q - p));
            points.push(ContactPoint {
                position: p + normal * (r1 + 0.5 * gap),
                normal,
                gap,
                id: id.into(),
                feature: 0,
            });
        }
    };
    let (along, between) = (d1.dot(&d2), c2 - c1);
    let sine = 1.0 - along * along;
    if sine > PARALLEL {
        // Start from the stationary point of the distance between the lines through both segments.
        touch(((d1.dot(&between) - along * d2.dot(&between)) / sine).clamp(-l1, *l1), 0);
        return;
    }
    let (middle, half) = (d1.dot(&between), l2 * along.abs());
    let (lower, upper) = ((middle - half).clamp(-l1, *l1), (middle + half).clamp(-l1, *l1));
    touch(lower, 1);
    if upper > lower {
        touch(upper, 2);
    }
}

/// The squared sine of the angle below which the segments of two capsules count as parallel: 0.01 degrees.
const PARALLEL: f64 = 3e-8;

/// Returns the direction of a vector; an arbitrary direction for a zero vector.
fn direction(v: &Vector3<f64>) -> Vector3<f64> {
    v.try_normalize(0.0).unwrap_or_else(Vector3::z)
}
