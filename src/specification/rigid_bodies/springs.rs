//! Springs and dampers between points of two bodies, or of a body and the world.

use super::joints::pair;
use super::vectors::{self, Vector};
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use crate::range::in_range;
use models::rigid_bodies::{Body, DriveLaw, ForceLaw, Joint};
use serde::Deserialize;
use std::collections::HashMap;
use utoipa::ToSchema;

/// A spring and a damper along the line between two points. It pulls with `stiffness*(l - rest_length) +
/// damping*dl/dt`, where `l` is the distance of the points. Its energy is part of `potential_energy`; its bodies can
/// still come into contact.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BodySpring {
    /// Name of the spring. The outputs are `name.length` and `name.force`, positive in compression and averaged over
    /// a step. Default: no outputs.
    pub name: Option<String>,
    /// The names of two bodies, or of one body that is attached to the world.
    pub bodies: Vec<String>,
    /// A point of the first body, and a point of the second body or of the world, in the initial configuration.
    #[schema(value_type = [[Expression; 3]; 2])]
    pub at: [Vector; 2],
    /// Stiffness of the spring in newtons per metre, not negative. Default 0.
    pub stiffness: Option<Expression>,
    /// Damping coefficient of the damper in newton seconds per metre, not negative. Default 0.
    pub damping: Option<Expression>,
    /// The distance at which the spring is relaxed, in metres, above 0. Default: the initial distance.
    pub rest_length: Option<Expression>,
}

/// Returns the springs whose description is valid, and reports errors in the others.
pub(super) fn lower(
    springs: &[BodySpring],
    bodies: &[Body],
    names: &HashMap<String, usize>,
    place: &Pointer<'_>,
    lowering: &mut Lowering<'_>,
) -> Vec<Joint> {
    let mut lowered = Vec::with_capacity(springs.len());
    for (k, spring) in springs.iter().enumerate() {
        let place = place.index(k);
        let points = [0, 1].map(|side| vectors::lower(&spring.at[side], &place.key("at").index(side), lowering));
        let law = law((&spring.stiffness, &spring.damping), &place, lowering);
        let apart = (points[0] - points[1]).norm();
        let rest = match &spring.rest_length {
            Some(rest) => in_range(rest, "rest length", (|l| l > 0.0, "above 0"), &place.key("rest_length"), lowering),
            None => Some(apart),
        };
        if apart == 0.0 {
            let detail = "the two points coincide at the start, so that the spring has no direction";
            let error = SpecificationError::new(place.key("at").to_string(), "zero_direction", detail);
            lowering.errors.push(error.expected("two points apart"));
        }
        let Some((pair, exchanged)) = pair(&spring.bodies, bodies, names, &place.key("bodies"), lowering) else {
            continue;
        };
        let at = if exchanged { [points[1], points[0]] } else { points };
        let law = DriveLaw::Force(ForceLaw { rest: rest.unwrap_or(apart), ..law });
        spring.name.iter().for_each(|name| lowering.keep_name(name, &place.key("name")));
        lowered.push(Joint::spring(pair, bodies, at, law).with_name(spring.name.clone()));
    }
    lowered
}

/// Reads the coefficients of a spring and a damper, at least one of which must be given.
pub(super) fn law(
    (stiffness, damping): (&Option<Expression>, &Option<Expression>),
    place: &Pointer<'_>,
    lowering: &mut Lowering<'_>,
) -> ForceLaw {
    let mut read = |value: &Option<Expression>, key: &str| {
        let value = value.as_ref()?;
        in_range(value, key, (|x| x >= 0.0, "not below 0"), &place.key(key), lowering)
    };
    let (k, d) = (read(stiffness, "stiffness"), read(damping, "damping"));
    if stiffness.is_none() && damping.is_none() {
        let error = SpecificationError::new(place.to_string(), "empty", "there is neither stiffness nor damping");
        lowering.errors.push(error.expected("`stiffness`, `damping`, or both"));
    }
    ForceLaw { stiffness: k.unwrap_or(0.0), damping: d.unwrap_or(0.0), ..ForceLaw::default() }
}
