//! The mass matrix `M` of `M x' = F(t,x,z)`.

use super::lowering::Lowering;
use super::matrix::{Entries, Matrix};
use super::pointer::Pointer;
use expression::Node;
use problem::Mass;

/// Reads the mass matrix of a problem with `n` states. Returns it with row, column and graph node of each entry that
/// depends on parameters. An identity written out in numbers becomes `Mass::Identity`.
pub(super) fn lower(
    mass: Option<&Matrix>,
    n: usize,
    problem: &Pointer<'_>,
    lowering: &mut Lowering,
) -> (Mass, Vec<(usize, usize, Node)>) {
    let Some(mass) = mass else { return (Mass::Identity, Vec::new()) };
    let Entries { mut values, mut terms } = mass.parametric((n, n), &problem.key("mass"), lowering);
    // Drop zero entries of the mass matrix, even those that depend on parameters: its zero rows decide which equations
    // are algebraic.
    values.retain(|entry| entry.2 != 0.0);
    terms.retain(|&(.., node)| !lowering.graph.vanishes(node));
    let is_identity = values.len() == n && values.iter().all(|&(i, j, value)| i == j && value == 1.0);
    if is_identity && terms.is_empty() { (Mass::Identity, terms) } else { (Mass::Constant(values), terms) }
}
