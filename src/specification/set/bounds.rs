//! Bounds of variables, which may vary with `t` and the states.

use super::{BoxBlock, LoweredSet};
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use expression::Node;
use problem::{MovingBound, Side};

impl LoweredSet {
    pub(super) fn bound(
        &mut self,
        block: &BoxBlock,
        members: &[usize],
        states: usize,
        place: &Pointer<'_>,
        lowering: &mut Lowering,
    ) {
        let lower = block.lower.as_ref().and_then(|bound| bound_node(bound, states, &place.key("lower"), lowering));
        let upper = block.upper.as_ref().and_then(|bound| bound_node(bound, states, &place.key("upper"), lowering));
        let constant = |node: Option<Node>, lowering: &Lowering| node.and_then(|node| lowering.graph.value(node));
        if let (Some(lower), Some(upper)) = (constant(lower, lowering), constant(upper, lowering))
            && lower > upper
        {
            let detail = format!("the lower bound {lower} is above the upper bound {upper}");
            lowering.errors.report(place, "empty_interval", detail);
        }
        for (node, side, key) in [(lower, Side::Lower, "lower"), (upper, Side::Upper, "upper")] {
            let Some(node) = node else { continue };
            for &variable in members {
                self.set_bound(MovingBound { variable, side }, node, &place.key(key), lowering);
            }
        }
    }

    /// Sets a constant bound, or registers a moving bound, one that varies with `t` or the states.
    pub(super) fn set_bound(&mut self, bound: MovingBound, node: Node, place: &Pointer<'_>, lowering: &Lowering) {
        match lowering.graph.value(node) {
            Some(value) => {
                bound.place(value, &mut self.set);
                if lowering.graph.number(node).is_none() {
                    self.parametric.push((bound, node));
                }
            }
            None => {
                self.moving.push((bound, node));
                self.moving_pointers.push(place.to_string());
            }
        }
    }
}

/// Parses a bound of a variable, an expression in `t` and the states alone, to a graph node; a constant bound must be
/// finite.
pub(super) fn bound_node(
    bound: &Expression,
    states: usize,
    place: &Pointer<'_>,
    lowering: &mut Lowering,
) -> Option<Node> {
    let node = lowering.node(bound, place)?;
    if lowering.graph.inputs(node).into_iter().any(|input| input > states) {
        let detail = "a bound may depend on `t` and the states, not on the variables";
        lowering.errors.report(place, "bound_depends_on_variable", detail);
        return None;
    }
    if lowering.graph.value(node).is_some_and(|value| !value.is_finite()) {
        let error = SpecificationError::new(place.to_string(), "not_finite", "this bound is not finite");
        lowering.errors.push(error.expected("a finite bound, or null for none"));
        return None;
    }
    Some(node)
}
