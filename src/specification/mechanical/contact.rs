//! Contacts and joints as the user writes them.

use super::super::error::SpecificationError;
use super::super::expression::Expression;
use super::super::lowering::{Constant, Lowering};
use super::super::pointer::Pointer;
use super::super::wording::{abridged, listed};
use expression::{Assumption, Graph, Node, Scope, nearest};
use models::{ContactCoefficient, slip_speed_input};
use problem::ContactData;
use serde::Deserialize;
use solution::Warning;
use utoipa::ToSchema;

/// A potential contact, where bodies can touch.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// Unique name of the contact. The outputs are `NAME_gap`, `NAME_impulse` (the normal impulse accumulated since
    /// the start) and, with friction, `NAME_friction`, or `NAME_friction_1` and `NAME_friction_2`.
    pub name: String,
    /// The gap, an expression in `t` and the coordinates; it must not become negative. The normal velocity is its rate.
    pub gap: Expression,
    /// The coefficient of restitution of the contact, from 0 to 1. Default 0.
    pub restitution: Option<Expression>,
    /// Coulomb friction at the contact. Default: none.
    pub friction: Option<Friction>,
}

/// Coulomb's law for a contact.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Friction {
    /// The coefficient of friction, not negative. It may vary: an expression in `t`, coordinates, velocities, and
    /// `slip_speed`, the speed of the slip, as in `0.2 + 0.1*exp(-slip_speed/0.05)`.
    pub coefficient: Expression,
    /// The coefficient in the direction of the second slip velocity, divided by `coefficient`, which then is the
    /// coefficient in the direction of the first; the set of friction forces is an ellipse. Positive. Default 1, a
    /// disk.
    pub ratio: Option<Expression>,
    /// Slip velocities: one for motion in a plane, two at right angles in space; linear in the velocities, plus the
    /// given velocity of the opposite surface.
    pub slip: Vec<Expression>,
    /// The set of friction forces; irrelevant for a single slip. Default `quadratic`.
    #[serde(default)]
    pub cone: ConeName,
    /// Number of corners of a polyhedral cone, from 4 to 64. Default 8.
    #[schema(minimum = 4, maximum = 64)]
    pub facets: Option<u64>,
}

/// The cross-section of the friction cone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ConeName {
    /// A disk: Coulomb's law itself.
    #[default]
    Quadratic,
    /// A regular polygon inscribed in the disk, with its first corner in the direction of the first slip.
    Polyhedral,
}

/// A bilateral constraint of a mechanical system.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// Unique name of the joint.
    pub name: String,
    /// The constraint function, zero at all times; an expression in `t` and the coordinates.
    pub constraint: Expression,
}

/// Contacts and joints of a mechanical system as graph nodes.
#[derive(Debug, Default)]
pub(super) struct LoweredContacts {
    pub names: Vec<String>,
    pub gaps: Vec<Node>,
    pub slips: Vec<Node>,
    pub data: Vec<ContactData>,
    pub joints: Vec<Node>,
    /// Nodes of the coefficients of friction and restitution that depend on parameters.
    pub terms: Vec<(ContactCoefficient, Node)>,
    /// Node of the coefficient of friction of each contact, if the coefficient varies with time or state.
    pub coefficients: Vec<Option<Node>>,
}

/// Name of the slip speed in the expression of a coefficient of friction.
const SLIP_SPEED: &str = "slip_speed";

const FACETS: u64 = 8;

/// Reads the expressions of the contacts and joints of a system with `n` coordinates as graph nodes.
pub(super) fn lower(
    contacts: &[Contact],
    joints: &[Joint],
    n: usize,
    problem: &Pointer<'_>,
    lowering: &mut Lowering,
) -> LoweredContacts {
    let mut lowered = LoweredContacts::default();
    let mut scope = Scope::new();
    let zero = lowering.graph.constant(0.0);
    let mut name = |name: &str, place: &Pointer<'_>, lowering: &mut Lowering| {
        if let Err(error) = scope.bind(name, zero) {
            let error = SpecificationError::new(place.key("name").to_string(), "contact_name", error.to_string());
            lowering.errors.push(error.expected("a unique name: letters, digits and _, not beginning with a digit"));
        }
    };
    let place = problem.key("joints");
    for (k, joint) in joints.iter().enumerate() {
        let place = place.index(k);
        name(&joint.name, &place, lowering);
        let node = holonomic(&joint.constraint, "a joint", n, &place.key("constraint"), lowering);
        lowered.joints.push(node);
    }
    let place = problem.key("contacts");
    let mut cone = None;
    for (k, contact) in contacts.iter().enumerate() {
        let place = place.index(k);
        name(&contact.name, &place, lowering);
        lowered.names.push(contact.name.clone());
        lowered.gaps.push(holonomic(&contact.gap, "a gap", n, &place.key("gap"), lowering));
        let restitution = contact.restitution.as_ref();
        let restitution = restitution
            .and_then(|value| in_range(value, "restitution", (0.0, 1.0), &place.key("restitution"), lowering));
        let terms = &mut lowered.terms;
        terms.extend(restitution.and_then(|restitution| Some((ContactCoefficient::Restitution(k), restitution.node?))));
        let mut coefficient = None;
        let mut data = ContactData {
            mu: 0.0,
            varies: false,
            ratio: 1.0,
            restitution: restitution.map_or(0.0, |restitution| restitution.value),
            first_slip: lowered.slips.len(),
            slips: 0,
            facets: None,
        };
        if let Some(friction) = &contact.friction {
            let place = place.key("friction");
            match friction.lower(n, &place, &mut data, &mut lowered.slips, lowering) {
                Some(Term::Varying(node)) => coefficient = Some(node),
                Some(Term::Parametric(node)) => lowered.terms.push((ContactCoefficient::Friction(k), node)),
                None => {}
            }
            if data.slips == 2 && *cone.get_or_insert(friction.cone) != friction.cone {
                let detail = "contacts with two slips use both kinds of cone";
                let error = SpecificationError::new(place.key("cone").to_string(), "mixed_cones", detail);
                lowering.errors.push(error.expected("one kind of cone in one problem"));
            }
        }
        lowered.data.push(data);
        lowered.coefficients.push(coefficient);
    }
    lowered
}

/// Graph node of a coefficient of friction that is not a number.
enum Term {
    /// The coefficient of friction depends on parameters alone.
    Parametric(Node),
    /// The coefficient of friction depends on time or on the state.
    Varying(Node),
}

impl Friction {
    /// Returns the coefficient of friction as a graph node, `Some(None)` if it depends on neither time nor state nor
    /// slip speed, and `None` if it is faulty.
    fn varying(&self, n: usize, place: &Pointer<'_>, lowering: &mut Lowering) -> Option<Option<Node>> {
        if matches!(self.coefficient, Expression::Number(_)) {
            return Some(None);
        }
        let slip_speed = lowering.graph.input(slip_speed_input(n));
        let node = lowering.node_with(&[(SLIP_SPEED, slip_speed)], &self.coefficient, place)?;
        Some((!lowering.graph.inputs(node).is_empty()).then_some(node))
    }

    /// Returns the ratio of the coefficients of friction in the second and the first slip direction.
    fn ratio(&self, place: &Pointer<'_>, lowering: &mut Lowering) -> Option<f64> {
        let Some(ratio) = &self.ratio else { return Some(1.0) };
        let place = place.key("ratio");
        let value = lowering.constant(ratio, &place)?;
        let (code, detail, expected) = match () {
            () if self.slip.len() != 2 => {
                ("conflict", "a ratio where there is one slip".to_owned(), "two slips, or no `ratio`")
            }
            () if value <= 0.0 => ("out_of_range", format!("a ratio of {value}"), "a positive number"),
            () => return Some(value),
        };
        lowering.errors.push(SpecificationError::new(place.to_string(), code, detail).expected(expected));
        None
    }

    /// Reads the friction law of a contact. Returns it with the graph node of the coefficient of friction, if the
    /// coefficient depends on parameters, time or state.
    fn lower(
        &self,
        n: usize,
        place: &Pointer<'_>,
        data: &mut ContactData,
        slips: &mut Vec<Node>,
        lowering: &mut Lowering,
    ) -> Option<Term> {
        let (range, of_coefficient) = ((0.0, f64::MAX), place.key("coefficient"));
        let varying = self.varying(n, &of_coefficient, lowering);
        let mu = match varying {
            Some(None) => in_range(&self.coefficient, "coefficient", range, &of_coefficient, lowering),
            _ => None,
        };
        let ratio = self.ratio(place, lowering);
        if !(1..=2).contains(&self.slip.len()) {
            let detail = format!("{} slip velocities", self.slip.len());
            let error = SpecificationError::new(place.key("slip").to_string(), "wrong_shape", detail);
            lowering.errors.push(error.expected("one for motion in a plane, two in space"));
            return None;
        }
        let facets = self.facets.unwrap_or(FACETS);
        if self.facets.is_some() && (self.cone == ConeName::Quadratic || !(4..=64).contains(&facets)) {
            let detail = format!("{facets} corners for a {:?} cone", self.cone).to_lowercase();
            let error = SpecificationError::new(place.key("facets").to_string(), "out_of_range", detail);
            lowering.errors.push(error.expected("4 to 64 corners, for a polyhedral cone"));
            return None;
        }
        let slip_place = place.key("slip");
        let mut nodes = Vec::new();
        for (i, slip) in self.slip.iter().enumerate() {
            let place = slip_place.index(i);
            let node = lowering.node(slip, &place)?;
            let Ok(gradient) = lowering.graph.gradient(node) else { return None };
            let velocities = gradient.iter().filter(|&&(input, _)| input > n);
            let depends =
                |&(_, derivative): &(usize, Node)| lowering.graph.inputs(derivative).iter().any(|&input| input > n);
            let (count, linear) = (velocities.clone().count(), !velocities.clone().any(depends));
            if count == 0 || !linear {
                let detail = match count {
                    0 => "a slip must depend on a velocity",
                    _ => "a slip must be linear in the velocities",
                };
                let error = SpecificationError::new(place.to_string(), "slip_not_linear", detail);
                lowering.errors.push(error.expected("D(t,q)^T v, plus the velocity of the opposite surface"));
                return None;
            }
            nodes.push(node);
        }
        data.ratio = ratio?;
        if let Some(second) = nodes.get_mut(1).filter(|_| data.ratio != 1.0) {
            let ratio = lowering.graph.constant(data.ratio);
            *second = lowering.graph.multiply(*second, ratio);
        }
        let facets = (self.cone == ConeName::Polyhedral && nodes.len() == 2).then_some(facets as usize);
        if let Some(node) = varying? {
            (data.mu, data.varies) = (f64::NAN, true);
            (data.slips, data.facets) = (nodes.len(), facets);
            slips.extend(nodes);
            return Some(Term::Varying(node));
        }
        // A contact whose coefficient of friction is faulty gets no friction.
        let Constant { value: mu, node } = mu?;
        if let Some(node) = node {
            lowering.graph.assume(node, Assumption::Vanishing);
        }
        if mu > 0.0 {
            data.mu = mu;
            (data.slips, data.facets) = (nodes.len(), facets);
            slips.extend(nodes);
        }
        node.map(Term::Parametric)
    }
}

/// Returns a warning if a coefficient of friction has a kink in the state, where no event is located.
pub(super) fn kink(contact: &str, coefficient: Node, states: &[String], graph: &Graph) -> Option<Warning> {
    let (function, inputs) = graph.kinks(coefficient).into_iter().find(|(_, inputs)| inputs.iter().any(|i| *i > 0))?;
    let of: Vec<&str> = inputs
        .iter()
        .map(|&input| match input.checked_sub(1) {
            None => "t",
            Some(i) => states.get(i).map_or(SLIP_SPEED, String::as_str),
        })
        .collect();
    Some(Warning {
        code: "kink_in_rate",
        message: format!(
            "the coefficient of friction of `{contact}` has a kink or a jump, `{function}` of {}, that is not located: steps \
             shrink where it is crossed; for a smooth transition of width w write tanh((x - x0)/w), and for friction that \
             depends on the slip `{SLIP_SPEED}`, which is smooth while a contact slips",
            listed(of.into_iter())
        ),
    })
}

/// Parses a constraint function, which must depend on coordinates and may not depend on velocities, to a graph node.
fn holonomic(expression: &Expression, what: &str, n: usize, place: &Pointer<'_>, lowering: &mut Lowering) -> Node {
    let Some(node) = lowering.node(expression, place) else { return lowering.graph.constant(1.0) };
    let inputs = lowering.graph.inputs(node);
    if inputs.iter().any(|&input| input > n) {
        let detail = format!("{what} may not depend on velocities");
        let error = SpecificationError::new(place.to_string(), "depends_on_velocity", detail);
        lowering.errors.push(error.expected("an expression in `t` and the coordinates"));
    } else if inputs.iter().all(|&input| input == 0) {
        let detail = format!("{what} that depends on no coordinate has no direction: its gradient is zero");
        let error = SpecificationError::new(place.to_string(), "zero_gradient", detail);
        lowering.errors.push(error.expected("an expression in the coordinates"));
    }
    node
}

fn in_range(
    expression: &Expression,
    what: &str,
    (least, most): (f64, f64),
    place: &Pointer<'_>,
    lowering: &mut Lowering,
) -> Option<Constant> {
    let constant = lowering.parametric(expression, place)?;
    let value = constant.value;
    if (least..=most).contains(&value) {
        return Some(constant);
    }
    let error = SpecificationError::new(place.to_string(), "out_of_range", format!("a {what} of {value}"));
    let range = if most < f64::MAX { format!("from {least} to {most}") } else { format!("{least} or more") };
    lowering.errors.push(error.expected(range));
    None
}

/// Returns the error for a force on a coordinate that the mechanical system does not have.
pub(super) fn unknown_coordinate(name: &str, coordinates: &[String], place: &Pointer<'_>) -> SpecificationError {
    let names = || coordinates.iter().map(String::as_str);
    SpecificationError::new(place.to_string(), "unknown_name", format!("`{}` is not a coordinate", abridged(name)))
        .expected(listed(names()))
        .did_you_mean(nearest(name, names()))
}
