//! `GET /jobs/{id}`, `GET /jobs/{id}/specification`, `POST /jobs/{id}/cancel`, `DELETE /jobs/{id}`.

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

/// Show where a job stands.
///
/// The state has the words of OGC API - Processes: `accepted`, `running`, `successful`, `failed`, `dismissed`. A job that has ended
/// also says whether its answer is trusted, or why it has no answer.
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

/// Show what was posted.
///
/// The specification, byte by byte as it was posted.
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

/// The problem for stored data that cannot be read; details are logged only.
pub fn unreadable(job: JobId, error: &io::Error) -> Box<Problem> {
    tracing::error!(job.id = %job, %error, "the stored job {job} cannot be read");
    if error.kind() == io::ErrorKind::NotConnected {
        return Box::<Problem>::from(Away).of_job(job);
    }
    Problem::plain(if is_damage(error) { Kind::Damaged } else { Kind::Unreadable }).of_job(job)
}

/// Stop a job and keep its trajectory so far.
///
/// A running job stops at its next step. Of a job that has ended, this changes nothing.
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

/// Stop a job and forget it.
///
/// A running job stops at its next step. Nothing of it is kept: neither its specification, nor its results, nor its name.
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
