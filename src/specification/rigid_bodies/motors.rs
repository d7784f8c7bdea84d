//! Motors, servos, springs, dampers and stops along the coordinate of a hinge or a slider.

use super::joints::AxialJoint;
use super::springs;
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use crate::range::in_range;
use ::expression::{Node, Tape};
use models::rigid_bodies::{DriveLaw, ForceLaw, Limits, Servo, Signals};
use serde::Deserialize;
use utoipa::ToSchema;

/// The motor of a joint. The coordinate of a hinge is the angle, in radians, by which the first of its moving bodies
/// has rotated about the axis since the start, relative to the other body or the world; that of a slider is the
/// displacement along the axis, in metres. Motors are expressions in `t` and parameters.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Motor {
    /// Prescribed coordinate of the joint, enforced by whatever effort is needed; zero at the start.
    Position(Expression),
    /// Prescribed rate of the joint coordinate, enforced by whatever effort is needed.
    Velocity(Expression),
    /// Prescribed effort: a torque in newton metres, or a force along the axis in newtons.
    Effort(Expression),
    /// A controlled torque or force towards a target.
    Servo(ServoMotor),
}

/// The torque or force `stiffness*(target - q) + damping*(d target/dt - dq/dt)`, with the coordinate `q`.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ServoMotor {
    /// The target of the joint coordinate.
    pub target: Expression,
    /// Stiffness of the servo in newton metres per radian, or newtons per metre, not negative. Default 0.
    pub stiffness: Option<Expression>,
    /// Damping of the servo in newton metre seconds per radian, or newton seconds per metre, not negative. Default 0.
    pub damping: Option<Expression>,
    /// The largest torque or force of the servo, above 0. Default: unlimited.
    pub largest_effort: Option<Expression>,
}

/// A spring and a damper along the coordinate of a joint. The energy of the spring is part of `potential_energy`.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct JointSpring {
    /// Stiffness of the spring in newton metres per radian, or newtons per metre, not negative. Default 0.
    pub stiffness: Option<Expression>,
    /// Damping coefficient in newton metre seconds per radian, or newton seconds per metre, not negative. Default 0.
    pub damping: Option<Expression>,
    /// The coordinate (see `motor`) at which the spring is relaxed. Default 0.
    pub rest: Option<Expression>,
}

/// The stops of a joint: limits of its coordinate (see `motor`), which is 0 at the start.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct JointLimits {
    /// Lower limit of the joint coordinate, not above 0. Default: none.
    pub lower: Option<Expression>,
    /// Upper limit of the joint coordinate, not below 0. Default: none.
    pub upper: Option<Expression>,
    /// The coefficient of restitution of the stops, from 0 to 1. Default 0.
    pub restitution: Option<Expression>,
}

impl JointLimits {
    pub(super) fn lower(&self, place: &Pointer<'_>, lowering: &mut Lowering<'_>) -> Limits {
        let mut read = |value: &Option<Expression>, key: &str, range: (fn(f64) -> bool, &str)| {
            value.as_ref().and_then(|value| in_range(value, key, range, &place.key(key), lowering))
        };
        let lower = read(&self.lower, "lower", (|x| x <= 0.0, "not above 0: joints start at 0"));
        let upper = read(&self.upper, "upper", (|x| x >= 0.0, "not below 0: joints start at 0"));
        let restitution = read(&self.restitution, "restitution", (|e| (0.0..=1.0).contains(&e), "from 0 to 1"));
        if self.lower.is_none() && self.upper.is_none() {
            let error =
                SpecificationError::new(place.to_string(), "empty", "there is neither a lower nor an upper limit");
            lowering.errors.push(error.expected("`lower`, `upper`, or both"));
        } else if lower == Some(0.0) && upper == Some(0.0) {
            let error = SpecificationError::new(
                place.to_string(),
                "out_of_range",
                "both limits are 0, so the joint cannot move",
            );
            lowering.errors.push(error.expected("limits apart, or a `fixed` joint"));
        }
        Limits {
            lower: lower.unwrap_or(f64::NEG_INFINITY),
            upper: upper.unwrap_or(f64::INFINITY),
            restitution: restitution.unwrap_or(0.0),
        }
    }
}

/// The functions of time of a rigid-body problem, collected while the problem is translated to its model.
#[derive(Debug, Default)]
pub(super) struct Functions {
    nodes: Vec<Node>,
}

impl Functions {
    /// Adds a function of time and its rate and returns its index; `None` if the function is faulty or depends on
    /// more than time.
    pub fn add(&mut self, given: &Expression, place: &Pointer<'_>, lowering: &mut Lowering<'_>) -> Option<usize> {
        let node = lowering.node(given, place)?;
        if lowering.graph.inputs(node).iter().any(|&input| input > 0) {
            let error = SpecificationError::new(
                place.to_string(),
                "depends_on_state",
                "a motor or a prescribed motion must not depend on the motion of bodies",
            );
            lowering.errors.push(error.expected("an expression in `t` and parameters; `forces` may depend on bodies"));
            return None;
        }
        let rate = match lowering.graph.gradient(node) {
            Ok(gradient) => gradient.first().map(|(_, rate)| *rate),
            Err(error) => {
                lowering.errors.push(SpecificationError::new(place.to_string(), error.code, error.message));
                return None;
            }
        };
        let zero = lowering.graph.constant(0.0);
        self.nodes.extend([node, rate.unwrap_or(zero)]);
        Some(self.nodes.len() / 2 - 1)
    }

    /// Compiles all functions of time and their rates.
    pub fn signals(&self, lowering: &mut Lowering<'_>) -> Signals {
        Signals::new(&mut lowering.graph, &self.nodes)
    }

    /// Returns the rounding error of the value of a function of time at the start.
    fn rounding_at_start(&self, function: usize, lowering: &mut Lowering<'_>) -> f64 {
        let signals = Signals::new(&mut lowering.graph, &self.nodes[2 * function..2 * function + 2]);
        lowering.start.map_or(0.0, |t| signals.rounding(t))
    }

    /// Returns value and rate of a function of time at the start time, if that time is known.
    pub fn at_start(&self, function: usize, lowering: &Lowering<'_>) -> Option<[f64; 2]> {
        let mut values = [0.0; 2];
        Tape::compile(&lowering.graph, &self.nodes[2 * function..2 * function + 2]).evaluate(
            lowering.start?,
            &[],
            &mut values,
        );
        Some(values)
    }
}

/// Returns the drive law and the limits of a joint, if it has a motor, a spring or limits.
pub(super) fn lower(
    joint: &AxialJoint,
    place: &Pointer<'_>,
    functions: &mut Functions,
    lowering: &mut Lowering<'_>,
) -> Option<(DriveLaw, Limits)> {
    let (motor, spring) = (joint.motor.as_ref(), joint.spring.as_ref());
    let limits = joint.limits.as_ref().map(|limits| limits.lower(&place.key("limits"), lowering));
    let mut law = ForceLaw::default();
    if let Some(spring) = spring {
        let place = place.key("spring");
        law = springs::law((&spring.stiffness, &spring.damping), &place, lowering);
        law.rest = spring.rest.as_ref().and_then(|rest| lowering.constant(rest, &place.key("rest"))).unwrap_or(0.0);
    }
    let place = place.key("motor");
    match motor {
        None if spring.is_none() && limits.is_none() => return None,
        None => {}
        Some(Motor::Effort(effort)) => law.effort = Some(finite(effort, &place.key("effort"), functions, lowering)?),
        Some(Motor::Servo(servo)) => law.servo = Some(servo.lower(&place.key("servo"), functions, lowering)?),
        Some(Motor::Position(given) | Motor::Velocity(given)) => {
            let (key, is_position) = match motor {
                Some(Motor::Position(_)) => ("position", true),
                _ => ("velocity", false),
            };
            let place = place.key(key);
            let function = finite(given, &place, functions, lowering)?;
            if spring.is_some() || limits.is_some() {
                let detail = "the motion of this joint is prescribed, and springs and limits have no effect on it";
                let error = SpecificationError::new(place.to_string(), "conflict", detail);
                lowering
                    .errors
                    .push(error.expected("a `servo` or an `effort` beside `spring` and `limits`, or neither of them"));
            }
            if is_position
                && let Some([start, _]) = functions.at_start(function, lowering)
                && start.abs() > functions.rounding_at_start(function, lowering)
            {
                let detail = format!("the position is {start} at the start, where the coordinate of a joint is 0");
                let error = SpecificationError::new(place.to_string(), "inconsistent_start", detail);
                lowering
                    .errors
                    .push(error.expected("a position that is 0 at `time.start`, and bodies placed accordingly"));
            }
            let law = if is_position { DriveLaw::Position(function) } else { DriveLaw::Velocity(function) };
            return Some((law, Limits::NONE));
        }
    }
    Some((DriveLaw::Force(law), limits.unwrap_or(Limits::NONE)))
}

/// Adds a function of time that must be finite at the start time, and returns its index.
pub(super) fn finite(
    given: &Expression,
    place: &Pointer<'_>,
    functions: &mut Functions,
    lowering: &mut Lowering<'_>,
) -> Option<usize> {
    let function = functions.add(given, place, lowering)?;
    if functions.at_start(function, lowering).is_some_and(|both| both.iter().any(|value| !value.is_finite())) {
        let detail = "this, or its rate, is not finite at the start";
        let error = SpecificationError::new(place.to_string(), "outside_domain", detail);
        lowering.errors.push(error.expected("a function that is finite with its derivative at `time.start`"));
        return None;
    }
    Some(function)
}

impl ServoMotor {
    fn lower(&self, place: &Pointer<'_>, functions: &mut Functions, lowering: &mut Lowering<'_>) -> Option<Servo> {
        let law = springs::law((&self.stiffness, &self.damping), place, lowering);
        let most = self.largest_effort.as_ref().and_then(|most| {
            in_range(most, "largest effort", (|x| x > 0.0, "above 0"), &place.key("largest_effort"), lowering)
        });
        let target = finite(&self.target, &place.key("target"), functions, lowering)?;
        let ForceLaw { stiffness, damping, .. } = law;
        Some(Servo { target, stiffness, damping, most: most.unwrap_or(f64::INFINITY) })
    }
}
