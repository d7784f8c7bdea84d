//! Contact points of two bodies that touch or are close, with gap, normal and a persistent identity, by which
//! impulses of the last step are found for warm starts.
//!
//! Errors of gaps make bodies sink, and errors of normals misdirect contact forces. Gaps and normals are therefore
//! computed in closed form wherever possible: planes with all shapes, spheres with all shapes except meshes, capsules
//! with capsules, and convex polyhedra with each other by separating axes. All other pairs (cylinders and capsules
//! against polyhedra, meshes) are left to the collision library, whose normals have about half of the digits for
//! touching bodies.

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

/// A contact point between a first and a second body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactPoint {
    /// The midpoint between the surfaces of both bodies, in world coordinates, in metres.
    pub position: Vector3<f64>,
    /// The unit normal at the contact point, from the first body to the second.
    pub normal: Vector3<f64>,
    /// The distance between the surfaces of both bodies along the normal, negative for penetration.
    pub gap: f64,
    /// The identity number of the contact point within a pair of bodies, constant while the same faces, edges or
    /// vertices are in contact. The upper 32 bits identify the pair of parts.
    pub id: u64,
    /// The number of the smooth part of the surface (face, edge or vertex) that a sphere touches: between two smooth
    /// parts the curvature jumps.
    pub feature: u32,
}

impl ContactPoint {
    /// Returns the contact point with the roles of the two bodies exchanged.
    fn flipped(self) -> Self {
        Self { normal: -self.normal, ..self }
    }
}

/// The collision geometry of a body: one or several shapes, prepared for queries.
#[derive(Clone, Debug)]
pub struct Collider {
    parts: Vec<Part>,
    reach: f64,
}

/// One of the shapes of which a body consists.
#[derive(Clone, Debug)]
struct Part {
    shape: Shape,
    /// The shape in the form of the collision library; `None` for a half space, whose contacts have closed forms.
    library: Option<SharedShape>,
    /// The pose of the shape in the body frame; `None` for the identity.
    place: Option<Isometry3<f64>>,
}

impl Part {
    fn pose(&self, body: &Isometry3<f64>) -> Isometry3<f64> {
        self.place.map_or(*body, |place| body * place)
    }
}

impl Collider {
    /// Prepares the collision geometry of a body with a single shape, given in the body frame.
    pub fn new(shape: Shape) -> Self {
        Self::of_parts(vec![(shape, Isometry3::identity())])
    }

    /// Prepares the collision geometry of a body with several shapes, with their poses in the body frame.
    pub fn of_parts(parts: Vec<(Shape, Isometry3<f64>)>) -> Self {
        let far = |(shape, place): &(Shape, Isometry3<f64>)| place.translation.vector.norm() + shape.reach();
        let reach = parts.iter().map(far).fold(0.0, f64::max);
        let part = |(shape, place): (Shape, Isometry3<f64>)| Part {
            library: shape.library(),
            shape,
            place: (place != Isometry3::identity()).then_some(place),
        };
        Self { parts: parts.into_iter().map(part).collect(), reach }
    }

    /// Returns the largest distance of a point of the body from the origin of the body frame (an upper bound for
    /// several shapes); infinite for a half space.
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// Returns whether the body is invariant under rotations about an axis through the origin of the body frame.
    pub fn is_round_about(&self, axis: &Vector3<f64>) -> bool {
        // Two axes of rotation count as parallel if they differ by rounding errors only.
        let is_along = |of: &Vector3<f64>| axis.cross(of).norm() <= 1e-9 * axis.norm();
        self.parts.iter().all(|part| {
            part.place.is_none()
                && match &part.shape {
                    Shape::Sphere { .. } => true,
                    Shape::Capsule { .. } | Shape::Cylinder { .. } => is_along(&Vector3::z()),
                    Shape::HalfSpace { normal } => is_along(normal),
                    Shape::Polyhedron(_) | Shape::Mesh(_) => false,
                }
        })
    }

    /// Returns whether the surface of the body has no edges, as for spheres and capsules.
    pub fn is_smooth(&self) -> bool {
        self.parts.iter().all(|part| matches!(part.shape, Shape::Sphere { .. } | Shape::Capsule { .. }))
    }

    /// Returns whether contact points with another body persist while both bodies move: those of spheres, and of
    /// vertices and rims on a half space. Other contact points appear and vanish as features of the surfaces pass
    /// each other.
    pub fn keeps_points_with(&self, other: &Self) -> bool {
        let keeps = |part: &Part| matches!(part.shape, Shape::HalfSpace { .. } | Shape::Sphere { .. });
        self.parts.iter().all(keeps) || other.parts.iter().all(keeps)
    }

    /// Returns the lower and the upper corner of the body's axis-aligned bounding box in the world.
    pub fn bounds(&self, pose: &Isometry3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let mut bounds = self.parts.iter().map(|part| part.shape.bounds(&part.pose(pose)));
        let first = bounds.next().unwrap_or((pose.translation.vector, pose.translation.vector));
        bounds.fold(first, |(lower, upper), (least, greatest)| (lower.inf(&least), upper.sup(&greatest)))
    }
}

/// Appends the contact points of two bodies whose gaps are at most `margin >= 0`.
pub fn contacts(
    (first, at_first): (&Collider, &Isometry3<f64>),
    (second, at_second): (&Collider, &Isometry3<f64>),
    margin: f64,
    points: &mut Vec<ContactPoint>,
) {
    let room = Vector3::repeat(margin);
    let of_one = second.parts.len();
    for (i, a) in first.parts.iter().enumerate() {
        let at_a = a.pose(at_first);
        for (j, b) in second.parts.iter().enumerate() {
            let at_b = b.pose(at_second);
            let is_near = of_one * first.parts.len() == 1 || {
                let ((low_a, high_a), (low_b, high_b)) = (a.shape.bounds(&at_a), b.shape.bounds(&at_b));
                low_a - room <= high_b && low_b - room <= high_a
            };
            if !is_near {
                continue;
            }
            let start = points.len();
            contacts_of_parts((a, &at_a), (b, &at_b), margin, points);
            let pair = ((i * of_one + j) as u64) << 32;
            points[start..].iter_mut().for_each(|point| point.id |= pair);
        }
    }
}

fn contacts_of_parts(
    (first, at_first): (&Part, &Isometry3<f64>),
    (second, at_second): (&Part, &Isometry3<f64>),
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

/// Returns the rank by which the shapes of a pair are ordered: in a pair of shapes, the shape of lower rank comes
/// first.
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
