//! Settings, statistics and errors of the time integration of an obstacle problem.

use super::ObstacleDataError;

/// The settings of a run.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// The tolerance for the root mean square error of a step over the domain, relative to the largest `|u|`.
    pub rtol: f64,
    /// The absolute tolerance, added to the relative one, in the unit of `u`.
    pub atol: f64,
    /// The fixed step size; `None` for adaptive steps.
    pub step: Option<f64>,
    /// The first step to try.
    pub first_step: Option<f64>,
    /// The longest step.
    pub max_step: f64,
    /// The minimum step size; the run fails below it.
    pub min_step: f64,
    /// The tolerance for the natural-map residual of a stage, relative to the largest `|u|`.
    pub vi_tolerance: f64,
}

/// Why a step failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ObstacleError {
    /// Data of the problem are invalid.
    #[error("{0}")]
    ObstacleDataError(ObstacleDataError),
    /// The step size fell to the rounding level of `t`, or below the minimum.
    #[error("the step size fell to {h:e} at t = {t:?}: {why}")]
    StepTooSmall {
        /// The time.
        t: f64,
        /// The step size.
        h: f64,
        /// The reason for the last rejection.
        why: &'static str,
    },
    /// The variational inequality of a stage was not solved, with a fixed step size.
    #[error("the inequality at a stage was not solved at t = {t:?}, step {h:e}: {why}")]
    Unsolved {
        /// The time.
        t: f64,
        /// The step size.
        h: f64,
        /// The reason.
        why: &'static str,
    },
    /// The factors of the matrix do not fit into memory.
    #[error("the factors of a matrix of {nodes} nodes do not fit into memory")]
    Memory {
        /// The number of rows of the matrix.
        nodes: usize,
    },
    /// The run was interrupted through [`Control`](problem::Control).
    #[error("stopped at t = {t:?}")]
    Interrupted {
        /// The time.
        t: f64,
    },
}

impl ObstacleError {
    /// A stable error code for programs.
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

/// Statistics of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    /// Accepted steps.
    pub accepted: u64,
    /// Steps rejected because their error was too large.
    pub inaccurate: u64,
    /// Steps rejected because a variational inequality was not solved.
    pub unsolved: u64,
    /// Evaluations of `f` and `K`.
    pub vectors: u64,
    /// Evaluations of `A`.
    pub operators: u64,
    /// Matrices `M + d h A` set up.
    pub matrices: u64,
    /// Variational inequalities solved.
    pub solves: u64,
    /// Active sets tried, over all solves.
    pub passes: u64,
    /// Fixed steps with hidden motion of nodes between the stages above tolerance.
    pub unproven: u64,
    /// Sum of the estimated errors of steps of a given size, relative to the largest `|u|`.
    pub given_steps: f64,
    /// The largest natural-map residual, with rows divided by their diagonal entry, relative to the largest `|u|`.
    pub residual: f64,
}
