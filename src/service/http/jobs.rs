//! `GET /jobs/{id}`, `POST /jobs/{id}/cancel`, `DELETE /jobs/{id}`.

use super::path::Named;
use super::problem::Problem;
use super::status::StatusInfo;
use super::{Shared, no_store};
use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::IntoResponse;

/// Show where a job stands.
#[utoipa::path(get, path = "/jobs/{id}", tag = "jobs", params(("id" = String, Path, description = "The id of a job, as `Location` gave it")), responses((status = 200, description = "Where the job stands", body = StatusInfo), Problem))]
pub async fn find_job(State(shared): State<Shared>, Named(job): Named) -> impl IntoResponse {
    (no_store(), Json(StatusInfo::of(&job, &shared.jobs)))
}

/// Stop a job and keep its trajectory so far.
///
/// A running job stops at its next step. Of a job that has ended, this changes nothing.
#[utoipa::path(post, path = "/jobs/{id}/cancel", tag = "jobs", params(("id" = String, Path, description = "The id of a job, as `Location` gave it")), responses((status = 200, description = "Where the job stands", body = StatusInfo), Problem))]
pub async fn cancel_job(State(shared): State<Shared>, Named(job): Named) -> impl IntoResponse {
    shared.jobs.cancel(&job);
    (no_store(), Json(StatusInfo::of(&job, &shared.jobs)))
}

/// Stop a job and forget it.
#[utoipa::path(delete, path = "/jobs/{id}", tag = "jobs", params(("id" = String, Path, description = "The id of a job, as `Location` gave it")), responses((status = 204, description = "It is forgotten"), Problem))]
pub async fn delete_job(State(shared): State<Shared>, Named(job): Named) -> StatusCode {
    shared.jobs.forget(&job);
    StatusCode::NO_CONTENT
}
