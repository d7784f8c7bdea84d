//! Error against run time, as it was measured.

use super::Status;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What a study found.
#[derive(Clone, Debug, Default, Deserialize, Serialize, ToSchema)]
pub struct Study {
    /// What the errors are measured against.
    pub reference: String,
    /// One for each number of stages.
    pub series: Vec<Series>,
    /// The error at the end against the run time, in SVG.
    pub picture: String,
}

/// Runs that differ by their tolerance or step alone.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
pub struct Series {
    /// What they have in common, such as `3 stages`.
    pub method: String,
    /// In the order of the specification.
    pub runs: Vec<StudyRun>,
}

/// One run of a study. Errors are parts of the largest value that each state takes; none where the run did not reach the
/// end, or there is no reference.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
pub struct StudyRun {
    /// Its relative tolerance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rtol: Option<f64>,
    /// Its step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step: Option<f64>,
    /// How it ended.
    pub status: Status,
    /// Whether its answer is trusted (`verdict.trusted` of a solution); absent for another program, which gives no verdict.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trusted: Option<bool>,
    /// Accepted steps.
    pub steps: u64,
    /// The median of the run times, in seconds.
    pub wall_seconds: f64,
    /// The largest error at the end.
    pub error_at_end: Option<f64>,
    /// The largest error at the output times, between steps as well.
    pub largest_error: Option<f64>,
    /// The power of the step, or of the tolerance, by which the error at the end changed from the run before.
    pub order: Option<f64>,
}
