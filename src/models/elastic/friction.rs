//! Coulomb friction between an elastic body and an obstacle at rest. A contact node keeps its mass in tangential
//! directions, and the friction force `q` obeys the principle of maximum dissipation,
//!
//! ```text
//! m v' = .. - q,    |q| <= p,    -<v, q~ - q> >= 0  for all |q~| <= p,    0 = mu r - p
//! ```
//!
//! with the tangential velocity `v` and the normal force `r`. The friction bound `p` is an algebraic state, so that
//! the convex set depends on states alone.

use super::{Continuum, DisplacementIndex, Unknowns};
use crate::LinearRows;
use expression::Graph;
use problem::{MovingBound, Shape, Side};

/// A frictional contact of an elastic body, with the positions of its unknowns.
#[derive(Clone, Debug)]
pub struct Frictional {
    /// The index of the contact in [`Continuum::contacts`].
    pub contact: usize,
    /// The index in `(x, z)` of the contact's friction bound `p`.
    pub limit: usize,
    /// The tangential directions of the contact, in which friction acts.
    pub slips: Vec<Slip>,
}

/// A tangential direction of a frictional contact.
#[derive(Clone, Copy, Debug)]
pub struct Slip {
    /// The index of the tangential displacement component in this direction.
    pub displacement: usize,
    /// The index in `(x, z)` of the tangential velocity in this direction.
    pub velocity: usize,
    /// The index in `(x, z)` of the friction force in this direction.
    pub force: usize,
}

/// Adds friction to the equations of an elastic body with frictionless contacts, in the form in which contact forces
/// are variables.
pub(super) fn add(
    graph: &mut Graph,
    rows: &mut LinearRows,
    continuum: &Continuum,
    unknowns: &Unknowns,
) -> Vec<Frictional> {
    let states = unknowns.states();
    let zero = graph.constant(0.0);
    let contacts = continuum.contacts.iter().enumerate().filter(|(_, contact)| contact.friction > 0.0);
    let mut all = Vec::with_capacity(unknowns.rough);
    for (k, (contact, node)) in contacts.enumerate() {
        let limit = unknowns.limit(k);
        rows.matrix.push((limit, states + contact, node.friction));
        rows.matrix.push((limit, limit, -1.0));
        let mut slips = Vec::new();
        for &displacement in &node.tangential {
            let DisplacementIndex::Inner(_, velocity) = unknowns.places[displacement] else { continue };
            let force = states + rows.inequality_forcing.len();
            rows.inequality_forcing.push(zero);
            rows.matrix.push((force, velocity, -1.0));
            rows.matrix.push((velocity, force, -1.0));
            rows.set.lower.push(f64::NEG_INFINITY);
            rows.set.upper.push(f64::INFINITY);
            slips.push(Slip { displacement, velocity, force });
        }
        all.push(Frictional { contact, limit, slips });
    }
    for Frictional { limit, slips, .. } in &all {
        let radius = graph.input(1 + limit);
        let members: Vec<usize> = slips.iter().map(|slip| slip.force - states).collect();
        match *members {
            [variable] => {
                let lower = graph.negate(radius);
                rows.moving.push((MovingBound { variable, side: Side::Lower }, lower));
                rows.moving.push((MovingBound { variable, side: Side::Upper }, radius));
            }
            [variable, ..] => {
                rows.set.bind(members, Shape::Ball { radius: 0.0 });
                rows.moving.push((MovingBound { variable, side: Side::Radius }, radius));
            }
            [] => {}
        }
    }
    all
}
