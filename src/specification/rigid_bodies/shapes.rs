//! Shapes of rigid bodies, as the user writes them.

use super::vectors::{self, Vector};
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use crate::range;
use models::rigid_bodies::{Polyhedron, Shape};
use nalgebra::{Isometry3, Vector3};
use serde::Deserialize;
use utoipa::ToSchema;

/// The shape of a body, in the frame of the body. Lengths in metres.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RigidShape {
    /// A sphere.
    Sphere(SphereShape),
    /// A box.
    Box(BoxShape),
    /// A cylinder along z with a hemisphere at either end.
    Capsule(CapsuleShape),
    /// A circular cylinder along z.
    Cylinder(CylinderShape),
    /// The convex hull of points.
    ConvexHull(HullShape),
    /// A half space, below a plane; for fixed bodies and bodies with `motion`.
    HalfSpace(HalfSpaceShape),
    /// A triangulated surface; for fixed bodies and bodies with `motion`.
    TriangleMesh(MeshShape),
    /// Several shapes joined rigidly; at most 1,000. Their masses add up, also where they overlap.
    Compound(Vec<CompoundPart>),
}

/// A part of a compound shape.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CompoundPart {
    /// The shape of the part; not a compound itself.
    #[schema(no_recursion)]
    pub shape: RigidShape,
    /// Origin of the frame of the part, in the frame of the body. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub position: Option<Vector>,
    /// Orientation of the part relative to the body, a unit quaternion `[w, x, y, z]`. Default `[1, 0, 0, 0]`.
    pub orientation: Option<[Expression; 4]>,
}

/// A sphere with its centre at the position of the body.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SphereShape {
    /// Radius of the sphere in metres, above 0.
    pub radius: Expression,
}

/// A box with its centre at the position of the body.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxShape {
    /// Lengths of the sides of the box along x, y and z, in metres, above 0.
    #[schema(value_type = [Expression; 3])]
    pub size: Vector,
}

/// A capsule with its centre at the position of the body.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CapsuleShape {
    /// Radius of the capsule in metres, above 0.
    pub radius: Expression,
    /// Length of the cylindrical part in metres, above 0; the total length is greater by twice the radius.
    pub length: Expression,
}

/// A cylinder with its centre at the position of the body.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CylinderShape {
    /// Radius of the cylinder in metres, above 0.
    pub radius: Expression,
    /// Length of the cylinder in metres, above 0.
    pub length: Expression,
}

/// The convex hull of points. The origin of the frame of the points need not be the centre of mass.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct HullShape {
    /// The points of the hull, at least four, not in one plane; at most 1,000.
    #[schema(value_type = Vec<[Expression; 3]>)]
    pub points: Vec<Vector>,
}

/// All points `x` with `normal . x <= 0`, in the frame of the body.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct HalfSpaceShape {
    /// The outward normal of the boundary plane of the half space.
    #[schema(value_type = [Expression; 3])]
    pub normal: Vector,
}

/// A triangulated surface.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MeshShape {
    /// The vertices of the surface.
    #[schema(value_type = Vec<[Expression; 3]>)]
    pub vertices: Vec<Vector>,
    /// Three vertex indices per triangle, counted from 0, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// Largest number of parts of a compound shape: each part is tested for contact with each part of another body.
const MOST_PARTS: usize = 1_000;

/// Largest number of points of a convex hull: each costs time at every contact.
const MOST_POINTS: usize = 1_000;

impl RigidShape {
    /// Returns the single shapes that the shape of the body consists of, with their poses in the frame of the body;
    /// `None` if one is faulty.
    pub(super) fn parts(&self, place: &Pointer<'_>, lowering: &mut Lowering) -> Option<Vec<(Shape, Isometry3<f64>)>> {
        let Self::Compound(parts) = self else {
            return Some(vec![(self.lower(place, lowering)?, Isometry3::identity())]);
        };
        let place = place.key("compound");
        if parts.is_empty() || parts.len() > MOST_PARTS {
            let detail = format!("{} shapes", parts.len());
            let error = SpecificationError::new(place.to_string(), "wrong_count", detail);
            lowering.errors.push(error.expected(format!("from 1 to {MOST_PARTS} shapes")));
            return None;
        }
        let lower = |(k, part): (usize, &CompoundPart)| {
            let place = place.index(k);
            let shape = part.shape.lower(&place.key("shape"), lowering);
            let position = part.position.as_ref();
            let at = position.map_or_else(Vector3::zeros, |at| vectors::lower(at, &place.key("position"), lowering));
            let turn = vectors::orientation(part.orientation.as_ref(), &place.key("orientation"), lowering).0;
            Some((shape?, Isometry3::from_parts(at.into(), turn)))
        };
        let all: Vec<_> = parts.iter().enumerate().map(lower).collect();
        all.into_iter().collect()
    }

    /// Builds a single shape of a rigid body, if its description is valid.
    fn lower(&self, place: &Pointer<'_>, lowering: &mut Lowering) -> Option<Shape> {
        let length = |value: &Expression, place: &Pointer<'_>, key: &str, lowering: &mut Lowering| {
            range::positive(value, key, &place.key(key), lowering)
        };
        match self {
            Self::Sphere(sphere) => {
                let place = place.key("sphere");
                Some(Shape::Sphere { radius: length(&sphere.radius, &place, "radius", lowering) })
            }
            Self::Capsule(CapsuleShape { radius, length: long }) => {
                let place = place.key("capsule");
                let radius = length(radius, &place, "radius", lowering);
                Some(Shape::Capsule { radius, half_height: 0.5 * length(long, &place, "length", lowering) })
            }
            Self::Cylinder(CylinderShape { radius, length: long }) => {
                let place = place.key("cylinder");
                let radius = length(radius, &place, "radius", lowering);
                Some(Shape::Cylinder { radius, half_height: 0.5 * length(long, &place, "length", lowering) })
            }
            Self::Box(cuboid) => {
                let (place, size) = (place.key("box"), &cuboid.size);
                let place = place.key("size");
                let side =
                    |i: usize, lowering: &mut Lowering| range::positive(&size[i], "side", &place.index(i), lowering);
                let half = Vector3::new(side(0, lowering), side(1, lowering), side(2, lowering)) * 0.5;
                Some(Shape::Polyhedron(Polyhedron::cuboid(half)))
            }
            Self::ConvexHull(hull) => hull.lower(&place.key("convex_hull").key("points"), lowering),
            Self::HalfSpace(HalfSpaceShape { normal }) => {
                let normal = vectors::direction(normal, &place.key("half_space").key("normal"), lowering);
                Some(Shape::HalfSpace { normal: normal.into_inner() })
            }
            Self::TriangleMesh(mesh) => mesh.lower(&place.key("triangle_mesh"), lowering),
            Self::Compound(_) => {
                let detail = "a part of a compound is itself a compound";
                let error = SpecificationError::new(place.to_string(), "conflict", detail);
                lowering.errors.push(error.expected("all shapes in one list"));
                None
            }
        }
    }
}

impl HullShape {
    fn lower(&self, place: &Pointer<'_>, lowering: &mut Lowering) -> Option<Shape> {
        if self.points.len() > MOST_POINTS {
            let detail = format!("{} points", self.points.len());
            let error = SpecificationError::new(place.to_string(), "too_many_points", detail);
            lowering.errors.push(error.expected(format!("at most {MOST_POINTS} points")));
            return None;
        }
        let points = corners(&self.points, place, lowering);
        let hull = Polyhedron::hull(&points).map(Shape::Polyhedron);
        if hull.is_none() && lowering.errors.is_empty() {
            let detail = format!("the hull of these {} points has no volume up to rounding", points.len());
            let error = SpecificationError::new(place.to_string(), "degenerate_hull", detail);
            lowering.errors.push(error.expected("at least four points, not in one plane"));
        }
        hull
    }
}

impl MeshShape {
    fn lower(&self, place: &Pointer<'_>, lowering: &mut Lowering) -> Option<Shape> {
        let vertices = corners(&self.vertices, &place.key("vertices"), lowering);
        let place = place.key("triangles");
        let report = |place: &Pointer<'_>, detail: String, expected: &str, lowering: &mut Lowering| {
            let error = SpecificationError::new(place.to_string(), "degenerate_mesh", detail);
            lowering.errors.push(error.expected(expected));
        };
        for (k, triangle) in self.triangles.iter().enumerate() {
            let at = |i: usize| vertices.get(triangle[i] as usize);
            let (Some(a), Some(b), Some(c)) = (at(0), at(1), at(2)) else {
                let detail = format!("there are {} vertices, and this triangle refers to {triangle:?}", vertices.len());
                report(&place.index(k), detail, "indices of vertices, counted from 0", lowering);
                continue;
            };
            let (ab, ac) = (b - a, c - a);
            if ab.cross(&ac).norm() <= 1e-12 * ab.norm_squared().max(ac.norm_squared()) {
                report(&place.index(k), "this triangle has no area".into(), "three corners not in line", lowering);
            }
        }
        if self.triangles.is_empty() {
            report(&place, "there are no triangles".into(), "at least one triangle", lowering);
        }
        if !lowering.errors.is_empty() {
            return None;
        }
        let mesh = Shape::mesh(&vertices, self.triangles.clone());
        if mesh.is_none() {
            let detail = "these triangles do not form an oriented surface".to_owned();
            report(&place, detail, "neighbours that traverse their common edge in opposite directions", lowering);
        }
        mesh
    }
}

fn corners(points: &[Vector], place: &Pointer<'_>, lowering: &mut Lowering) -> Vec<Vector3<f64>> {
    points.iter().enumerate().map(|(k, point)| vectors::lower(point, &place.index(k), lowering)).collect()
}
