//! The shapes of bodies, in the body frame. For moving bodies, the origin of the body frame is the centre of mass.
//!
//! Volume, centre of mass and second moment `S = int x x^T dV` have closed forms; the inertia about the origin at
//! density `rho` is `rho (tr(S) I - S)`.

use super::polyhedron::Polyhedron;
use nalgebra::{Isometry3, Matrix3, Vector3};
use parry3d_f64::shape::{Capsule, ConvexPolyhedron, Cylinder, SharedShape, TriMesh};
use std::f64::consts::PI;

/// The shape of a body, with lengths in metres.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A ball whose centre is the origin of the body frame.
    Sphere {
        /// The radius of the ball.
        radius: f64,
    },
    /// A capsule: the points within `radius` of the segment from `-half_height` to `half_height` on the z axis.
    Capsule {
        /// The radius of the capsule's caps and barrel.
        radius: f64,
        /// Half of the distance between the centres of the capsule's caps.
        half_height: f64,
    },
    /// A circular cylinder about the z axis of the body frame.
    Cylinder {
        /// The radius of the cylinder's base.
        radius: f64,
        /// Half of the height of the cylinder.
        half_height: f64,
    },
    /// A convex polyhedron: a box or a convex hull of points.
    Polyhedron(Polyhedron),
    /// A half space: all points `x` of the body frame with `normal . x <= 0`.
    HalfSpace {
        /// The outward unit normal of the half space.
        normal: Vector3<f64>,
    },
    /// A triangle mesh, in the form of the collision library.
    Mesh(SharedShape),
}

impl Shape {
    /// Returns the name of the kind of shape in specifications and messages.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Sphere { .. } => "sphere",
            Self::Capsule { .. } => "capsule",
            Self::Cylinder { .. } => "cylinder",
            Self::Polyhedron(_) => "polyhedron",
            Self::HalfSpace { .. } => "half_space",
            Self::Mesh(_) => "triangle_mesh",
        }
    }

    /// Returns the volume of the shape, the centre of mass and the second moment `S` about the origin of the body
    /// frame; `None` for shapes without a volume.
    pub fn moments(&self) -> Option<(f64, Vector3<f64>, Matrix3<f64>)> {
        let (volume, radial, axial) = match self {
            Self::Sphere { radius } => {
                let volume = 4.0 / 3.0 * PI * radius.powi(3);
                (volume, volume * radius * radius / 5.0, volume * radius * radius / 5.0)
            }
            Self::Cylinder { radius, half_height } => {
                let volume = PI * radius * radius * 2.0 * half_height;
                (volume, volume * radius * radius / 4.0, volume * half_height * half_height / 3.0)
            }
            Self::Capsule { radius, half_height } => {
                let (r, l) = (*radius, *half_height);
                let (barrel, caps) = (PI * r * r * 2.0 * l, 4.0 / 3.0 * PI * r.powi(3));
                // The centroid of a half ball of radius `r`, a cap of the capsule, is at `3 r / 8` above its base.
                let axial = barrel * l * l / 3.0 + caps * (r * r / 5.0 + l * l + 2.0 * l * 3.0 / 8.0 * r);
                (barrel + caps, barrel * r * r / 4.0 + caps * r * r / 5.0, axial)
            }
            Self::Polyhedron(polyhedron) => {
                return Some((polyhedron.volume(), polyhedron.centre(), polyhedron.second_moment()));
            }
            Self::HalfSpace { .. } | Self::Mesh(_) => return None,
        };
        Some((volume, Vector3::zeros(), Matrix3::from_diagonal(&Vector3::new(radial, radial, axial))))
    }

    /// Returns the largest distance of a point of the shape from the origin of the body frame; infinite for a half
    /// space.
    pub fn reach(&self) -> f64 {
        match self {
            Self::Sphere { radius } => *radius,
            Self::Capsule { radius, half_height } => radius + half_height,
            Self::Cylinder { radius, half_height } => radius.hypot(*half_height),
            Self::Polyhedron(polyhedron) => polyhedron.vertices.iter().map(|v| v.norm()).fold(0.0, f64::max),
            Self::HalfSpace { .. } => f64::INFINITY,
            Self::Mesh(mesh) => mesh.compute_local_bounding_sphere().radius(),
        }
    }

    /// Returns the lower and the upper corner of the shape's axis-aligned bounding box in the world.
    pub fn bounds(&self, pose: &Isometry3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let at = pose.translation.vector;
        let axis = pose.rotation * Vector3::z();
        let half = match self {
            Self::Sphere { radius } => Vector3::repeat(*radius),
            Self::Capsule { radius, half_height } => axis.abs() * *half_height + Vector3::repeat(*radius),
            Self::Cylinder { radius, half_height } => {
                axis.abs() * *half_height + axis.map(|a| radius * (1.0 - a * a).max(0.0).sqrt())
            }
            Self::Polyhedron(polyhedron) => {
                let mut corners = polyhedron.vertices.iter().map(|v| pose.rotation * v + at);
                let first = corners.next().unwrap_or(at);
                return corners.fold((first, first), |(lower, upper), v| (lower.inf(&v), upper.sup(&v)));
            }
            Self::HalfSpace { .. } => Vector3::repeat(f64::INFINITY),
            Self::Mesh(mesh) => {
                let aabb = mesh.compute_aabb(&super::collision::library_pose(pose));
                let vector = |v: parry3d_f64::math::Vector| Vector3::new(v.x, v.y, v.z);
                return (vector(aabb.mins), vector(aabb.maxs));
            }
        };
        (at - half, at + half)
    }

    /// Builds a triangle mesh, with triangles as indices into the vertices; `None` if the surface is not oriented.
    pub fn mesh(vertices: &[Vector3<f64>], triangles: Vec<[u32; 3]>) -> Option<Self> {
        let points = vertices.iter().map(|v| parry3d_f64::math::Vector::new(v.x, v.y, v.z)).collect();
        let flags = parry3d_f64::shape::TriMeshFlags::FIX_INTERNAL_EDGES;
        let mesh = TriMesh::with_flags(points, triangles, flags).ok()?;
        Some(Self::Mesh(SharedShape::new(mesh)))
    }

    /// Returns the shape in the form of the collision library; `None` for a half space, whose contacts with all
    /// shapes have closed forms.
    pub fn library(&self) -> Option<SharedShape> {
        use parry3d_f64::math::Vector;
        match self {
            Self::Sphere { radius } => Some(SharedShape::ball(*radius)),
            Self::Capsule { radius, half_height } => {
                let end = Vector::new(0.0, 0.0, *half_height);
                Some(SharedShape::new(Capsule::new(-end, end, *radius)))
            }
            // The axis of a cylinder in the collision library is y; `collision::library` rotates it to z.
            Self::Cylinder { radius, half_height } => Some(SharedShape::new(Cylinder::new(*half_height, *radius))),
            Self::Polyhedron(polyhedron) => {
                let points: Vec<Vector> = polyhedron.vertices.iter().map(|v| Vector::new(v.x, v.y, v.z)).collect();
                ConvexPolyhedron::from_convex_hull(&points).map(SharedShape::new)
            }
            Self::HalfSpace { .. } => None,
            Self::Mesh(mesh) => Some(mesh.clone()),
        }
    }
}
