//! Settings, statistics and errors of the time integration of an obstacle problem.

use super::ObstacleDataError;

/// The settings of the time integration of an obstacle problem.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// The tolerance for the root mean square error of a step over the domain, relative to the largest `|u|`.
    pub rtol: f64,
    /// The absolute error tolerance of a step, added to the relative tolerance, in the unit of `u`.
    pub atol: f64,
    /// The fixed step size of the time integration; `None` for adaptive steps.
    pub step: Option<f64>,
    /// The size of the first time step; `None` for a default.
    pub first_step: Option<f64>,
    /// The maximum size of a time step.
    pub max_step: f64,
    /// The minimum size of a time step, below which the run fails.
    pub min_step: f64,
    /// The tolerance for the natural-map residual of the variational inequality of a stage, relative to the largest
    /// `|u|`.
    pub vi_tolerance: f64,
}

/// Why the time integration of an obstacle problem failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ObstacleError {
    /// The data of the obstacle problem are invalid.
    #[error("{0}")]
    ObstacleDataError(ObstacleDataError),
    /// The step size fell to the rounding level of `t`, or below the minimum step size.
    #[error("the step size fell to {h:e} at t = {t:?}: {why}")]
    StepTooSmall {
        /// The time at the beginning of the rejected step.
        t: f64,
        /// The size of the rejected step, below the minimum.
        h: f64,
        /// The reason for which the last attempted step was rejected.
        why: &'static str,
    },
    /// The variational inequality of a stage was not solved, in a run with a fixed step size.
    #[error("the inequality at a stage was not solved at t = {t:?}, step {h:e}: {why}")]
    Unsolved {
        /// The time at the beginning of the step in which a stage was not solved.
        t: f64,
        /// The size of the step in which a stage was not solved.
        h: f64,
        /// The reason for which the variational inequality of the stage was not solved.
        why: &'static str,
    },
    /// The factors of the matrix of a stage do not fit into memory.
    #[error("the factors of a matrix of {nodes} nodes do not fit into memory")]
    Memory {
        /// The number of rows of the stage matrix, one per node.
        nodes: usize,
    },
    /// The time integration was interrupted through [`Control`](problem::Control).
    #[error("stopped at t = {t:?}")]
    Interrupted {
        /// The time that the run had reached when it was interrupted.
        t: f64,
    },
}

impl ObstacleError {
    /// Returns a machine-readable code of the error, which does not change between versions.
    pub fn code(&self) -> &'static str {
        match self {
            Self::ObstacleDataError(error) => error.code(),
            Self::StepTooSmall { .. } => "step_too_small",
            Self::Unsolved { .. } => "vi_unsolved",
            Self::Memory { .. } => "too_large",
            Self::Interrupted { .. } => "interrupted",
        }
    }
}

/// Statistics of the time integration of an obstacle problem.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    /// The number of accepted time steps.
    pub accepted: u64,
    /// The number of time steps rejected because their error was too large.
    pub inaccurate: u64,
    /// The number of time steps rejected because the variational inequality of a stage was not solved.
    pub unsolved: u64,
    /// The number of evaluations of the load vector `f` and the set `K`.
    pub vectors: u64,
    /// The number of evaluations of the operator matrix `A`.
    pub operators: u64,
    /// The number of stage matrices `M + d h A` that were set up, with the diagonal coefficient `d` of TR-BDF2 and the
    /// step size `h`.
    pub matrices: u64,
    /// The number of variational inequalities of stages that were solved.
    pub solves: u64,
    /// The number of active sets tried, over the variational inequalities of all stages.
    pub passes: u64,
    /// The number of fixed-size steps in which the hidden motion of nodes between the stages exceeds the tolerance.
    pub unproven: u64,
    /// The sum of the estimated errors of the steps in a run with a fixed step size, relative to the largest `|u|`.
    pub given_steps: f64,
    /// The largest natural-map residual of the variational inequality of a stage, with rows divided by their diagonal
    /// entry, relative to the largest `|u|`.
    pub residual: f64,
}
