//! `GET /jobs/{id}`, `POST /jobs/{id}/cancel`, `DELETE /jobs/{id}`.

use super::path::Named;
use super::status::StatusInfo;
use super::{Shared, no_store};
use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::IntoResponse;

/// Show where a job stands.
pub async fn find_job(State(shared): State<Shared>, Named(job): Named) -> impl IntoResponse {
    (no_store(), Json(StatusInfo::of(&job, &shared.jobs)))
}

/// Stop a job and keep its trajectory so far.
///
/// A running job stops at its next step. Of a job that has ended, this changes nothing.
pub async fn cancel_job(State(shared): State<Shared>, Named(job): Named) -> impl IntoResponse {
    shared.jobs.cancel(&job);
    (no_store(), Json(StatusInfo::of(&job, &shared.jobs)))
}

/// Stop a job and forget it.
pub async fn delete_job(State(shared): State<Shared>, Named(job): Named) -> StatusCode {
    shared.jobs.forget(&job);
    StatusCode::NO_CONTENT
}
