//! The answer of a solve, and the methods that produce it: trajectory in columns, events, diagnostics, verdict and
//! status.

mod astray;
mod audit;
mod bindable;
mod branch;
pub mod columnar;
mod compared_columns;
mod contact;
mod convolution;
mod dense;
mod diagnostics;
pub mod encodings;
mod energy_balance;
mod evaluation;
mod excerpt;
mod extremes;
mod fit;
mod given_steps;
mod global_error;
mod impulse;
mod integrate;
mod longer_run;
mod longer_steps;
mod mechanical_checks;
mod misdirection;
mod multipliers;
mod observables;
mod obstacle;
mod orbit;
mod order_of_impacts;
mod other_solutions;
mod passages;
pub mod pictures;
mod provenance;
mod quadrature;
mod reducers;
mod rigid_bodies;
mod run;
mod runaway;
mod sensitivities;
mod shooting;
mod static_vi;
mod statistics;
mod steady_state;
mod study;
mod summary;
mod table;
mod touches;
mod trajectory;
mod uniqueness;
mod unseen_actions;
mod unseen_data;
mod unseen_forces;
mod unseen_friction;
mod unseen_gaps;
mod unseen_motion;
mod unseen_signals;
mod verdict;
mod version;

pub use branch::{
    Branch, BranchEvent, BranchEventKind, BranchOf, BranchPlan, follow_orbits, follow_orbits_of_motion, follow_rests,
};
pub use contact::{ContactPlan, describe_contact, integrate_contact};
pub use convolution::{ConvolutionPlan, Mesh, describe_convolution, integrate_convolution};
pub use dense::Dense;
pub use diagnostics::{
    Contraction, Diagnostics, Evaluations, Face, GlobalError, Refinement, Screening, Steps, Tried, ViCounts,
};
pub use excerpt::{Excerpt, ExcerptError, Selection};
pub use fit::{DataColumn, Estimate, Fit, FitAnswer, FitStart, Fitted, Loss, Quantity, fit, fit_motion};
pub use integrate::{describe, integrate};
pub use longer_steps::MOST_COMPARED;
pub use observables::{Argument, Direction, EndedBy, Monitored, ObservableSlopes, Observables};
pub use obstacle::{describe_obstacle, integrate_obstacle};
pub use orbit::{Orbit, Periodic, find_orbit, find_orbit_of_motion};
pub use problem::{Event, EventKind, Warning};
pub use provenance::Provenance;
pub use reducers::{Collected, Over, Reducers, Reduction, Selected};
pub use rigid_bodies::{Impacts, describe_rigid_bodies, step_rigid_bodies};
pub use run::{Plan, Stepper, run};
pub use sensitivities::{AdjointWork, By, Checked, EventSlope, Gradient, Objective, Sensitivities, SlopedEvent};
pub use static_vi::{StaticPlan, StaticSolution, describe_static, solve_static};
pub use statistics::OverTime;
pub use steady_state::{SteadyState, find_steady_state};
pub use study::{Series, Study, StudyRun};
pub use summary::{OfNumber, Summary};
pub use table::{Column, Counts, Incomplete, Lists, Table, TableProvenance, Unmergeable, Values, Words, answer};
pub use trajectory::{Field, Trajectory};
pub use uniqueness::uniqueness_caveat;
pub use verdict::{Caveat, CheckCode, Checks, Measured, Reason, Verdict};
pub use version::Version;

use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// The status of a solve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// The end time was reached, or an event of `stop` ended the run.
    #[default]
    Completed,
    /// A limit or a cancellation stopped the run; the trajectory so far is kept.
    Stopped,
    /// The numerical method failed; the trajectory so far is kept.
    Failed,
}

/// The reason why a solve did not reach its end time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Failure {
    /// A stable code of the failure for programs, such as `step_too_small`.
    #[schema(value_type = String)]
    pub code: Cow<'static, str>,
    /// The cause of the failure and what to change, in words.
    pub message: String,
    /// The time that the solve reached.
    pub time: f64,
    /// The states at the time of the failure, in the order of the specification.
    pub state: Vec<f64>,
}

/// The answer to a specification. Every number in it is finite.
#[derive(Clone, Debug, Default, Serialize, Deserialize, ToSchema)]
pub struct Solution {
    /// The version of the answer format, 1: members may be added, but none is removed or changes its meaning.
    #[serde(default)]
    #[schema(value_type = u64, minimum = 1, maximum = 1)]
    pub version: Version,
    /// The status of the solve.
    pub status: Status,
    /// Whether the answer may be relied upon, and the reasons against it.
    #[serde(default)]
    pub verdict: Verdict,
    /// The specification and the program that produced the answer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub provenance: Option<Provenance>,
    /// The reason why the solve stopped or failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<Failure>,
    /// The monitor of `stop` that ended the run before the end time, if one did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended_by: Option<EndedBy>,
    /// Times, values and events of the run.
    pub trajectory: Trajectory,
    /// The evidence for the accuracy of the answer. It is written for people, and skipped when an answer is read
    /// back.
    #[serde(default, deserialize_with = "passed_over")]
    pub diagnostics: Diagnostics,
    /// Comparison of the derivatives with a finite difference of runs, on request.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensitivities: Option<Checked>,
    /// The derivatives of the objective, by the names of the parameters and initial values, in adjoint mode.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub gradient: BTreeMap<String, f64>,
    /// The value of the objective, in adjoint mode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub objective: Option<f64>,
    /// The derivatives of the times of events, if derivatives of a motion with impacts were requested.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub event_slopes: Vec<EventSlope>,
    /// The periodic orbit, if one was requested and found; the trajectory then covers one period.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orbit: Option<Orbit>,
    /// The steady state, if one was requested and found; the trajectory is then a short run from it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steady_state: Option<SteadyState>,
    /// The branch of orbits or steady states, if `continue` requested one; the trajectory is that of its last point.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub branch: Option<Branch>,
    /// One row of collected numbers per member of a sweep.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table: Option<Table>,
    /// Summary statistics of each number that a sweep collects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub summary: Option<Summary>,
    /// The fitted parameters, if a fit was requested; the trajectory is the fitted one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit: Option<FitAnswer>,
    /// The solution of a static problem; absent for other problems.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub solution: Option<StaticSolution>,
    /// Error against run time, if a study was requested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub study: Option<Study>,
    /// The values collected by reducers, in the order of [`Plan::reducers`]; not part of the written answer.
    #[serde(skip)]
    pub collected: Vec<Collected>,
    /// The fields as functions of time, if [`Plan::interpolants`] asks for them and every step has an interpolant;
    /// not part of the written answer.
    #[serde(skip)]
    pub dense: Option<Dense>,
}

/// Skips a value while deserialising, and returns the default of its type.
fn passed_over<'de, T: Default, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    IgnoredAny::deserialize(deserializer).map(|_| T::default())
}

impl Solution {
    /// Derives the verdict on the answer from all checks, and is called after the last of them. `end` is the requested
    /// end time of a run, and `None` for a search.
    pub fn judge(&mut self, end: Option<f64>) {
        self.verdict = Verdict::of(self.status, self.error.as_ref(), end, &self.diagnostics.checks);
    }
}
