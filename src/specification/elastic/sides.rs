//! Sides of an elastic body by name.

use super::ElasticProblem;
use super::body::Geometry;
use crate::error::SpecificationError;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use crate::wording::{abridged, listed};
use expression::nearest;
use models::finite_elements::Side;

impl Geometry {
    /// Finds the side of an elastic body by its name; reports an unknown name.
    pub(super) fn side(&self, name: &str, place: &Pointer<'_>, lowering: &mut Lowering) -> Option<Side> {
        let found = Side::all(self.grid.dimension()).find(|side| side.name() == name);
        if found.is_none() {
            let names = || Side::all(self.grid.dimension()).map(Side::name);
            unknown(name, names().collect(), place, lowering);
        }
        found
    }
}

/// Reports an unknown name of a side of an elastic body.
pub(super) fn unknown(name: &str, names: Vec<&str>, place: &Pointer<'_>, lowering: &mut Lowering) {
    let detail = format!("`{}` is not a side of this body", abridged(name));
    let error = SpecificationError::new(place.to_string(), "unknown_name", detail);
    let near = nearest(name, names.iter().copied());
    lowering.errors.push(error.expected(listed(names.iter().copied())).did_you_mean(near));
}

impl ElasticProblem {
    /// Returns for each nodal displacement of an elastic body whether it is clamped.
    pub(super) fn clamped(&self, geometry: &Geometry, place: &Pointer<'_>, lowering: &mut Lowering) -> Vec<bool> {
        let place = place.key("clamped");
        let components = geometry.components;
        let mut clamped = vec![false; geometry.grid.nodes() * components];
        for (k, name) in self.clamped.iter().enumerate() {
            let place = place.index(k);
            if self.clamped[..k].contains(name) {
                let detail = format!("`{}` is clamped already", abridged(name));
                lowering.errors.report(&place, "duplicate_name", detail);
            } else if let Some(side) = geometry.side(name, &place, lowering) {
                let nodes = geometry.grid.nodes_on(side);
                nodes.for_each(|node| clamped[node * components..(node + 1) * components].fill(true));
            }
        }
        clamped
    }
}
