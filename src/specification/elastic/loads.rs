//! Loads on an elastic body, and its initial state.

use super::ElasticProblem;
use super::body::Geometry;
use super::field::Field;
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use expression::Node;
use models::finite_elements::{Element, Quadrature};
use serde::Deserialize;
use utoipa::ToSchema;

/// Initial displacement and velocity of an elastic body; members left out are zero.
#[derive(Clone, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ElasticStart {
    /// Initial displacement as expressions in the coordinates, one component per direction. Clamped sides keep it.
    pub displacement: Option<Vec<Expression>>,
    /// Initial velocity as expressions in the coordinates, one component per direction. It is ignored on clamped
    /// sides.
    pub velocity: Option<Vec<Expression>>,
}

impl ElasticStart {
    /// Returns the initial displacements and velocities of all nodes of an elastic body.
    pub(super) fn lower(
        &self,
        geometry: &Geometry,
        place: &Pointer<'_>,
        lowering: &mut Lowering,
    ) -> (Vec<f64>, Vec<f64>) {
        let mut of = |given: &Option<Vec<Expression>>, key: &str| {
            let mut values = vec![0.0; geometry.grid.nodes() * geometry.components];
            let place = place.key(key);
            for (c, component) in geometry.components_of(given.as_deref(), &place, lowering).iter().enumerate() {
                let place = place.index(c);
                let mut field = Field::read(component, &geometry.grid, &place, lowering);
                for node in 0..geometry.grid.nodes() {
                    values[node * geometry.components + c] = field.value(geometry.grid.coordinates(node), lowering);
                }
            }
            values
        };
        (of(&self.displacement, "displacement"), of(&self.velocity, "velocity"))
    }
}

impl Geometry {
    /// Returns the given components of a vector if there are as many as displacement components per node, and none
    /// otherwise.
    pub(super) fn components_of<'e>(
        &self,
        given: Option<&'e [Expression]>,
        place: &Pointer<'_>,
        lowering: &mut Lowering,
    ) -> &'e [Expression] {
        match given {
            Some(given) if given.len() == self.components => given,
            Some(given) => {
                let error = SpecificationError::new(
                    place.to_string(),
                    "wrong_shape",
                    format!("{} components are given, and the body has {}", given.len(), self.components),
                );
                lowering.errors.push(error.expected(format!("{} components", self.components)));
                &[]
            }
            None => &[],
        }
    }
}

impl ElasticProblem {
    /// Assembles the load on every displacement from body forces and tractions, by nodal quadrature.
    pub(super) fn loads(&self, geometry: &Geometry, place: &Pointer<'_>, lowering: &mut Lowering) -> Vec<Node> {
        let grid = &geometry.grid;
        let zero = lowering.graph.constant(0.0);
        let mut loads = vec![zero; grid.nodes() * geometry.components];
        let at = place.key("force");
        let force = geometry.components_of(self.force.as_deref(), &at, lowering);
        if !force.is_empty() {
            let share = Element::of(grid, Quadrature::Nodal).volume() / (1_u32 << grid.dimension()) as f64;
            let mut shares = vec![0.0; grid.nodes()];
            (0..grid.elements()).flat_map(|e| grid.corners(e)).for_each(|node| shares[node] += share);
            add(force, &shares, geometry, &at, &mut loads, lowering);
        }
        let at = place.key("traction");
        for (name, traction) in self.traction.iter() {
            let at = at.key(name);
            let Some(side) = geometry.side(name, &at, lowering) else { continue };
            let traction = geometry.components_of(Some(traction), &at, lowering);
            let mut shares = vec![0.0; grid.nodes()];
            for face in grid.faces_on(side) {
                let share = grid.face_area(side) / face.nodes.len() as f64;
                face.nodes.iter().for_each(|&node| shares[node] += share);
            }
            add(traction, &shares, geometry, &at, &mut loads, lowering);
        }
        loads
    }
}

/// Adds a force density to the loads on the nodes; `shares` is the volume or area that belongs to each node.
fn add(
    density: &[Expression],
    shares: &[f64],
    geometry: &Geometry,
    place: &Pointer<'_>,
    loads: &mut [Node],
    lowering: &mut Lowering,
) {
    for (c, component) in density.iter().enumerate() {
        let place = place.index(c);
        let mut field = Field::read(component, &geometry.grid, &place, lowering);
        for (node, &share) in shares.iter().enumerate().filter(|(_, share)| **share > 0.0) {
            let value = field.at(geometry.grid.coordinates(node), lowering);
            let share = lowering.graph.constant(share);
            let force = lowering.graph.multiply(share, value);
            let load = &mut loads[node * geometry.components + c];
            *load = lowering.graph.add(*load, force);
        }
    }
}
