//! The evidence reported with a trajectory. Counts of components that did not run are left out; counts that every run
//! has (rejected steps, switches) are written even if zero.

use super::{AdjointWork, Checks};
use analysis::{Analysis, Certificates};
use contact::energy::Energy;
use problem::Warning;
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// The analysis of the problem on one active face of the set `K`.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Face {
    /// Time at which the face first became active.
    pub t: f64,
    /// The variables inside their interval or block, whose `G` is zero; all others are at a bound.
    pub inside: Vec<String>,
    /// The variables on the boundary of a block, along which they can move.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub on_boundary: Vec<String>,
    /// Index and uniqueness of the problem on the active face.
    #[serde(flatten)]
    #[schema(value_type = Object)]
    pub analysis: Analysis,
}

/// Numbers of accepted and rejected steps.
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
    /// The mean convergence factor of Newton's method.
    pub mean: f64,
    /// The largest convergence factor of Newton's method.
    pub largest: f64,
}

/// An estimate of the global error, that of the states at the end.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct GlobalError {
    /// Error of each state at the end, in its unit: the computed value minus the exact one.
    #[serde(serialize_with = "by_name")]
    #[schema(value_type = BTreeMap<String, f64>)]
    pub states: Vec<(String, f64)>,
    /// The largest error of a state, in units of `atol + rtol |x|`.
    pub largest_scaled: f64,
    /// Number of accepted steps of the second, more accurate run, which is the reference.
    pub reference_steps: u64,
}

/// The refinement of the mesh of a problem with memory (a convolution): the uniform step was halved, or the tolerance
/// of elements between located switches divided by ten, until two runs agreed.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Refinement {
    /// Number of times that the step was halved, or the tolerance divided by ten.
    pub halvings: u32,
    /// For each variable, the mean over time of the distance between the last two runs, at the steps of the last run,
    /// or half the previous mean distance if that is larger. The mean distance estimates the error of the last run
    /// but one, and so bounds that of the last run.
    #[serde(serialize_with = "by_name")]
    #[schema(value_type = BTreeMap<String, f64>)]
    pub mean_distance: Vec<(String, f64)>,
    /// The largest mean distance of a variable between the last two runs, in units of `atol + rtol max |z|`; the
    /// target is 1.
    pub scaled: f64,
    /// The observed order: the base-two logarithm of the factor by which the last halving of the step reduced the
    /// distance between runs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub order: Option<f64>,
}

/// Numbers of steps screened for events between the stages, by interval enclosure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
pub struct Screening {
    /// Number of steps that are proven free of events.
    pub proven: u64,
    /// Number of steps in which events are neither excluded nor found.
    pub undecided: u64,
    /// Number of steps in which the variational inequality is violated between the stages.
    pub missed: u64,
}

/// Numbers of evaluations; a count of zero is left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
pub struct Evaluations {
    /// Number of evaluations of the rates and of `G`.
    #[serde(skip_serializing_if = "is_zero")]
    pub rates: u64,
    /// Number of evaluations of the Jacobian of the rates and of `G`.
    #[serde(skip_serializing_if = "is_zero")]
    pub jacobians: u64,
    /// Number of factorisations of a matrix.
    #[serde(skip_serializing_if = "is_zero")]
    pub factorisations: u64,
}

/// A solver that failed on a variational inequality, so that the next solver was tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct Tried {
    /// The name of the solver.
    pub solver: &'static str,
    /// The outcome of the solver, such as a lack of convergence.
    pub outcome: &'static str,
    /// Number of times that the solver had this outcome.
    pub times: u64,
}

/// Counts of the variational inequalities solved at the stages of the steps.
#[derive(Clone, Debug, Default, PartialEq, Serialize, ToSchema)]
pub struct ViCounts {
    /// The name of the solver that last solved a variational inequality.
    pub solver: &'static str,
    /// Number of variational inequalities solved.
    pub solves: u64,
    /// Total number of pivots and inner iterations of the solvers of variational inequalities.
    pub pivots: u64,
    /// The largest natural-map residual of an accepted step.
    pub largest_residual: f64,
    /// The largest residual of the contact law with a proximal term, which replaces the exact law if there are too
    /// many contacts to solve it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_proximal_residual: Option<f64>,
    /// The solvers that failed on a variational inequality before another solver succeeded.
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
    /// The name of the method that ran.
    pub method: &'static str,
    /// Number of stages; absent for methods not of Runge-Kutta type.
    #[serde(skip_serializing_if = "is_zero")]
    pub stages: usize,
    /// Numbers of accepted and rejected steps.
    pub steps: Steps,
    /// Numbers of evaluations; absent for methods that do not count them.
    #[serde(skip_serializing_if = "is_zero")]
    pub evaluations: Evaluations,
    /// Number of Newton iterations on the stage equations; absent for methods without stage equations.
    #[serde(skip_serializing_if = "is_zero")]
    pub newton_iterations: u64,
    /// Rate of convergence of the Newton iterations; absent if one iteration always sufficed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub newton_contraction: Option<Contraction>,
    /// Counts of the variational inequalities solved; absent if there are no variables.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vi: Option<ViCounts>,
    /// Number of changes of the active face of `K`.
    pub switches: u64,
    /// Numbers of steps screened for events; absent if there are no variables.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub screening: Option<Screening>,
    /// Signs and products of `z` and `G`, and the checks of the differentiation lemmas; absent if no variable has a
    /// bound.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub complementarity: Option<Certificates>,
    /// Energy balance; absent for problems without an energy.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub energy: Option<Energy>,
    /// The work of the backward sweep for a gradient; present in adjoint mode.
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
    /// The components of the method that were built.
    pub built: Vec<&'static str>,
    /// The components of the method that the problem does not need, each with the reason.
    pub left_out: Vec<String>,
    /// Warnings about the run, for the user.
    pub warnings: Vec<Warning>,
    /// Wall-clock time of the solve, in seconds.
    pub wall_seconds: f64,
}

/// Whether a count has its default value, zero.
fn is_zero<T: Default + PartialEq>(count: &T) -> bool {
    *count == T::default()
}

fn by_name<S: Serializer>(states: &[(String, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(states.iter().map(|(name, error)| (name, error)))
}
