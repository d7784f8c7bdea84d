//! Bushings: springs and dampers along and about three axes between two bodies, or between a body and the world.

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

/// A soft mount: springs and dampers along and about three axes that are fixed in the second body or the world. Along
/// an axis the force is `-stiffness*x - damping*dx/dt`, with the displacement `x` of the first body's point. About an
/// axis the torque acts on the sine `s` of the angle, with the potential `rotational_stiffness*s^2/2`: a rotation by
/// `a` about one axis meets the torque `rotational_stiffness*sin(a)*cos(a)`, so that bushings are for angles well
/// below a right angle. A bushing has no force in the initial configuration; its energy is part of
/// `potential_energy`, and its bodies may touch.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Bushing {
    /// Name of the bushing. The outputs are `name.x y z`, the displacement along its axes, `name.fx fy fz`, the force
    /// along the axes on the first of its moving bodies, `name.rx ry rz`, the sines of the angles about the axes, and
    /// `name.tx ty tz`, the torques, averaged over a step: all for those axes that have stiffness or damping.
    /// Default: no outputs.
    pub name: Option<String>,
    /// The names of two bodies, or of one body that is mounted on the world.
    pub bodies: Vec<String>,
    /// The point of the bushing, in the initial configuration of the world.
    #[schema(value_type = [Expression; 3])]
    pub at: Vector,
    /// The initial orientation of the axes, a unit quaternion `[w, x, y, z]`. Default: the axes of the world.
    pub orientation: Option<[Expression; 4]>,
    /// Stiffness along the axes, in newtons per metre, not negative. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub stiffness: Option<Vector>,
    /// Damping along the axes, in newton seconds per metre, not negative. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub damping: Option<Vector>,
    /// Stiffness about the axes, in newton metres per radian, not negative. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub rotational_stiffness: Option<Vector>,
    /// Damping about the axes, in newton metre seconds per radian, not negative. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub rotational_damping: Option<Vector>,
}

/// Returns the bushings whose description is valid, and reports errors in the others.
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
