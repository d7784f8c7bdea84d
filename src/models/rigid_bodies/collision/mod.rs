//! Where two bodies touch or are about to: the points of their contact with gap, normal and an identity that persists, so
//! that impulses of the last step can be found again.
//!
//! A gap decides whether a body sinks, and a normal where its weight goes, so both are closed forms wherever there is
//! one: planes with everything, spheres with everything but meshes, capsules with capsules, and convex polyhedra with each
//! other by separating axes. The rest (cylinders and capsules against polyhedra, meshes) is left to the collision
//! library, whose normals are worth about half of the digits where bodies touch.

mod broad_phase;
mod half_space;
mod library;
mod polyhedra;
mod round;
#[cfg(test)]
mod tests;

pub use broad_phase::BroadPhase;
pub(super) use library::library_pose;

use super::shape::Shape;
use nalgebra::{Isometry3, Vector3};
use parry3d_f64::shape::SharedShape;

/// One point of contact between a first and a second body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactPoint {
    /// Midway between the two surfaces, in the world, in metres.
    pub position: Vector3<f64>,
    /// Unit normal, from the first body to the second.
    pub normal: Vector3<f64>,
    /// The distance of the surfaces along the normal, negative where they overlap.
    pub gap: f64,
    /// Tells the points of one pair of bodies apart, and stays the same while the same features touch.
    pub id: u32,
}

impl ContactPoint {
    /// The same contact with the bodies exchanged.
    fn flipped(self) -> Self {
        Self { normal: -self.normal, ..self }
    }
}

/// A shape ready for queries.
#[derive(Clone, Debug)]
pub struct Collider {
    /// The shape.
    pub shape: Shape,
    /// The same for the library; none for a half space.
    library: Option<SharedShape>,
}

impl Collider {
    /// Prepares a shape.
    pub fn new(shape: Shape) -> Self {
        Self { library: shape.library(), shape }
    }
}

/// Adds the points of two bodies whose gap is at most `margin`, which is above zero.
pub fn contacts(
    (first, at_first): (&Collider, &Isometry3<f64>),
    (second, at_second): (&Collider, &Isometry3<f64>),
    margin: f64,
    points: &mut Vec<ContactPoint>,
) {
    let start = points.len();
    let exchanged = rank(&first.shape) > rank(&second.shape);
    let ((a, at_a), (b, at_b)) =
        if exchanged { ((second, at_second), (first, at_first)) } else { ((first, at_first), (second, at_second)) };
    match (&a.shape, &b.shape) {
        (Shape::HalfSpace { normal }, other) => half_space::contacts((normal, at_a), (other, at_b), margin, points),
        (Shape::Sphere { .. }, Shape::Mesh(_)) => library::contacts((a, at_a), (b, at_b), margin, points),
        (Shape::Sphere { radius }, other) => round::sphere((*radius, at_a), (other, at_b), margin, points),
        (Shape::Capsule { .. }, Shape::Capsule { .. }) => {
            round::capsules((&a.shape, at_a), (&b.shape, at_b), margin, points);
        }
        (Shape::Polyhedron(p), Shape::Polyhedron(q)) => {
            if !polyhedra::contacts((p, at_a), (q, at_b), margin, points) {
                library::contacts((a, at_a), (b, at_b), margin, points);
            }
        }
        _ => library::contacts((a, at_a), (b, at_b), margin, points),
    }
    if exchanged {
        for point in &mut points[start..] {
            *point = point.flipped();
        }
    }
}

/// The order in which shapes take the first place.
fn rank(shape: &Shape) -> u8 {
    match shape {
        Shape::HalfSpace { .. } => 0,
        Shape::Sphere { .. } => 1,
        Shape::Capsule { .. } => 2,
        Shape::Polyhedron(_) => 3,
        Shape::Cylinder { .. } => 4,
        Shape::Mesh(_) => 5,
    }
}
