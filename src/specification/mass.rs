//! The mass matrix `M` of `M x' = F(t,x,z)`.

use super::lowering::Lowering;
use super::matrix::Matrix;
use super::place::Place;
use problem::Mass;

/// Lowers the mass matrix of a problem with `n` states; an identity that is written out is still an identity.
pub(super) fn lower(mass: Option<&Matrix>, n: usize, problem: &Place<'_>, lowering: &mut Lowering) -> Mass {
    let Some(mass) = mass else { return Mass::Identity };
    let entries = mass.entries((n, n), &problem.key("mass"), lowering);
    let identity = entries.len() == n && entries.iter().all(|&(i, j, value)| i == j && value == 1.0);
    if identity { Mass::Identity } else { Mass::Constant(entries) }
}
