//! The set `K`, a product of blocks that partition the variables.

mod bounds;
mod shapes;

use super::error::SpecificationError;
use super::expression::Expression;
use super::lowering::Lowering;
use super::matrix::Matrix;
use super::pointer::Pointer;
use super::wording::{abridged, listed};
use expression::Node;
use expression::nearest;
use problem::{ConvexSet, MovingBound};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use utoipa::ToSchema;

/// One factor of the set `K` of the variables. Every variable belongs to exactly one block.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Block {
    /// No bounds on the variables: the inequality becomes the equation `G = 0`.
    Free(Vec<String>),
    /// Complementarity of the variables `z` and the functions `G`: `z >= 0`, `G >= 0`, `z G = 0`.
    Nonnegative(Vec<String>),
    /// Complementarity with reversed signs: `z <= 0`, `G <= 0`, `z G = 0`.
    Nonpositive(Vec<String>),
    /// Interval bounds of the variables `z`: `lower <= z <= upper`.
    Box(BoxBlock),
    /// Euclidean ball of the variables `z`: `|z| <= radius`.
    Ball(BallBlock),
    /// Second-order cone: the first variable is at least the Euclidean norm of the others; two or more variables.
    SecondOrderCone(Vec<String>),
    /// Simplex: all variables nonnegative, with sum one.
    Simplex(Vec<String>),
    /// Polyhedron of the variables `z`: `A z <= b`.
    Polyhedron(PolyhedronBlock),
}

/// A block of variables between bounds.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxBlock {
    /// The names of the variables between the bounds.
    pub of: Vec<String>,
    /// Lower bound of each variable, an expression in `t` and the states; null for none.
    pub lower: Option<Expression>,
    /// Upper bound of each variable, an expression in `t` and the states; null for none.
    pub upper: Option<Expression>,
}

/// A block of variables in a Euclidean ball.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BallBlock {
    /// The names of the variables in the ball.
    pub of: Vec<String>,
    /// Radius of the ball, an expression in `t` and the states; not negative.
    pub radius: Expression,
}

/// A block of variables in a polyhedron.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[expect(non_snake_case, reason = "the matrix goes by the name that it has in the formula")]
pub struct PolyhedronBlock {
    /// The names of the variables in the polyhedron.
    pub of: Vec<String>,
    /// The constant matrix `A`, with a row per inequality and a column per variable.
    pub A: Matrix,
    /// The constant right-hand side `b`, with an entry per inequality.
    pub b: Vec<Expression>,
}

/// The set `K`; its moving bounds, which vary with `t` or the states, with their JSON pointers; and its constant
/// bounds that depend on parameters.
#[derive(Debug)]
pub(super) struct LoweredSet {
    pub set: ConvexSet,
    pub moving: Vec<(MovingBound, Node)>,
    pub moving_pointers: Vec<String>,
    /// The constant bounds of the set that depend on parameters, with their graph nodes.
    pub parametric: Vec<(MovingBound, Node)>,
}

impl Block {
    fn key(&self) -> &'static str {
        match self {
            Block::Free(_) => "free",
            Block::Nonnegative(_) => "nonnegative",
            Block::Nonpositive(_) => "nonpositive",
            Block::Box(_) => "box",
            Block::Ball(_) => "ball",
            Block::SecondOrderCone(_) => "second_order_cone",
            Block::Simplex(_) => "simplex",
            Block::Polyhedron(_) => "polyhedron",
        }
    }

    fn variables(&self) -> &[String] {
        match self {
            Block::Free(names) | Block::Nonnegative(names) | Block::Nonpositive(names) => names,
            Block::SecondOrderCone(names) | Block::Simplex(names) => names,
            Block::Box(block) => &block.of,
            Block::Ball(block) => &block.of,
            Block::Polyhedron(block) => &block.of,
        }
    }

    /// Returns the JSON pointer to the list of the names of the variables in the block.
    fn names<'a>(&self, place: &'a Pointer<'a>) -> Pointer<'a> {
        match self {
            Block::Box(_) | Block::Ball(_) | Block::Polyhedron(_) => place.key("of"),
            _ => *place,
        }
    }
}

/// Builds the set `K` from its blocks, for a problem with `states` states; `pointer` returns the JSON pointer at
/// which a variable is declared.
pub(super) fn lower(
    blocks: Option<&[Block]>,
    states: usize,
    variables: &[String],
    problem: &Pointer<'_>,
    pointer: impl Fn(usize) -> String,
    lowering: &mut Lowering,
) -> LoweredSet {
    let m = variables.len();
    let mut lowered =
        LoweredSet { set: ConvexSet::free(m), moving: Vec::new(), moving_pointers: Vec::new(), parametric: Vec::new() };
    let Some(blocks) = blocks else {
        if m > 0 {
            let detail = "`set` is missing: it gives the admissible values of the variables";
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
        let names = block.names(&inner);
        let mut members = Vec::new();
        for (j, name) in block.variables().iter().enumerate() {
            let place = names.index(j);
            match positions.get(name.as_str()) {
                None => lowering.errors.push_with(|| unknown_variable(name, variables, &place)),
                Some(&i) => match &home[i] {
                    Some(first) => {
                        let detail = format!("`{name}` is in a block already, at {first}");
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
            Block::Ball(block) => lowered.ball(block, members, states, &inner, lowering),
            Block::SecondOrderCone(_) => lowered.second_order_cone(members, &inner, lowering),
            Block::Simplex(_) => lowered.simplex(members, &inner, lowering),
            Block::Polyhedron(block) => lowered.polyhedron(block, members, &inner, lowering),
        }
    }
    for (i, name) in variables.iter().enumerate().filter(|&(i, _)| home[i].is_none()) {
        let detail = format!("`{name}` is in no block of `set`");
        lowering.errors.push(
            SpecificationError::new(pointer(i), "variable_without_block", detail)
                .expected("every variable in exactly one block"),
        );
    }
    lowered
}

fn unknown_variable(name: &str, variables: &[String], place: &Pointer<'_>) -> SpecificationError {
    let names = || variables.iter().map(String::as_str);
    SpecificationError::new(place.to_string(), "unknown_name", format!("`{}` is not a variable", abridged(name)))
        .expected(listed(names()))
        .did_you_mean(nearest(name, names()))
}
