//! Joints, placed in the initial configuration of the world.

use super::motors::{self, Functions, JointLimits, JointSpring, Motor};
use super::vectors::{self, Vector};
use crate::error::{Errors, SpecificationError};
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use crate::wording::{abridged, listed};
use expression::nearest;
use models::rigid_bodies::{self, Body, Drive, DriveLaw, JointKind, MultibodySystem};
use nalgebra::{Unit, Vector3};
use serde::Deserialize;
use std::collections::HashMap;
use utoipa::ToSchema;

/// A joint between two bodies, or between a body and the world. Bodies that share a joint have no contact with each
/// other. Joints are satisfied in positions and velocities and add no energy for any step size; a step that is too long
/// for a joint is subdivided.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum BodyJoint {
    /// A joint with a common point: three rotational degrees of freedom.
    Ball(PointJoint),
    /// A joint with a common point and axis: one rotational degree of freedom.
    Hinge(AxialJoint),
    /// A joint with a common axis: one translational degree of freedom, along the axis.
    Slider(AxialJoint),
    /// A rigid connection: no degree of freedom.
    Fixed(FixedJoint),
}

/// A joint with a common point.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PointJoint {
    /// The names of two bodies, or of one body that is joined to the world.
    pub bodies: Vec<String>,
    /// The common point, in the initial configuration of the world.
    #[schema(value_type = [Expression; 3])]
    pub at: Vector,
    /// Name of the joint. The outputs are `name.fx fy fz`, the force on the first of its moving bodies, and
    /// `name.tx ty tz`, the torque on that body about the point, in the world frame and averaged over a step.
    /// Default: no outputs.
    pub name: Option<String>,
}

/// A joint with a common axis.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AxialJoint {
    /// The names of two bodies, or of one body that is joined to the world.
    pub bodies: Vec<String>,
    /// A point of the axis, in the initial configuration of the world.
    #[schema(value_type = [Expression; 3])]
    pub at: Vector,
    /// The direction of the axis, in the initial configuration of the world.
    #[schema(value_type = [Expression; 3])]
    pub axis: Vector,
    /// Name of the joint. The outputs are `name.fx fy fz`, the force on the first of its moving bodies, and
    /// `name.tx ty tz`, the torque on that body about the point, in the world frame and averaged over a step; with a
    /// motor, a spring or limits also `name.coordinate` and `name.effort`, the force or torque along the coordinate.
    /// Default: no outputs.
    pub name: Option<String>,
    /// Motor along the coordinate of the joint. Default: none.
    pub motor: Option<Motor>,
    /// Spring and damper along the coordinate of the joint. Default: none.
    pub spring: Option<JointSpring>,
    /// Stops at limits of the coordinate of the joint. Default: none.
    pub limits: Option<JointLimits>,
}

/// A rigid connection of bodies.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FixedJoint {
    /// The names of two bodies, or of one body that is joined to the world.
    pub bodies: Vec<String>,
    /// Name of the joint. The outputs are `name.fx fy fz`, the force on the first of its moving bodies, and
    /// `name.tx ty tz`, the torque on that body about its initial centre of mass, in the world frame and averaged
    /// over a step. Default: no outputs.
    pub name: Option<String>,
}

impl BodyJoint {
    /// Whether the joint has a motor.
    pub(super) fn has_motor(&self) -> bool {
        matches!(self, Self::Hinge(axial) | Self::Slider(axial) if axial.motor.is_some())
    }

    /// Returns the key of the kind of joint in the document, such as `hinge`.
    fn key(&self) -> &'static str {
        match self {
            Self::Ball(_) => "ball",
            Self::Hinge(_) => "hinge",
            Self::Slider(_) => "slider",
            Self::Fixed(_) => "fixed",
        }
    }
}

/// Relative tolerance up to which initial velocities may violate a joint.
const ROUNDING: f64 = 1e-6;

/// Reports joints that the velocities at the start time `t` violate, or whose motor prescribes another rate. The points
/// and axes are placed in the initial configuration, so positions satisfy the joints.
pub(super) fn refuse_torn(
    joints: &[BodyJoint],
    scene: &MultibodySystem,
    t: Option<f64>,
    place: &Pointer<'_>,
    errors: &mut Errors,
) {
    let (values, rates) = t.map(|t| scene.signals.at(t)).unwrap_or_default();
    let rounding = t.map_or(0.0, |t| scene.signals.rounding(t));
    for (k, (given, joint)) in joints.iter().zip(&scene.joints).enumerate() {
        let asked = joint.drive.and_then(|drive| match drive.law {
            DriveLaw::Position(function) => rates.get(function).copied(),
            DriveLaw::Velocity(function) => values.get(function).copied(),
            DriveLaw::Force(_) => None,
        });
        if let Some((rate, asked)) = joint.rate(&scene.bodies).zip(asked)
            && (rate - asked).abs() > ROUNDING * rate.abs().max(asked.abs()) + rounding
        {
            let detail =
                format!("the motor prescribes a joint rate of {asked} at the start, and its bodies move at {rate}");
            let error = SpecificationError::new(
                place.index(k).key(given.key()).key("motor").to_string(),
                "inconsistent_start",
                detail,
            );
            errors.push(error.expected(
                "velocities of the bodies that match the motor, or `\"interpenetration\": \"resolve\"` beside `bodies`",
            ));
        }
        if let Some([speed, rate]) = joint.torn(&scene.bodies, ROUNDING) {
            let detail = format!(
                "the joint is violated in velocity at the start: its points separate at {speed} m/s, and the bodies \
                 rotate against it at {rate} rad/s"
            );
            let error =
                SpecificationError::new(place.index(k).key(given.key()).to_string(), "interpenetration", detail);
            errors.push(
                error.expected("velocities that satisfy it, or `\"interpenetration\": \"resolve\"` beside `bodies`"),
            );
        }
    }
}

/// Returns the joints whose description is valid, and reports errors in the others.
pub(super) fn lower(
    joints: &[BodyJoint],
    bodies: &[Body],
    names: &HashMap<String, usize>,
    place: &Pointer<'_>,
    functions: &mut Functions,
    lowering: &mut Lowering,
) -> Vec<rigid_bodies::Joint> {
    let mut lowered = Vec::with_capacity(joints.len());
    for (k, joint) in joints.iter().enumerate() {
        let place = place.index(k);
        let place = place.key(joint.key());
        let (bodies_of, axial, kind) = match joint {
            BodyJoint::Ball(PointJoint { bodies, .. }) => (bodies, None, JointKind::Ball),
            BodyJoint::Hinge(axial) => (&axial.bodies, Some(axial), JointKind::Hinge),
            BodyJoint::Slider(axial) => (&axial.bodies, Some(axial), JointKind::Slider),
            BodyJoint::Fixed(FixedJoint { bodies, .. }) => (bodies, None, JointKind::Fixed),
        };
        let at = match joint {
            BodyJoint::Ball(point) => Some(&point.at),
            _ => axial.map(|axial| &axial.at),
        };
        let axis = axial.map(|axial| &axial.axis);
        let law = axial.and_then(|axial| motors::lower(axial, &place, functions, lowering));
        let at = at.map(|at| vectors::lower(at, &place.key("at"), lowering));
        let axis =
            axis.map_or(Vector3::z_axis(), |axis: &Vector| vectors::direction(axis, &place.key("axis"), lowering));
        if let Some((pair, _)) = pair(bodies_of, bodies, names, &place.key("bodies"), lowering) {
            let at = at.unwrap_or_else(|| bodies[pair.0].pose.translation.vector);
            let axis: Unit<Vector3<f64>> = axis;
            let coordinate = rigid_bodies::Joint::coordinate(kind, pair, bodies, axis);
            let drive = law.zip(coordinate).map(|((law, limits), coordinate)| Drive { coordinate, law, limits });
            let named = match joint {
                BodyJoint::Ball(point) => &point.name,
                BodyJoint::Fixed(fixed) => &fixed.name,
                BodyJoint::Hinge(axial) | BodyJoint::Slider(axial) => &axial.name,
            };
            named.iter().for_each(|name| lowering.keep_name(name, &place.key("name")));
            let joint = rigid_bodies::Joint::new(kind, pair, bodies, at, axis).with_drive(drive);
            lowered.push(joint.with_name(named.clone()));
        }
    }
    lowered
}

/// Returns the bodies of a joint, a moving one first (`None` is the world), and whether this order reverses that in
/// which the user names them.
pub(super) fn pair(
    given: &[String],
    bodies: &[Body],
    names: &HashMap<String, usize>,
    place: &Pointer<'_>,
    lowering: &mut Lowering,
) -> Option<((usize, Option<usize>), bool)> {
    if given.is_empty() || given.len() > 2 {
        let detail = format!("{} bodies are named", given.len());
        let error = SpecificationError::new(place.to_string(), "wrong_count", detail);
        lowering.errors.push(error.expected("one body, joined to the world, or two"));
        return None;
    }
    let mut found = Vec::with_capacity(2);
    for (i, name) in given.iter().enumerate() {
        match names.get(name) {
            Some(&body) => found.push(body),
            None => {
                let known = || bodies.iter().map(|body| body.name.as_str());
                let detail = format!("`{}` is not a body", abridged(name));
                let error = SpecificationError::new(place.index(i).to_string(), "unknown_name", detail);
                lowering.errors.push(error.expected(listed(known())).did_you_mean(nearest(name, known())));
                return None;
            }
        }
    }
    let moving: Vec<usize> = found.iter().copied().filter(|&body| !bodies[body].fixed).collect();
    let driven = found.iter().copied().find(|&body| bodies[body].motion.is_some());
    let detail = match (&moving[..], &found[..]) {
        ([a, b], _) if a != b => return Some(((*a, Some(*b)), false)),
        ([a], _) => return Some(((*a, driven), found[0] != *a)),
        ([], _) => "none of these bodies moves by its mass",
        _ => "a body cannot be joined to itself",
    };
    let error = SpecificationError::new(place.to_string(), "nothing_to_join", detail);
    lowering.errors.push(error.expected("a body that moves by its mass, and another or the world"));
    None
}
