//! Estimates of the memory of a run that are known beforehand: those of its matrices. The fill-in of sparse factors
//! becomes known only during the run.

use super::layout::is_sparse;
use super::settings::StepError;
use problem::Structure;

/// Maximum memory of one group of dense matrices of a run, in bytes.
pub const MOST_BYTES: usize = 2 << 30;

/// Maximum number of matrices in one group of dense matrices: the Jacobian and a real and a complex matrix of
/// Newton's method; or the matrix of the inequalities of all stages and up to three more of its size in a solver.
const MATRICES: usize = 4;

/// Storage per entry of the pattern of derivatives, in units of `f64`, measured: its row and column several times
/// over, and in a sparse matrix its values in the factors, without fill-in.
const OF_DENSE_ENTRY: usize = 12;
const OF_SPARSE_ENTRY: usize = 28;

/// Storage per unknown, in units of `f64`, measured: stages, predictions, interpolants and scales.
const OF_UNKNOWN: usize = 160;

/// Number of dense matrices of Newton's method: the Jacobian, and one real and several complex factors for the numbers
/// of stages in use.
const OF_NEWTON: usize = 6;

/// Number of matrices of the size of the inequalities of all stages, measured: the matrix of these inequalities, and
/// none to three of its size in the solver.
const OF_STAGES: usize = 2;

/// Rejects a group of dense matrices with `unknowns` rows each if they exceed the memory limit.
///
/// # Errors
/// [`StepError::TooLarge`].
pub fn check_memory(what: &'static str, unknowns: usize) -> Result<(), StepError> {
    let fits = dense(unknowns) <= MOST_BYTES / size_of::<f64>();
    if fits { Ok(()) } else { Err(StepError::TooLarge { what, unknowns }) }
}

/// Returns the storage of a run with `stages` stages, in units of `f64`: its matrices, and the parts proportional to
/// the numbers of unknowns and of entries in the pattern of derivatives.
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
