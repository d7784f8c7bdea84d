//! Names of the unknowns of an elastic body, and further outputs: probes, contact forces, energies.

use super::ElasticProblem;
use super::body::Geometry;
use crate::directions::DIRECTIONS;
use crate::error::SpecificationError;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use expression::Node;
use models::Outputs;
use models::elastic::{ContactNode, Continuum, DisplacementIndex as Unknown, Frictional, Semidiscrete, Slip};

/// The names of the states and variables of an elastic body.
pub(super) struct Names {
    pub states: Vec<String>,
    pub variables: Vec<String>,
}

/// A probe, the displacement at a point of an elastic body: a weighted sum of nodal displacements.
pub(super) struct Probe {
    name: String,
    weights: Vec<(usize, f64)>,
}

/// Returns the names of the states and variables, which contain the indices of their nodes.
pub(super) fn names(geometry: &Geometry, continuum: &Continuum, lowered: &Semidiscrete, sides: &[String]) -> Names {
    let rows = &lowered.rows;
    let mut names = vec![String::new(); rows.state_forcing.len() + rows.inequality_forcing.len()];
    let grid = &geometry.grid;
    let node_of = |d: usize| {
        let indices = grid.indices(d / geometry.components);
        let indices: Vec<String> = indices.iter().take(grid.dimension()).map(usize::to_string).collect();
        indices.join(",")
    };
    for (d, &place) in lowered.unknowns.places.iter().enumerate() {
        let axis = if geometry.components == 1 { "" } else { DIRECTIONS[d % geometry.components] };
        match place {
            Unknown::Inner(u, v) => {
                names[u] = format!("u{axis}({})", node_of(d));
                names[v] = format!("v{axis}({})", node_of(d));
            }
            Unknown::Contact(u, _) => names[u] = format!("u{axis}({})", node_of(d)),
            Unknown::Clamped(_) => {}
        }
    }
    let force = |kind: &str, contact: &ContactNode| {
        format!("{kind}_{}({})", sides[contact.side], node_of(contact.displacement))
    };
    let states = lowered.unknowns.states();
    if lowered.unknowns.has_forces {
        for (k, contact) in continuum.contacts.iter().enumerate() {
            names[states + k] = force("force", contact);
        }
    }
    for rough in &lowered.rough {
        let contact = &continuum.contacts[rough.contact];
        names[rough.limit] = force("limit", contact);
        for slip in &rough.slips {
            names[slip.force] = force("friction", contact);
            if rough.slips.len() > 1 {
                names[slip.force].push_str(DIRECTIONS[slip.displacement % geometry.components]);
            }
        }
    }
    let variables = names.split_off(states);
    Names { states: names, variables }
}

/// Builds the outputs of an elastic body other than its unknowns: probes, contact forces, energies.
pub(super) fn lower(
    probes: &[Probe],
    continuum: &Continuum,
    lowered: &Semidiscrete,
    sides: &[String],
    lowering: &mut Lowering,
) -> Outputs {
    let graph = &mut lowering.graph;
    let zero = graph.constant(0.0);
    let mut names: Vec<String> = probes.iter().map(|probe| probe.name.clone()).collect();
    let mut nodes: Vec<Node> = Vec::with_capacity(names.len());
    for probe in probes {
        let mut sum = zero;
        for &(d, weight) in &probe.weights {
            let value = match lowered.unknowns.places[d] {
                Unknown::Clamped(value) => graph.constant(value),
                Unknown::Inner(u, _) | Unknown::Contact(u, _) => graph.input(1 + u),
            };
            let weight = graph.constant(weight);
            let term = graph.multiply(weight, value);
            sum = graph.add(sum, term);
        }
        nodes.push(sum);
    }
    names.extend(sides.iter().map(|side| format!("force_{side}")));
    let mut forces = vec![zero; sides.len()];
    for (node, &reaction) in continuum.contacts.iter().zip(&lowered.reactions) {
        forces[node.side] = graph.add(forces[node.side], reaction);
    }
    nodes.extend(forces);
    for (side, name) in sides.iter().enumerate() {
        for (axis, name_of_axis) in DIRECTIONS.iter().enumerate().take(continuum.components) {
            let of_side = |rough: &&Frictional| continuum.contacts[rough.contact].side == side;
            let along = |slip: &&Slip| slip.displacement % continuum.components == axis;
            let slips = lowered.rough.iter().filter(of_side).flat_map(|rough| &rough.slips).filter(along);
            let forces: Vec<Node> = slips.map(|slip| graph.input(1 + slip.force)).collect();
            if !forces.is_empty() {
                let sum = forces.into_iter().fold(zero, |sum, force| graph.add(sum, force));
                names.push(format!("friction_{name}_{name_of_axis}"));
                nodes.push(graph.negate(sum));
            }
        }
    }
    let unknowns = lowered.rows.state_forcing.len() + lowered.rows.inequality_forcing.len();
    Outputs::new(graph, names, &nodes, unknowns).with_energy(lowered.energy.clone())
}

impl ElasticProblem {
    /// Reads the user's probes (displacements at given points) as weighted sums of nodal displacements.
    pub(super) fn probes(&self, geometry: &Geometry, place: &Pointer<'_>, lowering: &mut Lowering) -> Vec<Probe> {
        let place = place.key("probes");
        let mut probes = Vec::new();
        for (name, point) in self.probes.iter() {
            let place = place.key(name);
            lowering.keep_name(name, &place);
            let dimension = geometry.grid.dimension();
            if point.len() != dimension {
                let detail = format!("{} coordinates in {dimension} dimensions", point.len());
                let error = SpecificationError::new(place.to_string(), "wrong_shape", detail);
                lowering.errors.push(error.expected(format!("{dimension} coordinates")));
                continue;
            }
            // Multilinear weights of the corners of the element that contains the point, one direction after another.
            let mut corners = vec![([0; 3], 1.0)];
            for (k, (coordinate, axis)) in point.iter().zip(geometry.grid.axes()).enumerate() {
                let place = place.index(k);
                let Some(value) = lowering.constant(coordinate, &place) else { continue };
                if !(axis.lower..=axis.upper).contains(&value) {
                    let error = SpecificationError::new(
                        place.to_string(),
                        "out_of_range",
                        format!("{} = {value} is outside the body", DIRECTIONS[k]),
                    );
                    lowering.errors.push(error.expected(format!("from {} to {}", axis.lower, axis.upper)));
                    continue;
                }
                let along = (value - axis.lower) / (axis.upper - axis.lower) * axis.elements as f64;
                let element = (along as usize).min(axis.elements - 1);
                let part = along - element as f64;
                corners = corners
                    .into_iter()
                    .flat_map(|(at, weight): ([usize; 3], f64)| {
                        [(element, 1.0 - part), (element + 1, part)].map(|(i, share)| {
                            let mut at = at;
                            at[k] = i;
                            (at, weight * share)
                        })
                    })
                    .filter(|(_, weight)| *weight != 0.0)
                    .collect();
            }
            let components = geometry.components;
            probes.extend((0..components).map(|c| Probe {
                name: if components == 1 { name.to_owned() } else { format!("{name}_{}", DIRECTIONS[c]) },
                weights: corners.iter().map(|&(at, w)| (geometry.grid.node(at) * components + c, w)).collect(),
            }));
        }
        probes
    }
}
