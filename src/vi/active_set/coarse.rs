//! Guesses of the active set from the problem on coarser grids (Kornhuber 1994, *Monotone multigrid methods for
//! elliptic variational inequalities*, uses these grids for the whole solution): each grid is solved from the active
//! set of the next coarser grid, which is wrong by about one node along its boundary.

use super::cyclic_reduction::CyclicReduction;
use super::grid::{Coarser, Interpolation};
use super::operator::Operator;
use super::{COARSE_PASSES, Level, Unsuitable};
use problem::{Control, ConvexSet};
use std::sync::Arc;

/// Tridiagonal matrices with at most this number of rows are not coarsened further.
const SMALL: usize = 32;

/// Number of Gauss-Seidel sweeps after the interpolation to a finer grid; they remove errors that extend over a few
/// nodes.
const SWEEPS: usize = 4;

/// The problem on a coarser grid, with its transfer from the next finer one.
pub(super) struct Coarse {
    transfer: Transfer,
    level: Level,
    q: Vec<f64>,
    set: ConvexSet,
    z: Vec<f64>,
}

enum Transfer {
    Elimination(CyclicReduction),
    Interpolation(Arc<Interpolation>),
}

impl Coarse {
    fn new(transfer: Transfer, operator: Operator) -> Self {
        let n = operator.len();
        Self { transfer, level: Level::new(operator), q: vec![0.0; n], set: ConvexSet::free(n), z: vec![0.0; n] }
    }

    fn restrict(&mut self, q: &[f64], set: &ConvexSet) {
        match &self.transfer {
            Transfer::Elimination(transfer) => transfer.restrict(q, &mut self.q),
            Transfer::Interpolation(transfer) => transfer.restrict(q, &mut self.q),
        }
        for (node, (lower, upper)) in self.set.lower.iter_mut().zip(&mut self.set.upper).enumerate() {
            let fine = match &self.transfer {
                Transfer::Elimination(_) => 2 * node,
                Transfer::Interpolation(transfer) => transfer.nodes[node],
            };
            (*lower, *upper) = (set.lower[fine], set.upper[fine]);
        }
    }

    fn solve(&mut self, control: &Control) {
        self.level.iterate(&self.q, &self.set, &mut self.z, COARSE_PASSES, &mut 0, control);
    }

    /// Guesses the active set of the problem on the next finer grid from that on this grid; overwrites `z` of the finer
    /// problem if the transfer between the grids is an interpolation.
    fn guess(&self, fine: &mut Level, q: &[f64], set: &ConvexSet, z: &mut [f64]) {
        match (&self.transfer, &fine.operator) {
            (Transfer::Elimination(transfer), Operator::Tridiagonal(matrix)) => {
                transfer.guess(matrix, q, set, (&self.z, &self.level.face), &mut fine.face);
            }
            (Transfer::Interpolation(transfer), Operator::Sparse(matrix)) => {
                transfer.interpolate(&self.z, z);
                z.iter_mut().enumerate().for_each(|(i, z)| *z = set.project(i, *z));
                matrix.apply(q, z, &mut fine.w, &mut fine.terms);
                for sweep in 0..SWEEPS {
                    matrix.relax(set, z, &mut fine.w, sweep % 2 == 0);
                }
                fine.guess(set, z);
            }
            _ => {}
        }
    }
}

/// Coarsens a tridiagonal matrix by repeated elimination of every other node.
pub(super) fn by_elimination(finest: &Operator) -> Vec<Coarse> {
    let mut coarser = Vec::new();
    let Operator::Tridiagonal(finest) = finest else { return coarser };
    let mut fine = finest.clone();
    while fine.diagonal.len() > SMALL {
        let (transfer, coarse) = CyclicReduction::new(&fine);
        coarser.push(Coarse::new(Transfer::Elimination(transfer), Operator::Tridiagonal(coarse.clone())));
        fine = coarse;
    }
    coarser
}

/// Prepares the problems on all coarser grids of a hierarchy, each with the grids below it.
pub(super) fn by_interpolation(grids: &[Coarser], control: &Control) -> Result<Vec<Coarse>, Unsuitable> {
    let mut coarser = Vec::with_capacity(grids.len());
    for (k, Coarser { transfer, matrix, .. }) in grids.iter().enumerate() {
        let operator = match Operator::tridiagonal(matrix)? {
            Some(operator) => operator,
            None => Operator::sparse(matrix, &grids[k + 1..], control)?,
        };
        coarser.push(Coarse::new(Transfer::Interpolation(Arc::clone(transfer)), operator));
    }
    Ok(coarser)
}

/// Guesses the active set of the finest problem, solving from the coarsest grid up.
pub(super) fn guess(
    coarser: &mut [Coarse],
    finest: &mut Level,
    q: &[f64],
    set: &ConvexSet,
    z: &mut [f64],
    control: &Control,
) {
    for k in 0..coarser.len() {
        let (finer, rest) = coarser.split_at_mut(k);
        match finer.last() {
            Some(fine) => rest[0].restrict(&fine.q, &fine.set),
            None => rest[0].restrict(q, set),
        }
    }
    for k in (0..coarser.len()).rev() {
        let (finer, rest) = coarser.split_at_mut(k);
        rest[0].solve(control);
        match finer.last_mut() {
            Some(fine) => rest[0].guess(&mut fine.level, &fine.q, &fine.set, &mut fine.z),
            None => rest[0].guess(finest, q, set, z),
        }
    }
}
