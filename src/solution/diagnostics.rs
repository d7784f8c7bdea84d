//! The evidence that comes with a trajectory. What does not apply to the method that ran, or was never done, is left out:
//! a count of zero that everybody has (rejected steps, switches) is written, one of a part that did not run is not.

use super::Checks;
use analysis::{Analysis, Certificates};
use contact::energy::Energy;
use problem::Warning;
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// What can be said of the problem on an active face of `K`.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Face {
    /// When it was first met.
    pub t: f64,
    /// The variables inside their interval or block, whose `G` is zero; the others rest on a bound.
    pub inside: Vec<String>,
    /// The variables that move along the boundary of a block.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub on_boundary: Vec<String>,
    /// Index and uniqueness there.
    #[serde(flatten)]
    #[schema(value_type = Object)]
    pub analysis: Analysis,
}

/// Accepted and rejected steps.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
pub struct Steps {
    /// Steps that became part of the trajectory.
    pub accepted: u64,
    /// Steps done again, smaller.
    pub rejected: u64,
    /// Those, by the word for why.
    pub rejected_for: BTreeMap<&'static str, u64>,
}

/// How fast the increments of Newton's method shrank, from one to the next, where it took more than one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct Contraction {
    /// The mean factor.
    pub mean: f64,
    /// The largest factor.
    pub largest: f64,
}

/// An estimate of the error of the states at the end.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct GlobalError {
    /// Of each state, in its unit: the value less the exact one.
    #[serde(serialize_with = "by_name")]
    #[schema(value_type = BTreeMap<String, f64>)]
    pub states: Vec<(String, f64)>,
    /// The largest, in units of `atol + rtol |x|`.
    pub largest_scaled: f64,
    /// The accepted steps of the second run, with which this one was compared.
    pub reference_steps: u64,
}

/// How the mesh of a problem with memory was found: steps of one length were halved, or the tolerance of elements between
/// located switches divided by ten, until two runs agreed.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Refinement {
    /// How often the step was halved, or the tolerance divided.
    pub halvings: u32,
    /// Of each variable, the mean over time of the distance between the last run and the one before, at its steps, or
    /// half of the distance before that where it is larger: what the last but one is off by, so that the last is off by
    /// less.
    #[serde(serialize_with = "by_name")]
    #[schema(value_type = BTreeMap<String, f64>)]
    pub mean_distance: Vec<(String, f64)>,
    /// The largest of them, in units of `atol + rtol max |z|`; the aim is 1.
    pub scaled: f64,
    /// The factor by which the distance last shrank, as a power of two: the order that was met.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub order: Option<f64>,
}

/// The steps of a run that were screened for events between the stages, by enclosure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
pub struct Screening {
    /// Steps proven free of events.
    pub proven: u64,
    /// Steps of which neither is shown.
    pub undecided: u64,
    /// Steps in which the law fails between the stages.
    pub missed: u64,
}

/// What was evaluated, and how often; a count of zero is left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
pub struct Evaluations {
    /// Evaluations of the rates and of `G`.
    #[serde(skip_serializing_if = "is_zero")]
    pub rates: u64,
    /// Evaluations of their derivatives.
    #[serde(skip_serializing_if = "is_zero")]
    pub jacobians: u64,
    /// Factorisations of a matrix.
    #[serde(skip_serializing_if = "is_zero")]
    pub factorisations: u64,
}

/// A solver that did not solve a variational inequality, so that the next was tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct Tried {
    /// Its name.
    pub solver: &'static str,
    /// How it ended.
    pub outcome: &'static str,
    /// How often.
    pub times: u64,
}

/// The variational inequalities solved at stages.
#[derive(Clone, Debug, Default, PartialEq, Serialize, ToSchema)]
pub struct ViCounts {
    /// The solver that answered last.
    pub solver: &'static str,
    /// Problems solved.
    pub solves: u64,
    /// Pivots and inner iterations in all.
    pub pivots: u64,
    /// The largest natural-map residual of an accepted step.
    pub largest_residual: f64,
    /// The solvers that were tried in vain, where there was a choice.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tried: Vec<Tried>,
}

/// What was done, and how well.
#[derive(Clone, Debug, Default, Serialize, ToSchema)]
pub struct Diagnostics {
    /// Index and uniqueness, and why.
    #[serde(flatten)]
    #[schema(value_type = Object)]
    pub analysis: Option<Analysis>,
    /// The same on each active face that a switch led to, the first ones.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub faces: Vec<Face>,
    /// The method that ran.
    pub method: &'static str,
    /// Its number of stages; absent where the method is not of Runge-Kutta type.
    #[serde(skip_serializing_if = "is_zero")]
    pub stages: usize,
    /// Steps taken.
    pub steps: Steps,
    /// Evaluations made; absent where the method counts none.
    #[serde(skip_serializing_if = "is_zero")]
    pub evaluations: Evaluations,
    /// Newton iterations on the stages; absent where the method makes none.
    #[serde(skip_serializing_if = "is_zero")]
    pub newton_iterations: u64,
    /// Their rate of convergence; absent where one iteration was always enough.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub newton_contraction: Option<Contraction>,
    /// Variational inequalities solved; absent where there are no variables.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vi: Option<ViCounts>,
    /// Changes of the active face of `K`.
    pub switches: u64,
    /// The steps that were screened for events; absent where there are no variables.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub screening: Option<Screening>,
    /// Signs and products of `z` and `G`, and the differentiation lemmas; absent where no variable has a bound.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub complementarity: Option<Certificates>,
    /// The balance of energy; absent where the problem has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub energy: Option<Energy>,
    /// What the values at the end may be off by; present where it was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub global_error: Option<GlobalError>,
    /// What was measured for the verdict: the code of each check (`CheckCode`), with the worst value of the run beside the
    /// one up to which the answer is trusted. A check that was not made is absent.
    pub checks: Checks,
    /// How the step was chosen; present for a problem with memory without a `step`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refinement: Option<Refinement>,
    /// The parts that were built.
    pub built: Vec<&'static str>,
    /// The parts that this problem did not need, each with the reason.
    pub left_out: Vec<String>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// Wall-clock time of the solve, in seconds.
    pub wall_seconds: f64,
}

/// Whether nothing was counted.
fn is_zero<T: Default + PartialEq>(count: &T) -> bool {
    *count == T::default()
}

fn by_name<S: Serializer>(states: &[(String, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(states.iter().map(|(name, error)| (name, error)))
}
