//! The measured error of runs against their run time (work-precision study).

use super::Status;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The result of a study of error against run time.
#[derive(Clone, Debug, Default, Deserialize, Serialize, ToSchema)]
pub struct Study {
    /// The reference solution for the errors.
    pub reference: String,
    /// The series of runs, one per number of stages.
    pub series: Vec<Series>,
    /// Plot of the error at the end against run time, in SVG.
    pub picture: String,
}

/// A series of runs of a study that differ only in their tolerance or step size.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
pub struct Series {
    /// The method common to the runs, such as `3 stages`.
    pub method: String,
    /// The runs of the series, in the order of the specification.
    pub runs: Vec<StudyRun>,
}

/// One run of a study. Errors are relative to the largest value of each state; they are missing if the run did not
/// reach the end, or there is no reference.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
pub struct StudyRun {
    /// The relative tolerance of the run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rtol: Option<f64>,
    /// The fixed step size of the run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step: Option<f64>,
    /// The status of the run.
    pub status: Status,
    /// Whether the answer is trusted (`verdict.trusted` of a solution); absent for other programs, which give no
    /// verdict.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trusted: Option<bool>,
    /// Number of accepted steps.
    pub steps: u64,
    /// Median of the run times of repeated runs, in seconds.
    pub wall_seconds: f64,
    /// The largest error of a state at the end.
    pub error_at_end: Option<f64>,
    /// The largest error of a state at the output times, including those between steps.
    pub largest_error: Option<f64>,
    /// The observed order: the power of the step, or of the tolerance, by which the error at the end changed from the
    /// previous run.
    pub order: Option<f64>,
}
