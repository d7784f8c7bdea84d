//! Obstacles of an elastic body, and the nodes that may come into contact with them.

use super::ElasticProblem;
use super::body::Geometry;
use super::field::Field;
use super::sides::unknown;
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use crate::range::in_range;
use models::elastic::ContactNode;
use models::finite_elements::Side;
use serde::Deserialize;
use std::collections::HashSet;
use utoipa::ToSchema;

/// An obstacle that an elastic body may touch.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ElasticContact {
    /// Gap: the largest displacement of the body towards the obstacle from its undeformed configuration, as an
    /// expression in `t` and the coordinates. Not below the initial displacement.
    pub gap: Expression,
    /// Interval along a string that the obstacle occupies, both ends included; two equal numbers are a point. Default:
    /// the whole string. Contact nodes are every second node, counted from 0.
    pub between: Option<(Expression, Expression)>,
    /// Coulomb's coefficient of friction with the obstacle, which is at rest; not for strings and bars. Default 0,
    /// frictionless.
    pub friction: Option<Expression>,
}

/// A potential contact node: the index of its displacement normal to the obstacle; the displacements of its
/// neighbours, to which its mass is moved, since contact nodes have no mass; and its position.
struct Meeting {
    displacement: usize,
    carriers: Vec<usize>,
    point: [f64; 3],
}

const STRING_SIDES: [&str; 2] = ["below", "above"];

impl ElasticProblem {
    /// Collects all potential contact nodes of an elastic body, and the names of the sides that face an obstacle.
    pub(super) fn contacts(
        &self,
        geometry: &Geometry,
        clamped: &[bool],
        displacement: &[f64],
        place: &Pointer<'_>,
        lowering: &mut Lowering,
    ) -> (Vec<ContactNode>, Vec<String>) {
        let elements = place.key("elements");
        let place = place.key("contact");
        let (mut contacts, mut sides) = (Vec::new(), Vec::new());
        for (name, contact) in self.contact.iter() {
            let place = place.key(name);
            let met = match geometry.is_string {
                true => self.met_by_string(name, contact, geometry, (&place, &elements), lowering),
                false => self.met_by_side(name, contact, geometry, (&place, &elements), lowering),
            };
            let Some((towards, mut met)) = met else { continue };
            met.retain(|node| !clamped[node.displacement]);
            if met.is_empty() {
                let detail = "no free node can come into contact with this obstacle";
                let error = SpecificationError::new(place.to_string(), "no_contact_node", detail);
                lowering.errors.push(
                    error.expected(
                        "a side that is not clamped; for a string, an interval with an even-numbered free node",
                    ),
                );
                continue;
            }
            let side = sides.len();
            sides.push(name.to_owned());
            let friction = friction(contact, geometry, &place, lowering);
            let place = place.key("gap");
            let mut field = Field::read(&contact.gap, &geometry.grid, &place, lowering);
            let mut passed = false;
            for Meeting { displacement: d, carriers, point } in met {
                let gap = field.at(point, lowering);
                let tangential = geometry.others_of(d).filter(|&other| !clamped[other]).collect();
                contacts.push(ContactNode { displacement: d, towards, gap, carriers, friction, tangential, side });
                let Some(t) = lowering.start.filter(|_| !passed) else { continue };
                let at_start = lowering.graph.substitute(gap, &[(0, t)]).ok();
                let Some(gap) = at_start.and_then(|node| lowering.graph.value(node)) else { continue };
                let gone = towards * displacement[d];
                if gone > gap + ROUNDING * (gone.abs() + gap.abs()) {
                    passed = true;
                    let detail =
                        format!("at x = {}, t = {t} the body is {} beyond this obstacle", point[0], gone - gap);
                    let error = SpecificationError::new(place.to_string(), "penetrates_obstacle", detail);
                    lowering.errors.push(error.expected("a gap not below the initial displacement"));
                }
            }
        }
        let is_contact: HashSet<usize> = contacts.iter().map(|contact| contact.displacement).collect();
        for contact in &mut contacts {
            contact.tangential.retain(|displacement| !is_contact.contains(displacement));
            if contact.tangential.is_empty() {
                contact.friction = 0.0;
            }
        }
        (contacts, sides)
    }

    fn met_by_side(
        &self,
        name: &str,
        contact: &ElasticContact,
        geometry: &Geometry,
        (place, elements): (&Pointer<'_>, &Pointer<'_>),
        lowering: &mut Lowering,
    ) -> Option<(f64, Vec<Meeting>)> {
        let side = geometry.side(name, place, lowering)?;
        if contact.between.is_some() {
            let error =
                SpecificationError::new(place.key("between").to_string(), "conflict", "`between` is for strings only");
            lowering.errors.push(error.expected("to be left out"));
        }
        if geometry.grid.axes()[side.direction].elements < 2 {
            let place = self.elements.pointer(side.direction, elements);
            let detail =
                format!("there is only one layer of elements behind `{name}`, and all of its mass would be in contact");
            let error = SpecificationError::new(place, "out_of_range", detail);
            lowering.errors.push(error.expected("2 or more"));
            return None;
        }
        let (grid, components) = (&geometry.grid, geometry.components);
        let Side { direction, is_upper } = side;
        let meeting = |node: usize| {
            let mut inwards = grid.indices(node);
            inwards[direction] = if is_upper { inwards[direction] - 1 } else { 1 };
            Meeting {
                displacement: node * components + direction,
                carriers: vec![grid.node(inwards) * components + direction],
                point: grid.coordinates(node),
            }
        };
        Some((if is_upper { 1.0 } else { -1.0 }, grid.nodes_on(side).map(meeting).collect()))
    }

    fn met_by_string(
        &self,
        name: &str,
        contact: &ElasticContact,
        geometry: &Geometry,
        (place, elements): (&Pointer<'_>, &Pointer<'_>),
        lowering: &mut Lowering,
    ) -> Option<(f64, Vec<Meeting>)> {
        let towards = match name {
            "below" => -1.0,
            "above" => 1.0,
            _ => {
                unknown(name, STRING_SIDES.to_vec(), place, lowering);
                return None;
            }
        };
        let axis = geometry.grid.axes()[0];
        let count = axis.elements;
        if count % 2 == 1 {
            let detail = format!(
                "{count} elements is odd; every second node of a string is a contact node without mass, the first and \
                 the last included"
            );
            let error = SpecificationError::new(self.elements.pointer(0, elements), "odd_elements", detail);
            lowering.errors.push(error.expected("an even number"));
            return None;
        }
        let place = place.key("between");
        let (lower, upper) = match &contact.between {
            Some((lower, upper)) => (
                lowering.constant(lower, &place.index(0)).unwrap_or(axis.lower),
                lowering.constant(upper, &place.index(1)).unwrap_or(axis.upper),
            ),
            None => (axis.lower, axis.upper),
        };
        let slack = ROUNDING * (axis.upper - axis.lower);
        let meeting = |node: usize| Meeting {
            displacement: node,
            carriers: [node.checked_sub(1), Some(node + 1)].into_iter().flatten().filter(|&n| n <= count).collect(),
            point: geometry.grid.coordinates(node),
        };
        let even = (0..=count).step_by(2).map(meeting);
        let met = even.filter(|node| (lower - slack..=upper + slack).contains(&node.point[0])).collect();
        Some((towards, met))
    }
}

impl Geometry {
    /// Returns the other displacement components at the node that a displacement component belongs to.
    fn others_of(&self, displacement: usize) -> impl Iterator<Item = usize> {
        let first = displacement - displacement % self.components;
        (first..first + self.components).filter(move |&other| other != displacement)
    }
}

/// Reads the coefficient of friction between an elastic body and an obstacle.
fn friction(contact: &ElasticContact, geometry: &Geometry, place: &Pointer<'_>, lowering: &mut Lowering) -> f64 {
    let Some(friction) = &contact.friction else { return 0.0 };
    let place = place.key("friction");
    if geometry.components == 1 {
        let error = SpecificationError::new(place.to_string(), "conflict", "this body cannot slide along an obstacle");
        lowering.errors.push(error.expected("to be left out"));
    }
    let range: (fn(f64) -> bool, _) = (|value| value >= 0.0, "of 0 or more");
    in_range(friction, "coefficient of friction", range, &place, lowering).unwrap_or(0.0)
}

/// Relative tolerance for rounding in comparisons of lengths of bodies and obstacles.
const ROUNDING: f64 = 1e-12;
