//! Bodies: shape, mass, and where they are and how they move at the start.

use super::shapes::RigidShape;
use super::vectors::{self, Vector};
use super::{Material, Ordered};
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::place::Place;
use crate::range;
use crate::wording::{abridged, listed};
use expression::nearest;
use models::rigid_bodies::{Body, Collider, Shape};
use nalgebra::{Isometry3, Matrix3, Quaternion, UnitQuaternion, Vector3};
use serde::Deserialize;
use solution::Warning;
use utoipa::ToSchema;

/// A rigid body.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RigidBody {
    /// Its outputs are `name.x`, `name.qw`, `name.vx`, `name.wx` and so on. Default `body1`, `body2`, ...
    pub name: Option<String>,
    /// Its shape, in its own frame.
    pub shape: RigidShape,
    /// Kilograms, above 0. A body that moves has this or `density`.
    pub mass: Option<Expression>,
    /// Kilograms a cubic metre, above 0.
    pub density: Option<Expression>,
    /// Moments of inertia about the axes x, y and z of the body through its centre of mass, where they are not those of
    /// a body filled evenly.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub inertia: Option<Vector>,
    /// Where the origin of its frame is. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub position: Option<Vector>,
    /// Its orientation, a unit quaternion `[w, x, y, z]`. Default `[1, 0, 0, 0]`.
    pub orientation: Option<[Expression; 4]>,
    /// The velocity of the origin of its frame. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub velocity: Option<Vector>,
    /// Its angular velocity in the world, in radians a second. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub angular_velocity: Option<Vector>,
    /// One of `materials`. Default one with the friction and restitution of `contacts`.
    pub material: Option<String>,
    /// Whether it never moves, whatever pushes it.
    #[serde(default)]
    pub fixed: bool,
}

impl RigidBody {
    /// Its name, the `k`-th body's own or that of its place.
    pub(super) fn name(&self, k: usize) -> String {
        self.name.clone().unwrap_or_else(|| format!("body{}", k + 1))
    }

    /// The body, if it is one.
    pub(super) fn lower(
        &self,
        name: String,
        materials: &Ordered<Material>,
        place: &Place<'_>,
        warnings: &mut Vec<Warning>,
        lowering: &mut Lowering,
    ) -> Option<Body> {
        let mut shape = self.shape.lower(&place.key("shape"), lowering);
        let optional = |vector: &Option<Vector>, key: &str, lowering: &mut Lowering| {
            vector.as_ref().map_or_else(Vector3::zeros, |vector| vectors::lower(vector, &place.key(key), lowering))
        };
        let position = optional(&self.position, "position", lowering);
        let velocity = optional(&self.velocity, "velocity", lowering);
        let omega = optional(&self.angular_velocity, "angular_velocity", lowering);
        let orientation = self.orientation(&name, &place.key("orientation"), warnings, lowering);
        let material = self.material(materials, place, lowering);
        let inertial = if self.fixed {
            self.check_rest(velocity, omega, place, lowering);
            Some((0.0, Vector3::zeros(), Matrix3::zeros()))
        } else {
            shape.as_ref().and_then(|shape| self.inertial(shape, place, lowering))
        };
        let (mass, centre, inertia) = inertial?;
        if let Some(Shape::Polyhedron(polyhedron)) = &mut shape {
            polyhedron.shift(&centre);
        }
        let offset = orientation * centre;
        Some(Body {
            name,
            collider: Collider::new(shape?),
            material,
            fixed: self.fixed,
            mass,
            inertia,
            centre,
            pose: Isometry3::from_parts((position + offset).into(), orientation),
            velocity: velocity + omega.cross(&offset),
            omega,
        })
    }

    fn orientation(
        &self,
        name: &str,
        place: &Place<'_>,
        warnings: &mut Vec<Warning>,
        lowering: &mut Lowering,
    ) -> UnitQuaternion<f64> {
        let Some(given) = &self.orientation else { return UnitQuaternion::identity() };
        let values = [0, 1, 2, 3].map(|i| lowering.constant(&given[i], &place.index(i)));
        let [Some(w), Some(x), Some(y), Some(z)] = values else { return UnitQuaternion::identity() };
        let quaternion = Quaternion::new(w, x, y, z);
        let norm = quaternion.norm();
        if !(norm > 0.0 && norm.is_finite()) {
            let error =
                SpecificationError::new(place.to_string(), "zero_quaternion", "this quaternion has no direction");
            lowering.errors.push(error.expected("a unit quaternion [w, x, y, z]"));
            return UnitQuaternion::identity();
        }
        if (norm - 1.0).abs() > 1e-6 {
            let message = format!("the orientation of `{name}` has length {norm}; it was scaled to length 1");
            warnings.push(Warning { code: "quaternion_normalised", message });
        }
        UnitQuaternion::new_normalize(quaternion)
    }

    /// The place of its material; the last is that of bodies without one.
    fn material(&self, materials: &Ordered<Material>, place: &Place<'_>, lowering: &mut Lowering) -> usize {
        let Some(name) = &self.material else { return materials.len() };
        materials.names().position(|known| known == name).unwrap_or_else(|| {
            let detail = format!("`{}` is no material", abridged(name));
            let error = SpecificationError::new(place.key("material").to_string(), "unknown_name", detail);
            let nearest = nearest(name, materials.names());
            lowering.errors.push(error.expected(listed(materials.names())).did_you_mean(nearest));
            materials.len()
        })
    }

    fn check_rest(&self, velocity: Vector3<f64>, omega: Vector3<f64>, place: &Place<'_>, lowering: &mut Lowering) {
        for (key, value) in [("velocity", velocity), ("angular_velocity", omega)] {
            if value != Vector3::zeros() {
                lowering.errors.report(&place.key(key), "conflict", "a fixed body does not move");
            }
        }
    }

    /// Mass, centre of mass and the inertia about it.
    fn inertial(
        &self,
        shape: &Shape,
        place: &Place<'_>,
        lowering: &mut Lowering,
    ) -> Option<(f64, Vector3<f64>, Matrix3<f64>)> {
        let Some((volume, centre, second)) = shape.moments() else {
            let detail = format!("a {} has no volume, so that it cannot move", shape.name());
            let error = SpecificationError::new(place.key("shape").to_string(), "must_be_fixed", detail);
            lowering.errors.push(error.expected("`\"fixed\": true`, or another shape"));
            return None;
        };
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
        let central = second / volume - centre * centre.transpose();
        let inertia = match &self.inertia {
            None => (Matrix3::from_diagonal_element(central.trace()) - central) * mass,
            Some(moments) => Matrix3::from_diagonal(&principal(moments, &place.key("inertia"), lowering)?),
        };
        Some((mass, centre, inertia))
    }
}

/// Principal moments: each above zero, and none above the sum of the others.
fn principal(moments: &Vector, place: &Place<'_>, lowering: &mut Lowering) -> Option<Vector3<f64>> {
    let value = Vector3::from_fn(|i, _| range::positive(&moments[i], "moment of inertia", &place.index(i), lowering));
    let excess = 2.0 * value.max() - value.sum();
    if excess > 1e-9 * value.sum() {
        let detail = format!("the moment {} is greater than the sum of the two others, by {excess}", value.max());
        let error = SpecificationError::new(place.to_string(), "triangle_inequality", detail);
        lowering.errors.push(error.expected("moments of which none is greater than the sum of the others"));
        return None;
    }
    Some(value)
}
