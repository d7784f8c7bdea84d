//! Bushings: springs and dampers along and about three axes between two bodies, or of one and the world.

use super::joints::pair;
use super::vectors::{self, Vector};
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use crate::range::in_range;
use models::rigid_bodies::{Body, DriveLaw, ForceLaw, Joint};
use nalgebra::Vector3;
use serde::Deserialize;
use std::collections::HashMap;
use utoipa::ToSchema;

/// A soft mount: springs and dampers along three axes that are fixed in the second body or the world, and about them. Along an
/// axis the force is `-stiffness*x - damping*dx/dt`, with the displacement `x` of the first body's point. About an axis it acts
/// on the sine `s` of the angle, with the potential `rotational_stiffness*s^2/2`: a rotation by `a` about one axis meets the
/// torque `rotational_stiffness*sin(a)*cos(a)`, so that it is for angles well below a right angle. It has no force where the
/// bodies are at the start; its energy is part of `potential_energy`, and its bodies may touch.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Bushing {
    /// Its outputs are `name.x y z`, the displacement along its axes, `name.fx fy fz`, the force on the first of its bodies that
    /// moves along them, `name.rx ry rz`, the sines of the angles about them, and `name.tx ty tz`, the torques, in the mean of a
    /// step: of those axes that have stiffness or damping. Default no outputs.
    pub name: Option<String>,
    /// The names of two bodies, or of one that is mounted on the world.
    pub bodies: Vec<String>,
    /// Its point, in the world at the start.
    #[schema(value_type = [Expression; 3])]
    pub at: Vector,
    /// The orientation of its axes at the start, a unit quaternion `[w, x, y, z]`. Default the axes of the world.
    pub orientation: Option<[Expression; 4]>,
    /// Along its axes, in newtons a metre, not below 0. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub stiffness: Option<Vector>,
    /// Along its axes, in newton seconds a metre, not below 0. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub damping: Option<Vector>,
    /// About its axes, in newton metres a radian, not below 0. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub rotational_stiffness: Option<Vector>,
    /// About its axes, in newton metre seconds a radian, not below 0. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub rotational_damping: Option<Vector>,
}

/// The springs and dampers of bushings of which everything is known.
pub(super) fn lower(
    bushings: &[Bushing],
    bodies: &[Body],
    names: &HashMap<String, usize>,
    place: &Pointer<'_>,
    lowering: &mut Lowering<'_>,
) -> Vec<Joint> {
    let mut lowered = Vec::new();
    for (k, bushing) in bushings.iter().enumerate() {
        let place = place.index(k);
        let at = vectors::lower(&bushing.at, &place.key("at"), lowering);
        let (axes, _) = vectors::orientation(bushing.orientation.as_ref(), &place.key("orientation"), lowering);
        let mut of_key = |vector: &Option<Vector>, key: &str| {
            let place = place.key(key);
            let mut read = |i: usize, given: &Expression| {
                in_range(given, &key.replace('_', " "), (|x| x >= 0.0, "not below 0"), &place.index(i), lowering)
            };
            vector
                .as_ref()
                .map_or_else(Vector3::zeros, |given| Vector3::from_fn(|i, _| read(i, &given[i]).unwrap_or(0.0)))
        };
        let stiffness =
            [of_key(&bushing.stiffness, "stiffness"), of_key(&bushing.rotational_stiffness, "rotational_stiffness")];
        let damping = [of_key(&bushing.damping, "damping"), of_key(&bushing.rotational_damping, "rotational_damping")];
        let laws: Vec<(usize, DriveLaw)> = (0..6)
            .map(|i| (i, stiffness[i / 3][i % 3], damping[i / 3][i % 3]))
            .filter(|(_, stiffness, damping)| *stiffness > 0.0 || *damping > 0.0)
            .map(|(i, stiffness, damping)| (i, DriveLaw::Force(ForceLaw { stiffness, damping, ..ForceLaw::default() })))
            .collect();
        if laws.is_empty() {
            let error = SpecificationError::new(
                place.to_string(),
                "empty",
                "this bushing has neither stiffness nor damping along or about any axis",
            );
            lowering
                .errors
                .push(error.expected("`stiffness`, `damping`, `rotational_stiffness` or `rotational_damping` above 0"));
        }
        let Some((pair, _)) = pair(&bushing.bodies, bodies, names, &place.key("bodies"), lowering) else {
            continue;
        };
        bushing.name.iter().for_each(|name| lowering.keep_name(name, &place.key("name")));
        let part = |law| Joint::bushing(pair, bodies, at, &axes, law).with_name(bushing.name.clone());
        lowered.extend(laws.into_iter().map(part));
    }
    lowered
}
