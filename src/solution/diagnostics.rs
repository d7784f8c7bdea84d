//! The evidence reported with a trajectory. Counts of parts that did not run are left out; counts that every run has
//! (rejected steps, switches) are written even if zero.

use super::{AdjointWork, Checks};
use analysis::{Analysis, Certificates};
use contact::energy::Energy;
use problem::Warning;
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// The analysis of the problem on one active face of `K`.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Face {
    /// Time at which the face first became active.
    pub t: f64,
    /// The variables inside their interval or block, whose `G` is zero; all others are at a bound.
    pub inside: Vec<String>,
    /// The variables on the boundary of a block, along which they can move.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub on_boundary: Vec<String>,
    /// Index and uniqueness on the face.
    #[serde(flatten)]
    #[schema(value_type = Object)]
    pub analysis: Analysis,
}

/// Accepted and rejected steps.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
pub struct Steps {
    /// Number of steps that became part of the trajectory.
    pub accepted: u64,
    /// Number of steps repeated with a smaller size.
    pub rejected: u64,
    /// Number of rejected steps, by reason.
    pub rejected_for: BTreeMap<&'static str, u64>,
}

/// Convergence factor of Newton's method: ratio of the norms of successive increments, where there was more than one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct Contraction {
    /// The mean factor.
    pub mean: f64,
    /// The largest factor.
    pub largest: f64,
}

/// An estimate of the global error, that of the states at the end.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct GlobalError {
    /// Error of each state, in its unit: the computed value minus the exact one.
    #[serde(serialize_with = "by_name")]
    #[schema(value_type = BTreeMap<String, f64>)]
    pub states: Vec<(String, f64)>,
    /// The largest error, in units of `atol + rtol |x|`.
    pub largest_scaled: f64,
    /// Number of accepted steps of the second run, which is the reference.
    pub reference_steps: u64,
}

/// The refinement of the mesh of a problem with memory: the uniform step was halved, or the tolerance of elements
/// between located switches divided by ten, until two runs agreed.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Refinement {
    /// How often the step was halved, or the tolerance divided by ten.
    pub halvings: u32,
    /// For each variable, the mean distance over time between the last run and the one before, at its steps, or half
    /// the previous distance if that is larger. It estimates the error of the last run but one, and so bounds that of
    /// the last.
    #[serde(serialize_with = "by_name")]
    #[schema(value_type = BTreeMap<String, f64>)]
    pub mean_distance: Vec<(String, f64)>,
    /// The largest mean distance, in units of `atol + rtol max |z|`; the target is 1.
    pub scaled: f64,
    /// The observed order: the base-two logarithm of the factor by which the distance last decreased.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub order: Option<f64>,
}

/// Steps screened for events between the stages, by interval enclosure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
pub struct Screening {
    /// Number of steps proven free of events.
    pub proven: u64,
    /// Number of steps for which neither is proven.
    pub undecided: u64,
    /// Number of steps in which the law is violated between the stages.
    pub missed: u64,
}

/// Numbers of evaluations; a count of zero is left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
pub struct Evaluations {
    /// Evaluations of the rates and of `G`.
    #[serde(skip_serializing_if = "is_zero")]
    pub rates: u64,
    /// Evaluations of the Jacobian of the rates and of `G`.
    #[serde(skip_serializing_if = "is_zero")]
    pub jacobians: u64,
    /// Factorisations of a matrix.
    #[serde(skip_serializing_if = "is_zero")]
    pub factorisations: u64,
}

/// A solver that failed on a variational inequality, after which the next one was tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct Tried {
    /// The name of the solver.
    pub solver: &'static str,
    /// The outcome.
    pub outcome: &'static str,
    /// Number of occurrences.
    pub times: u64,
}

/// The variational inequalities solved at the stages.
#[derive(Clone, Debug, Default, PartialEq, Serialize, ToSchema)]
pub struct ViCounts {
    /// The solver that succeeded last.
    pub solver: &'static str,
    /// Number of variational inequalities solved.
    pub solves: u64,
    /// Total number of pivots and inner iterations.
    pub pivots: u64,
    /// The largest natural-map residual of an accepted step.
    pub largest_residual: f64,
    /// The largest residual of the law of contact with a proximal term, which is solved where contacts are too many for the
    /// law itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_proximal_residual: Option<f64>,
    /// The solvers that failed before another succeeded.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tried: Vec<Tried>,
}

/// The work of a run, and the evidence for its accuracy.
#[derive(Clone, Debug, Default, Serialize, ToSchema)]
pub struct Diagnostics {
    /// Index and uniqueness at the start, with the reasons.
    #[serde(flatten)]
    #[schema(value_type = Object)]
    pub analysis: Option<Analysis>,
    /// Index and uniqueness on the first few active faces reached by switches.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub faces: Vec<Face>,
    /// The method that ran.
    pub method: &'static str,
    /// Number of stages; absent for methods not of Runge-Kutta type.
    #[serde(skip_serializing_if = "is_zero")]
    pub stages: usize,
    /// Numbers of steps.
    pub steps: Steps,
    /// Numbers of evaluations; absent for methods that do not count them.
    #[serde(skip_serializing_if = "is_zero")]
    pub evaluations: Evaluations,
    /// Newton iterations on the stage equations; absent for methods without them.
    #[serde(skip_serializing_if = "is_zero")]
    pub newton_iterations: u64,
    /// Rate of convergence of the Newton iterations; absent if one iteration always sufficed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub newton_contraction: Option<Contraction>,
    /// Variational inequalities solved; absent if there are no variables.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vi: Option<ViCounts>,
    /// Number of changes of the active face of `K`.
    pub switches: u64,
    /// Steps screened for events; absent if there are no variables.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub screening: Option<Screening>,
    /// Signs and products of `z` and `G`, and the differentiation lemmas; absent if no variable has a bound.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub complementarity: Option<Certificates>,
    /// Energy balance; absent for problems without an energy.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub energy: Option<Energy>,
    /// The sweep back for a gradient; present in adjoint mode.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub adjoint: Option<AdjointWork>,
    /// Estimated error of the final states; present on request.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub global_error: Option<GlobalError>,
    /// Measurements for the verdict: for each check code (`CheckCode`), the worst value of the run and the value up to
    /// which the answer is trusted. A check that was not made is absent.
    pub checks: Checks,
    /// Refinement of the mesh; present for a problem with memory without a given `step`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refinement: Option<Refinement>,
    /// The components that were built.
    pub built: Vec<&'static str>,
    /// The components that the problem does not need, each with the reason.
    pub left_out: Vec<String>,
    /// Warnings for the user.
    pub warnings: Vec<Warning>,
    /// Wall-clock time of the solve, in seconds.
    pub wall_seconds: f64,
}

/// Whether a count is zero.
fn is_zero<T: Default + PartialEq>(count: &T) -> bool {
    *count == T::default()
}

fn by_name<S: Serializer>(states: &[(String, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(states.iter().map(|(name, error)| (name, error)))
}
