//! The memory of a run, as far as it is known before it: its matrices. The fill of sparse factors turns out on the way.

use super::layout::is_sparse;
use super::settings::StepError;
use problem::Structure;

/// The most memory, in bytes, that one dense part of a run may take.
pub const MOST_BYTES: usize = 2 << 30;

/// The most matrices of a part: the Jacobian, a real and a complex one of the Newton method; or, of the inequalities of all
/// stages, theirs and up to three of its size in a solver.
const MATRICES: usize = 4;

/// The numbers that a run has of each entry of the pattern, measured: its row and column several times over, and where the
/// matrix is sparse its values in the factors, without fill.
const OF_DENSE_ENTRY: usize = 12;
const OF_SPARSE_ENTRY: usize = 28;

/// The numbers that a run has of each unknown, measured: stages, predictions, interpolants and scales.
const OF_UNKNOWN: usize = 160;

/// The dense matrices of the Newton method: the Jacobian, and one real and some complex factors for the stage numbers met.
const OF_NEWTON: usize = 6;

/// The matrices of the inequalities of all stages, measured: theirs, and none to three of its size by the solver that they need.
const OF_STAGES: usize = 2;

/// Refuses the dense matrices of a part, of `unknowns` rows, that would take more memory than it may.
///
/// # Errors
/// [`StepError::TooLarge`].
pub fn check_memory(what: &'static str, unknowns: usize) -> Result<(), StepError> {
    let fits = dense(unknowns) <= MOST_BYTES / size_of::<f64>();
    if fits { Ok(()) } else { Err(StepError::TooLarge { what, unknowns }) }
}

/// The numbers of a run with so many stages: its matrices, and what grows with unknowns and with entries of the pattern.
pub fn run_numbers(structure: &Structure, stages: usize) -> usize {
    let (unknowns, entries) = (structure.unknowns(), structure.pattern.len());
    let matrix = if is_sparse(unknowns, entries) {
        OF_SPARSE_ENTRY * entries
    } else {
        (OF_DENSE_ENTRY * entries).saturating_add(OF_NEWTON.saturating_mul(square(unknowns)))
    };
    let bounded = (0..structure.variables).filter(|&k| !structure.set.is_free(k)).count();
    let of_stages = OF_STAGES.saturating_mul(square(stages.saturating_mul(bounded)));
    matrix.saturating_add(OF_UNKNOWN * unknowns).saturating_add(of_stages)
}

fn square(n: usize) -> usize {
    n.saturating_mul(n)
}

fn dense(unknowns: usize) -> usize {
    unknowns.saturating_mul(unknowns).saturating_mul(MATRICES)
}
