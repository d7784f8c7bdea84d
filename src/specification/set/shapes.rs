//! Blocks that couple their variables: balls, second-order cones, simplices, polyhedra.

use super::bounds::bound_node;
use super::{BallBlock, LoweredSet, PolyhedronBlock};
use crate::error::SpecificationError;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use problem::{MovingBound, Polyhedron, Shape, Side};

/// Largest number of variables of one block of the set `K`: projections onto a block are dense.
const MOST_MEMBERS: usize = 1_000;

/// Largest number of entries of the matrix of inequalities of one polyhedron.
const MOST_ENTRIES: usize = 100_000;

impl LoweredSet {
    pub(super) fn ball(
        &mut self,
        block: &BallBlock,
        members: Vec<usize>,
        states: usize,
        place: &Pointer<'_>,
        lowering: &mut Lowering,
    ) {
        let at = place.key("radius");
        let radius = bound_node(&block.radius, states, &at, lowering);
        if let Some(value) = radius.and_then(|node| lowering.graph.value(node)).filter(|value| *value < 0.0) {
            let error = SpecificationError::new(at.to_string(), "negative_radius", format!("the radius is {value}"));
            lowering.errors.push(error.expected("a radius that is not negative"));
            return;
        }
        if is_size_right(members.len(), 1, &place.key("of"), lowering) {
            let variable = members[0];
            self.set.bind(members, Shape::Ball { radius: 0.0 });
            if let Some(node) = radius {
                self.set_bound(MovingBound { variable, side: Side::Radius }, node, &at, lowering);
            }
        }
    }

    pub(super) fn second_order_cone(&mut self, members: Vec<usize>, place: &Pointer<'_>, lowering: &mut Lowering) {
        if is_size_right(members.len(), 2, place, lowering) {
            self.set.bind(members, Shape::SecondOrderCone);
        }
    }

    pub(super) fn simplex(&mut self, members: Vec<usize>, place: &Pointer<'_>, lowering: &mut Lowering) {
        if is_size_right(members.len(), 1, place, lowering) {
            self.set.bind(members, Shape::Simplex);
        }
    }

    pub(super) fn polyhedron(
        &mut self,
        block: &PolyhedronBlock,
        members: Vec<usize>,
        place: &Pointer<'_>,
        lowering: &mut Lowering,
    ) {
        let (rows, columns) = (block.b.len(), block.of.len());
        if !is_size_right(columns, 1, &place.key("of"), lowering) {
            return;
        }
        if rows.saturating_mul(columns) > MOST_ENTRIES {
            let detail = format!("{rows} inequalities in {columns} variables");
            let error = SpecificationError::new(place.key("A").to_string(), "too_large", detail);
            lowering.errors.push(error.expected(format!("at most {MOST_ENTRIES} entries")));
            return;
        }
        let mut a = vec![0.0; rows * columns];
        for (i, j, value) in block.A.entries((rows, columns), &place.key("A"), lowering) {
            if i < rows && j < columns {
                a[i * columns + j] = value;
            }
        }
        let at = place.key("b");
        let b = block.b.iter().enumerate();
        let b: Vec<f64> = b.map(|(i, b)| lowering.constant(b, &at.index(i)).unwrap_or(0.0)).collect();
        if !lowering.errors.is_empty() {
            return;
        }
        match Polyhedron::new(columns, &a, &b) {
            Some(polyhedron) => self.set.bind(members, Shape::Polyhedron(polyhedron)),
            None => {
                let detail = "no point satisfies A z <= b";
                let error = SpecificationError::new(place.to_string(), "empty_set", detail);
                lowering.errors.push(error.expected("inequalities that some point satisfies"));
            }
        }
    }
}

/// Reports a block of the set `K` with too few or too many variables; returns whether the number of its variables is
/// right.
fn is_size_right(members: usize, least: usize, place: &Pointer<'_>, lowering: &mut Lowering) -> bool {
    let right = (least..=MOST_MEMBERS).contains(&members);
    if !right {
        let code = if members < least { "too_few_members" } else { "too_many_members" };
        lowering.errors.push_with(|| {
            SpecificationError::new(place.to_string(), code, format!("this block has {members} variables"))
                .expected(format!("{least} to {MOST_MEMBERS} variables"))
        });
    }
    right
}
