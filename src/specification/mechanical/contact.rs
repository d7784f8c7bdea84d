//! Contacts and joints as the user writes them.

use super::super::error::SpecificationError;
use super::super::expression::Expression;
use super::super::lowering::{Constant, Lowering};
use super::super::pointer::Pointer;
use super::super::wording::{abridged, listed};
use expression::{Assumption, Node, Scope, nearest};
use models::ContactCoefficient;
use problem::ContactData;
use serde::Deserialize;
use utoipa::ToSchema;

/// A potential contact, where bodies can touch.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// Unique name. The outputs are `NAME_gap`, `NAME_impulse` (the normal impulse accumulated since the start) and,
    /// with friction, `NAME_friction`, or `NAME_friction_1` and `NAME_friction_2`.
    pub name: String,
    /// The gap, an expression in `t` and the coordinates; it must not become negative. The normal velocity is its rate.
    pub gap: Expression,
    /// The coefficient of restitution, from 0 to 1. Default 0.
    pub restitution: Option<Expression>,
    /// Coulomb friction. Default: none.
    pub friction: Option<Friction>,
}

/// Coulomb's law for a contact.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Friction {
    /// Coefficient of friction, not negative.
    pub coefficient: Expression,
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

/// A bilateral constraint.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// Unique name.
    pub name: String,
    /// The constraint function, zero at all times; an expression in `t` and the coordinates.
    pub constraint: Expression,
}

/// Contacts and joints as graph nodes.
#[derive(Debug, Default)]
pub(super) struct LoweredContacts {
    pub names: Vec<String>,
    pub gaps: Vec<Node>,
    pub slips: Vec<Node>,
    pub data: Vec<ContactData>,
    pub joints: Vec<Node>,
    /// The nodes of coefficients that depend on parameters.
    pub terms: Vec<(ContactCoefficient, Node)>,
}

const FACETS: u64 = 8;

/// Lowers contacts and joints of a system with `n` coordinates.
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
            lowering
                .errors
                .push(error.expected("a name of its own: letters, digits and _, not beginning with a digit"));
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
        let mut data = ContactData {
            mu: 0.0,
            restitution: restitution.map_or(0.0, |restitution| restitution.value),
            first_slip: lowered.slips.len(),
            slips: 0,
            facets: None,
        };
        if let Some(friction) = &contact.friction {
            let place = place.key("friction");
            let term = friction.lower(n, &place, &mut data, &mut lowered.slips, lowering);
            lowered.terms.extend(term.map(|node| (ContactCoefficient::Friction(k), node)));
            if data.slips == 2 && *cone.get_or_insert(friction.cone) != friction.cone {
                let detail = "contacts with two slips use both kinds of cone";
                let error = SpecificationError::new(place.key("cone").to_string(), "mixed_cones", detail);
                lowering.errors.push(error.expected("one kind of cone in one problem"));
            }
        }
        lowered.data.push(data);
    }
    lowered
}

impl Friction {
    /// Lowers the friction of a contact. Returns the node of its coefficient if that depends on parameters.
    fn lower(
        &self,
        n: usize,
        place: &Pointer<'_>,
        data: &mut ContactData,
        slips: &mut Vec<Node>,
        lowering: &mut Lowering,
    ) -> Option<Node> {
        let range = (0.0, f64::MAX);
        let mu = in_range(&self.coefficient, "coefficient", range, &place.key("coefficient"), lowering);
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
        // Without a valid coefficient no friction is built.
        let Constant { value: mu, node } = mu?;
        if let Some(node) = node {
            lowering.graph.assume(node, Assumption::Vanishing);
        }
        if mu > 0.0 {
            data.mu = mu;
            data.slips = nodes.len();
            data.facets = (self.cone == ConeName::Polyhedral && nodes.len() == 2).then_some(facets as usize);
            slips.extend(nodes);
        }
        node
    }
}

/// Lowers an expression that must depend on coordinates, and not on velocities.
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

/// The error of a force on an unknown coordinate.
pub(super) fn unknown_coordinate(name: &str, coordinates: &[String], place: &Pointer<'_>) -> SpecificationError {
    let names = || coordinates.iter().map(String::as_str);
    SpecificationError::new(place.to_string(), "unknown_name", format!("`{}` is not a coordinate", abridged(name)))
        .expected(listed(names()))
        .did_you_mean(nearest(name, names()))
}
