//! The status, the specification and the deletion of a job: `GET /jobs/{id}`, `GET /jobs/{id}/specification`,
//! `POST /jobs/{id}/cancel`, `DELETE /jobs/{id}`.

use super::path::JobPath;
use super::problem::{HandlerResult, Kind, Problem};
use super::status::StatusInfo;
use super::{Shared, no_store};
use crate::jobs::{Away, JobId, is_damage};
use axum::Json;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::IntoResponse;
use std::io;

/// Show the status of a job.
///
/// The status is a word of OGC API - Processes: `accepted`, `running`, `successful`, `failed`, `dismissed`. For a job
/// that has ended, the response also says whether its solution is trusted, or why there is none.
#[utoipa::path(
    get,
    path = "/jobs/{id}",
    tag = "jobs",
    params(("id" = String, Path, description = "The id of a job, from `Location`")),
    responses((status = 200, description = "The status of the job", body = StatusInfo), Problem)
)]
pub async fn find_job(State(shared): State<Shared>, JobPath(job): JobPath) -> impl IntoResponse {
    (no_store(), Json(StatusInfo::of(&job, &shared.jobs)))
}

/// Fetch the specification of a job.
///
/// The specification, byte for byte as it was posted.
#[utoipa::path(
    get,
    path = "/jobs/{id}/specification",
    tag = "jobs",
    params(("id" = String, Path, description = "The id of a job, from `Location`")),
    responses((status = 200, description = "The specification as it was posted", body = specification::Document), Problem)
)]
pub async fn find_specification(
    State(shared): State<Shared>,
    JobPath(job): JobPath,
) -> HandlerResult<impl IntoResponse> {
    let document = shared.jobs.document(&job).await.map_err(|error| unreadable(job.id, &error))?;
    Ok(([(header::CONTENT_TYPE, HeaderValue::from_static("application/json"))], Bytes::from_owner(document)))
}

/// Returns the problem for stored data of a job that cannot be read; details are only logged.
pub fn unreadable(job: JobId, error: &io::Error) -> Box<Problem> {
    tracing::error!(job.id = %job, %error, "the stored job {job} cannot be read");
    if error.kind() == io::ErrorKind::NotConnected {
        return Box::<Problem>::from(Away).of_job(job);
    }
    Problem::plain(if is_damage(error) { Kind::Damaged } else { Kind::Unreadable }).of_job(job)
}

/// Stop a job and keep its trajectory so far.
///
/// A running job stops at its next step. Has no effect on a job that has ended.
#[utoipa::path(
    post,
    path = "/jobs/{id}/cancel",
    tag = "jobs",
    params(("id" = String, Path, description = "The id of a job, from `Location`")),
    responses((status = 200, description = "The status of the job", body = StatusInfo), Problem)
)]
pub async fn cancel_job(State(shared): State<Shared>, JobPath(job): JobPath) -> HandlerResult<impl IntoResponse> {
    shared.jobs.cancel(&job).await?;
    Ok((no_store(), Json(StatusInfo::of(&job, &shared.jobs))))
}

/// Stop a job and delete it.
///
/// A running job stops at its next step. Its specification, its results and its id are deleted.
#[utoipa::path(
    delete,
    path = "/jobs/{id}",
    tag = "jobs",
    params(("id" = String, Path, description = "The id of a job, from `Location`")),
    responses((status = 204, description = "The job is deleted"), Problem)
)]
pub async fn delete_job(State(shared): State<Shared>, JobPath(job): JobPath) -> HandlerResult<StatusCode> {
    shared.jobs.forget(&job).await?;
    Ok(StatusCode::NO_CONTENT)
}
