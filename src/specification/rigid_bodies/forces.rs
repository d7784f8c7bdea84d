//! Forces and torques on bodies, as expressions in time and the motion of bodies.

use super::vectors::{self, Vector};
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use crate::wording::{abridged, listed};
use ::expression::{Graph, Node, Tape, nearest};
use models::rigid_bodies::{Action, Body, DERIVED, OF_BODY, OUTPUTS, inputs_of};
use nalgebra::Vector3;
use serde::Deserialize;
use std::collections::HashMap;
use utoipa::ToSchema;

/// A force and a torque on a body, as expressions in `t`, parameters, definitions and the outputs of bodies, as in
/// `"-0.1*ball.vx"`: the name of a body, a dot, and one of `x y z qw qx qy qz vx vy vz wx wy wz`.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyForce {
    /// The name of a moving body.
    pub body: String,
    /// The force in newtons. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub force: Option<Vector>,
    /// The torque in newton metres. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub torque: Option<Vector>,
    /// The point of application of the force, in the frame of the body. Default: the centre of mass.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub at: Option<Vector>,
    /// The frame of the components of force and torque. Default `world`.
    #[serde(default)]
    pub axes: AxesOfForce,
}

/// The frame of the components of a force and a torque.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum AxesOfForce {
    /// The axes of the world.
    #[default]
    World,
    /// The axes of the body, which rotate with it.
    Body,
}

/// Returns the names of the outputs of moving bodies, in the order of their graph inputs, which follow `t`.
pub(super) fn names(bodies: &[super::RigidBody]) -> Vec<String> {
    let moving = bodies.iter().enumerate().filter(|(_, body)| body.is_free());
    moving
        .flat_map(|(k, body)| {
            let name = body.name(k);
            OF_BODY.map(|key| format!("{name}.{key}"))
        })
        .collect()
}

/// Compiles the expressions of the forces on bodies. Kinks and jumps in them are allowed without a warning, since fixed
/// steps step over them.
pub(super) fn lower(
    forces: &[BodyForce],
    bodies: &[Body],
    names: &HashMap<String, usize>,
    place: &Pointer<'_>,
    lowering: &mut Lowering<'_>,
) -> Vec<Action> {
    let moving: Vec<usize> = (0..bodies.len()).filter(|&body| !bodies[body].fixed).collect();
    let mut actions = Vec::with_capacity(forces.len());
    for (k, given) in forces.iter().enumerate() {
        if !lowering.goes_on(k) {
            break;
        }
        let place = place.index(k);
        let body = find(&given.body, bodies, names, &place.key("body"), lowering);
        if given.force.is_none() && given.torque.is_none() {
            let error = SpecificationError::new(place.to_string(), "empty", "neither a force nor a torque is given");
            lowering.errors.push(error.expected("`force`, `torque`, or both"));
        }
        let mut nodes = Vec::with_capacity(6);
        for (vector, key) in [(&given.force, "force"), (&given.torque, "torque")] {
            for i in 0..3 {
                let zero = lowering.graph.constant(0.0);
                let place = place.key(key);
                nodes.push(vector.as_ref().map_or(zero, |vector| lowering.node_or_zero(&vector[i], &place.index(i))));
            }
        }
        let at = given.at.as_ref().map(|at| vectors::lower(at, &place.key("at"), lowering));
        let Some(body) = body else { continue };
        let action = action(body, &nodes, bodies, &moving, &place, lowering);
        actions.extend(action.map(|action| Action {
            at: at.map_or_else(Vector3::zeros, |at| at - bodies[body].centre),
            is_local: given.axes == AxesOfForce::Body,
            ..action
        }));
    }
    actions
}

/// Finds the moving body of the given name, which a force acts on or depends on.
fn find(
    name: &str,
    bodies: &[Body],
    names: &HashMap<String, usize>,
    place: &Pointer<'_>,
    lowering: &mut Lowering<'_>,
) -> Option<usize> {
    let known = || bodies.iter().map(|body| body.name.as_str());
    let Some(&body) = names.get(name) else {
        let detail = format!("`{}` is not a body", abridged(name));
        let error = SpecificationError::new(place.to_string(), "unknown_name", detail);
        lowering.errors.push(error.expected(listed(known())).did_you_mean(nearest(name, known())));
        return None;
    };
    if bodies[body].fixed {
        let detail = format!("`{}` does not move under forces", abridged(name));
        let error = SpecificationError::new(place.to_string(), "conflict", detail);
        lowering.errors.push(error.expected("a body that moves"));
        return None;
    }
    Some(body)
}

/// Compiles the components of a force and a torque on a body, with the list of bodies whose motion they depend on.
fn action(
    own: usize,
    nodes: &[Node],
    bodies: &[Body],
    moving: &[usize],
    place: &Pointer<'_>,
    lowering: &mut Lowering<'_>,
) -> Option<Action> {
    let numbers = OF_BODY.len();
    let mut of = vec![own];
    for input in nodes.iter().flat_map(|&node| lowering.graph.inputs(node)).filter(|&input| input > 0) {
        let body = moving[(input - 1) / numbers];
        if !of.contains(&body) {
            of.push(body);
        }
    }
    let local = |input: usize| {
        let Some(behind) = input.checked_sub(1) else { return 0 };
        let place = of.iter().position(|&body| body == moving[behind / numbers]).unwrap_or(0);
        inputs_of(place) + behind % numbers
    };
    let (mut graph, values) = lowering.graph.below_with(nodes, local);
    let outputs = outputs(&mut graph, &values).map_err(|error| {
        lowering.errors.push(SpecificationError::new(place.to_string(), error.code, error.message));
    });
    let bodies_of = of.iter().map(|&body| (body, bodies[body].centre)).collect();
    let program = Tape::compile(&graph, &outputs.ok()?);
    let action = Action { bodies: bodies_of, program, at: Vector3::zeros(), is_local: false };
    if lowering.start.is_some_and(|t| !action.is_finite_at(t, bodies)) {
        let error =
            SpecificationError::new(place.to_string(), "outside_domain", "this force is not finite at the start");
        lowering.errors.push(error.expected("a finite force at the start"));
    }
    Some(action)
}

/// Returns the components of a force and a torque, followed by their derivatives with respect to the inputs `DERIVED`
/// (position, velocity and angular velocity) of the body that they act on.
fn outputs(graph: &mut Graph, values: &[Node]) -> Result<Vec<Node>, ::expression::ExpressionError> {
    let zero = graph.constant(0.0);
    let mut outputs = values.to_vec();
    for &value in values {
        let gradient = graph.gradient(value)?;
        outputs.extend(DERIVED.iter().map(|number| {
            gradient.iter().find(|(input, _)| *input == inputs_of(0) + number).map_or(zero, |(_, node)| *node)
        }));
    }
    debug_assert_eq!(outputs.len(), OUTPUTS);
    Ok(outputs)
}
