//! The evidence that comes with a trajectory.

use serde::Serialize;

/// Accepted and rejected steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Steps {
    /// Steps that became part of the trajectory.
    pub accepted: u64,
    /// Steps done again, smaller.
    pub rejected: u64,
    /// Of those, because the error estimate was too large.
    pub rejected_error: u64,
    /// Of those, because Newton's method on the stages did not converge.
    pub rejected_newton: u64,
}

/// What was evaluated, and how often.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Evaluations {
    /// Evaluations of the rates and of `G`.
    pub rates: u64,
    /// Evaluations of their derivatives.
    pub jacobians: u64,
    /// Factorisations of a matrix.
    pub factorisations: u64,
}

/// The variational inequalities solved at stages.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ViCounts {
    /// The solver that answered last.
    pub solver: &'static str,
    /// Problems solved.
    pub solves: u64,
    /// Pivots and inner iterations in all.
    pub pivots: u64,
    /// The largest natural-map residual of an accepted step.
    pub largest_residual: f64,
}

/// The worst of `z`, `G` and their products over the accepted steps, scaled as stated by `numerics`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Complementarity {
    /// The least distance of a `z_i` into its interval; negative if it is outside.
    pub smallest_z: f64,
    /// The least of `G_i` signed so that it should not be negative.
    pub smallest_g: f64,
    /// The largest product of the two.
    pub largest_product: f64,
}

/// Something the user should know though the solve went on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Warning {
    /// A stable word for programs.
    pub code: &'static str,
    /// For people, with the remedy.
    pub message: String,
}

/// What was done, and how well.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Diagnostics {
    /// The method that ran.
    pub method: &'static str,
    /// Its number of stages.
    pub stages: usize,
    /// Steps taken.
    pub steps: Steps,
    /// Evaluations made.
    pub evaluations: Evaluations,
    /// Newton iterations on the stages.
    pub newton_iterations: u64,
    /// Variational inequalities solved; absent where there are no variables.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vi: Option<ViCounts>,
    /// Changes of the active face of `K`.
    pub switches: u64,
    /// Signs and products of `z` and `G`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub complementarity: Option<Complementarity>,
    /// The parts that were built.
    pub built: Vec<&'static str>,
    /// The parts that this problem did not need, each with the reason.
    pub left_out: Vec<String>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// Wall-clock time of the solve, in seconds.
    pub wall_seconds: f64,
}
