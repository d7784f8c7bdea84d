//! Rigid bodies: shape, mass, and initial position and velocity.

use super::inertia::{self, Inertia};
use super::motors::{self, Functions};
use super::shapes::RigidShape;
use super::vectors::{self, Vector};
use super::{Material, Ordered};
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use crate::range;
use crate::wording::{abridged, listed};
use expression::nearest;
use models::rigid_bodies::{Angular, Body, Collider, Linear, Prescription, Shape};
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use serde::Deserialize;
use solution::Warning;
use utoipa::ToSchema;

/// A rigid body: shape, mass, initial state, material and motion.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RigidBody {
    /// Name of the body. The outputs are `name.x`, `name.qw`, `name.vx`, `name.wx` and so on. Default `body1`,
    /// `body2`, ...
    pub name: Option<String>,
    /// Shape of the body, in its own frame.
    pub shape: RigidShape,
    /// Mass in kilograms, above 0. A moving body has either `mass` or `density`.
    pub mass: Option<Expression>,
    /// Density in kilograms per cubic metre, above 0.
    pub density: Option<Expression>,
    /// Centre of mass, in the frame of the body. Default: that of a homogeneous body. Requires `inertia`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub centre_of_mass: Option<Vector>,
    /// Inertia about the centre of mass, along the axes x, y and z of the body's frame: three moments, or a symmetric
    /// matrix of three rows. Default: that of a homogeneous body.
    pub inertia: Option<Inertia>,
    /// Initial position of the origin of the body's frame. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub position: Option<Vector>,
    /// Initial orientation of the body, a unit quaternion `[w, x, y, z]`. Default `[1, 0, 0, 0]`.
    pub orientation: Option<[Expression; 4]>,
    /// Initial velocity of the origin of the body's frame. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub velocity: Option<Vector>,
    /// Initial angular velocity of the body in the world frame, in radians per second. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub angular_velocity: Option<Vector>,
    /// Material of the body, one of `materials`. Default: a material with the friction and restitution of `contacts`.
    pub material: Option<String>,
    /// Prescribed motion, which no force changes; the body needs no mass. Default: motion by the equations of motion.
    pub motion: Option<BodyMotion>,
    /// Whether contact forces on the body are outputs: `name.contact_fx contact_fy contact_fz`, the total force, and
    /// `name.contact_tx contact_ty contact_tz`, its torque about the centre of mass (of a fixed body, about the origin
    /// of its frame), in the world frame and averaged over a step. Default `false`.
    #[serde(default)]
    pub contact_forces: bool,
    /// Group name, for pairs of groups without contact in `contacts.exclude`. Default: none.
    pub group: Option<String>,
    /// Whether the body is fixed in space. Default `false`.
    #[serde(default)]
    pub fixed: bool,
}

/// A prescribed motion of a body, as expressions in `t` and parameters.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyMotion {
    /// Position of the origin of the body's frame. Default: the integral of `velocity`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub position: Option<Vector>,
    /// Velocity of the origin of the body's frame, as an alternative to `position`. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub velocity: Option<Vector>,
    /// Angular velocity of the body in the world frame, in radians per second. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub angular_velocity: Option<Vector>,
    /// Rotation of the body from its `orientation`, as an alternative to `angular_velocity`: a vector along the axis
    /// of rotation in the world frame, whose length is the angle in radians. `[0, 0, "0.3*sin(t)"]` swings about the
    /// z axis. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub rotation: Option<Vector>,
}

impl BodyMotion {
    /// Reads the expressions of a prescribed motion of a body, and sets the initial pose and velocities of that body,
    /// `lowered`.
    pub(super) fn lower(
        &self,
        body: &RigidBody,
        lowered: &mut Body,
        place: &Pointer<'_>,
        functions: &mut Functions,
        lowering: &mut Lowering,
    ) {
        let conflicts = [
            (
                self.position.is_some() && self.velocity.is_some(),
                "both `position` and `velocity` prescribe its translation",
            ),
            (
                body.velocity.is_some() || body.angular_velocity.is_some(),
                "its initial velocity follows from its `motion`",
            ),
            (self.position.is_some() && body.position.is_some(), "its initial position follows from its `motion`"),
            (body.fixed, "a fixed body does not move"),
            (body.mass.is_some() || body.density.is_some(), "its motion is prescribed, and a mass has no effect"),
            (
                self.rotation.is_some() && self.angular_velocity.is_some(),
                "both `rotation` and `angular_velocity` prescribe its rotation",
            ),
            (
                (self.angular_velocity.is_some() || self.rotation.is_some())
                    && matches!(body.shape, RigidShape::HalfSpace(_)),
                "a half space that turns would sweep all space",
            ),
        ];
        let motion = place.key("motion");
        for (_, detail) in conflicts.into_iter().filter(|(conflicts, _)| *conflicts) {
            lowering.errors.report(&motion, "conflict", detail);
        }
        let mut functions_of = |vector: &Option<Vector>, key: &str| {
            let place = motion.key(key);
            let vector = vector.as_ref()?;
            let mut of = [0; 3];
            for (i, function) in of.iter_mut().enumerate() {
                *function = motors::finite(&vector[i], &place.index(i), functions, lowering)?;
            }
            Some(of)
        };
        let position = functions_of(&self.position, "position");
        let velocity = functions_of(&self.velocity, "velocity");
        let turning = functions_of(&self.angular_velocity, "angular_velocity");
        let rotation = functions_of(&self.rotation, "rotation");
        let linear = position.map(Linear::Position).or(velocity.map(Linear::Velocity));
        let base = lowered.pose.rotation;
        let angular = turning.map(Angular::Velocity).or(rotation.map(|rotation| Angular::Rotation(rotation, base)));
        let motion = Prescription { linear, angular };
        lowered.motion = Some(motion);
        let Some(t) = lowering.start.filter(|_| lowering.errors.is_empty()) else { return };
        let (values, rates) = functions.signals(lowering).at(t);
        let at = |of: [usize; 3]| Vector3::from(of.map(|function| values[function]));
        if let Some(position) = position {
            lowered.pose.translation.vector = at(position);
        }
        if let Some(rotation) = rotation {
            lowered.pose.rotation = UnitQuaternion::from_scaled_axis(at(rotation)) * base;
        }
        (lowered.velocity, lowered.omega) = motion.velocities(&values, &rates);
    }
}

impl RigidBody {
    /// Whether the body moves by the equations of motion: it is neither fixed nor has a prescribed motion.
    pub(super) fn is_free(&self) -> bool {
        !self.fixed && self.motion.is_none()
    }

    /// Returns the user's name of the rigid body with index `k`, or its default name.
    pub(super) fn name(&self, k: usize) -> String {
        self.name.clone().unwrap_or_else(|| format!("body{}", k + 1))
    }

    /// Builds the rigid body, if its description is valid.
    pub(super) fn lower(
        &self,
        name: String,
        materials: &Ordered<Material>,
        place: &Pointer<'_>,
        warnings: &mut Vec<Warning>,
        lowering: &mut Lowering,
    ) -> Option<Body> {
        let parts = self.shape.parts(&place.key("shape"), lowering);
        let optional = |vector: &Option<Vector>, key: &str, lowering: &mut Lowering| {
            vector.as_ref().map_or_else(Vector3::zeros, |vector| vectors::lower(vector, &place.key(key), lowering))
        };
        let position = optional(&self.position, "position", lowering);
        let velocity = optional(&self.velocity, "velocity", lowering);
        let omega = optional(&self.angular_velocity, "angular_velocity", lowering);
        let (orientation, norm) = vectors::orientation(self.orientation.as_ref(), &place.key("orientation"), lowering);
        if (norm - 1.0).abs() > 1e-6 {
            let message = format!("the orientation of `{name}` has length {norm}; it was scaled to length 1");
            warnings.push(Warning { code: "quaternion_normalised", message });
        }
        let material = self.material(materials, place, lowering);
        let inertial = if !self.is_free() {
            if self.fixed {
                self.check_rest(velocity, omega, place, lowering);
            }
            Some((0.0, Vector3::zeros(), Matrix3::zeros()))
        } else {
            parts.as_ref().and_then(|parts| self.inertial(parts, place, lowering))
        };
        let (mass, centre, inertia) = inertial?;
        let collider = Collider::of_parts(parts?.into_iter().map(|part| shifted(part, &centre)).collect());
        let offset = orientation * centre;
        Some(Body {
            name,
            collider,
            material,
            fixed: !self.is_free(),
            group: None,
            motion: None,
            tells_contacts: self.contact_forces,
            mass,
            inertia,
            centre,
            pose: Isometry3::from_parts((position + offset).into(), orientation),
            velocity: velocity + omega.cross(&offset),
            omega,
        })
    }

    /// Returns the index of the contact material of the body; bodies without a material have the last index.
    fn material(&self, materials: &Ordered<Material>, place: &Pointer<'_>, lowering: &mut Lowering) -> usize {
        let Some(name) = &self.material else { return materials.len() };
        materials.names().position(|known| known == name).unwrap_or_else(|| {
            let detail = format!("`{}` is not a material", abridged(name));
            let error = SpecificationError::new(place.key("material").to_string(), "unknown_name", detail);
            let nearest = nearest(name, materials.names());
            lowering.errors.push(error.expected(listed(materials.names())).did_you_mean(nearest));
            materials.len()
        })
    }

    fn check_rest(&self, velocity: Vector3<f64>, omega: Vector3<f64>, place: &Pointer<'_>, lowering: &mut Lowering) {
        for (key, value) in [("velocity", velocity), ("angular_velocity", omega)] {
            if value != Vector3::zeros() {
                lowering.errors.report(&place.key(key), "conflict", "a fixed body does not move");
            }
        }
    }

    /// Returns the mass of the body, its centre of mass, and its inertia about the centre of mass.
    fn inertial(
        &self,
        parts: &[(Shape, Isometry3<f64>)],
        place: &Pointer<'_>,
        lowering: &mut Lowering,
    ) -> Option<(f64, Vector3<f64>, Matrix3<f64>)> {
        // Volume of the body, and the first and second moments of volume about the origin of its frame.
        let (mut volume, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
        for (shape, at) in parts {
            let Some((of_shape, centre, moment)) = shape.moments() else {
                let detail = format!("a {} has no volume, hence no inertia, and cannot move", shape.name());
                let error = SpecificationError::new(place.key("shape").to_string(), "must_be_fixed", detail);
                lowering.errors.push(error.expected("`\"fixed\": true`, or another shape"));
                return None;
            };
            let turn = at.rotation.to_rotation_matrix().into_inner();
            let (arm, to) = (turn * centre, at.translation.vector);
            volume += of_shape;
            first += (arm + to) * of_shape;
            let mixed = arm * to.transpose() * of_shape;
            second += turn * moment * turn.transpose() + mixed + mixed.transpose() + to * to.transpose() * of_shape;
        }
        let mass = match (&self.mass, &self.density) {
            (Some(mass), None) => range::positive(mass, "mass", &place.key("mass"), lowering),
            (None, Some(density)) => range::positive(density, "density", &place.key("density"), lowering) * volume,
            (given, _) => {
                let detail = if given.is_some() { "both mass and density are given" } else { "no mass is given" };
                let error = SpecificationError::new(place.to_string(), "mass_or_density", detail);
                lowering.errors.push(error.expected("`mass` or `density`"));
                return None;
            }
        };
        let filled = first / volume;
        let central = second / volume - filled * filled.transpose();
        let inertia = match &self.inertia {
            None => (Matrix3::from_diagonal_element(central.trace()) - central) * mass,
            Some(inertia) => inertia::lower(inertia, &place.key("inertia"), lowering)?,
        };
        let Some(given) = &self.centre_of_mass else { return Some((mass, filled, inertia)) };
        if self.inertia.is_none() {
            let detail = "a body with a given centre of mass is not homogeneous, and its inertia cannot be computed";
            let error = SpecificationError::new(place.key("centre_of_mass").to_string(), "conflict", detail);
            lowering.errors.push(error.expected("`inertia` about the given centre as well"));
        }
        Some((mass, vectors::lower(given, &place.key("centre_of_mass"), lowering), inertia))
    }
}

/// Returns a shape of a body with its pose relative to the centre of mass.
fn shifted((mut shape, at): (Shape, Isometry3<f64>), centre: &Vector3<f64>) -> (Shape, Isometry3<f64>) {
    if at == Isometry3::identity()
        && let Shape::Polyhedron(polyhedron) = &mut shape
    {
        polyhedron.shift(centre);
        return (shape, at);
    }
    (shape, Isometry3::from_parts((at.translation.vector - centre).into(), at.rotation))
}
