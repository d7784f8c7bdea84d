//! The set `K`: blocks that share out the variables among them.

use super::error::SpecificationError;
use super::expression::Expression;
use super::lowering::Lowering;
use super::place::Place;
use super::wording::{abridged, listed};
use crate::expression::Node;
use crate::expression::nearest;
use crate::problem::{ConvexSet, MovingBound, Side};
use serde::Deserialize;
use std::collections::HashMap;
use utoipa::ToSchema;

/// One factor of `K`. Every variable stands in exactly one block.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Block {
    /// No bounds: `G = 0` for these variables.
    Free(Vec<String>),
    /// `z >= 0`, hence `0 <= z`, `0 <= G`, and one of them zero.
    Nonnegative(Vec<String>),
    /// `z <= 0`.
    Nonpositive(Vec<String>),
    /// `lower <= z <= upper`.
    Box(BoxBlock),
}

/// Variables between bounds.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxBlock {
    /// The variables.
    pub of: Vec<String>,
    /// The lower bound of each, in `t` and the states; null for none.
    pub lower: Option<Expression>,
    /// The upper bound of each, in `t` and the states; null for none.
    pub upper: Option<Expression>,
}

/// `K`, its moving bounds, and where each of those was written.
#[derive(Debug)]
pub(super) struct LoweredSet {
    pub set: ConvexSet,
    pub moving: Vec<(MovingBound, Node)>,
    pub moving_pointers: Vec<String>,
}

impl Block {
    fn key(&self) -> &'static str {
        match self {
            Block::Free(_) => "free",
            Block::Nonnegative(_) => "nonnegative",
            Block::Nonpositive(_) => "nonpositive",
            Block::Box(_) => "box",
        }
    }

    fn variables(&self) -> &[String] {
        match self {
            Block::Free(names) | Block::Nonnegative(names) | Block::Nonpositive(names) => names,
            Block::Box(block) => &block.of,
        }
    }
}

/// Lowers the blocks of a problem with `n` states; `pointer` says where a variable is declared.
pub(super) fn lower(
    blocks: Option<&[Block]>,
    states: usize,
    variables: &[String],
    problem: &Place<'_>,
    pointer: impl Fn(usize) -> String,
    lowering: &mut Lowering,
) -> LoweredSet {
    let m = variables.len();
    let mut lowered = LoweredSet { set: ConvexSet::free(m), moving: Vec::new(), moving_pointers: Vec::new() };
    let Some(blocks) = blocks else {
        if m > 0 {
            let detail = "`set` is missing: it says where the variables may lie";
            lowering.errors.push(
                SpecificationError::new(problem.to_string(), "missing_key", detail)
                    .expected(format!("`set`, with a block for {}", listed(variables.iter().map(String::as_str)))),
            );
        }
        return lowered;
    };
    let positions: HashMap<&str, usize> = variables.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect();
    let mut home: Vec<Option<String>> = vec![None; m];
    let set = problem.key("set");
    for (k, block) in blocks.iter().enumerate() {
        let place = set.index(k);
        let inner = place.key(block.key());
        let names = if matches!(block, Block::Box(_)) { inner.key("of") } else { inner };
        let mut members = Vec::new();
        for (j, name) in block.variables().iter().enumerate() {
            let place = names.index(j);
            match positions.get(name.as_str()) {
                None => lowering.errors.push_with(|| unknown_variable(name, variables, &place)),
                Some(&i) => match &home[i] {
                    Some(first) => {
                        let detail = format!("`{name}` stands in a block already, at {first}");
                        lowering.errors.push(
                            SpecificationError::new(place.to_string(), "variable_in_two_blocks", detail)
                                .expected("every variable in exactly one block"),
                        );
                    }
                    None => {
                        home[i] = Some(place.to_string());
                        members.push(i);
                    }
                },
            }
        }
        match block {
            Block::Free(_) => {}
            Block::Nonnegative(_) => members.iter().for_each(|&i| lowered.set.lower[i] = 0.0),
            Block::Nonpositive(_) => members.iter().for_each(|&i| lowered.set.upper[i] = 0.0),
            Block::Box(block) => lowered.bound(block, &members, states, &inner, lowering),
        }
    }
    for (i, name) in variables.iter().enumerate().filter(|&(i, _)| home[i].is_none()) {
        let detail = format!("`{name}` stands in no block of `set`");
        lowering.errors.push(
            SpecificationError::new(pointer(i), "variable_without_block", detail)
                .expected("every variable in exactly one block"),
        );
    }
    lowered
}

impl LoweredSet {
    fn bound(
        &mut self,
        block: &BoxBlock,
        members: &[usize],
        states: usize,
        place: &Place<'_>,
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
                match lowering.graph.value(node) {
                    Some(value) if side == Side::Lower => self.set.lower[variable] = value,
                    Some(value) => self.set.upper[variable] = value,
                    None => {
                        self.moving.push((MovingBound { variable, side }, node));
                        self.moving_pointers.push(place.key(key).to_string());
                    }
                }
            }
        }
    }
}

/// A bound, in `t` and the states alone; a constant one is finite.
fn bound_node(bound: &Expression, states: usize, place: &Place<'_>, lowering: &mut Lowering) -> Option<Node> {
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

fn unknown_variable(name: &str, variables: &[String], place: &Place<'_>) -> SpecificationError {
    let names = || variables.iter().map(String::as_str);
    SpecificationError::new(place.to_string(), "unknown_name", format!("`{}` is not a variable", abridged(name)))
        .expected(listed(names()))
        .did_you_mean(nearest(name, names()))
}
