//! The memory of a run, as far as it is known before it: its matrices. The fill of sparse factors turns out on the way.

use super::layout::is_sparse;
use super::settings::StepError;
use problem::Structure;

/// The most memory, in bytes, that one dense part of a run may take.
pub const MOST_BYTES: usize = 2 << 30;

/// The matrices of a part: the Jacobian, a real and a complex one of the Newton method; or, of the inequalities of all
/// stages, theirs and up to three of its size in a solver.
const MATRICES: usize = 4;

/// The numbers that finding the place of an entry of the pattern takes: its row and column, several times over.
const PLACING: usize = 12;

/// Refuses the dense matrices of a part, of `unknowns` rows, that would take more memory than it may.
///
/// # Errors
/// [`StepError::TooLarge`].
pub fn check_memory(what: &'static str, unknowns: usize) -> Result<(), StepError> {
    let fits = dense(unknowns) <= MOST_BYTES / size_of::<f64>();
    if fits { Ok(()) } else { Err(StepError::TooLarge { what, unknowns }) }
}

/// The numbers in the matrices of a run with so many stages.
pub fn matrix_numbers(structure: &Structure, stages: usize) -> usize {
    let (unknowns, entries) = (structure.unknowns(), structure.pattern.len());
    let newton = if is_sparse(unknowns, entries) { MATRICES * entries } else { dense(unknowns) };
    let bounded = (0..structure.variables).filter(|&k| !structure.set.is_free(k)).count();
    newton.saturating_add(PLACING * entries).saturating_add(dense(stages.saturating_mul(bounded)))
}

fn dense(unknowns: usize) -> usize {
    unknowns.saturating_mul(unknowns).saturating_mul(MATRICES)
}
