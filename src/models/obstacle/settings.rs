//! What may be chosen of the method, what was done, and why a step could not be made.

use super::ObstacleDataError;

/// The choices of a run.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// The error of a step, in the mean square over the domain, relative to the largest `|u|`.
    pub rtol: f64,
    /// What is added to it, in the unit of `u`.
    pub atol: f64,
    /// A fixed step; none is adaptive.
    pub step: Option<f64>,
    /// The first step to try.
    pub first_step: Option<f64>,
    /// The longest step.
    pub max_step: f64,
    /// The shortest step before the run fails.
    pub min_step: f64,
    /// The natural-map residual to reach at a stage, relative to the largest `|u|`.
    pub vi_tolerance: f64,
}

/// Why a step could not be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ObstacleError {
    /// The data are not what they should be.
    #[error("{0}")]
    ObstacleDataError(ObstacleDataError),
    /// The step size fell to the rounding level of `t`, or to the least allowed.
    #[error("the step size fell to {h:e} at t = {t:?}: {why}")]
    StepTooSmall {
        /// When.
        t: f64,
        /// The step size.
        h: f64,
        /// What the last rejection was for.
        why: &'static str,
    },
    /// The inequality of a stage was not solved where the step is fixed.
    #[error("the inequality at a stage was not solved at t = {t:?}, step {h:e}: {why}")]
    Unsolved {
        /// When.
        t: f64,
        /// The step size.
        h: f64,
        /// Why not.
        why: &'static str,
    },
    /// The factors of the matrix do not fit into memory.
    #[error("the factors of a matrix of {nodes} nodes do not fit into memory")]
    Memory {
        /// Its rows.
        nodes: usize,
    },
    /// The outside asked to stop.
    #[error("stopped at t = {t:?}")]
    Interrupted {
        /// When.
        t: f64,
    },
}

impl ObstacleError {
    /// A stable word for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::ObstacleDataError(offence) => offence.code(),
            Self::StepTooSmall { .. } => "step_too_small",
            Self::Unsolved { .. } => "vi_unsolved",
            Self::Memory { .. } => "too_large",
            Self::Interrupted { .. } => "interrupted",
        }
    }
}

/// What was done.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    /// Accepted steps.
    pub accepted: u64,
    /// Steps rejected for their error.
    pub inaccurate: u64,
    /// Steps rejected for an inequality that was not solved.
    pub unsolved: u64,
    /// Evaluations of `f` and `K`.
    pub vectors: u64,
    /// Evaluations of `A`.
    pub operators: u64,
    /// Matrices `M + d h A` set up.
    pub matrices: u64,
    /// Variational inequalities solved.
    pub solves: u64,
    /// Active sets tried for them.
    pub passes: u64,
    /// Fixed steps between whose stages nodes would have moved.
    pub unproven: u64,
    /// The largest natural-map residual, of rows divided by their diagonal, relative to the largest `|u|`.
    pub residual: f64,
}
