//! `POST /solve`: the answer itself if it comes within the time that the client would wait, a monitor if not.
//!
//! A client that goes away while it waits takes its job with it. A client that has been given a monitor may go: the
//! job lives on.

use super::document::Document;
use super::preferences::Preferences;
use super::problem::{Answer, Problem};
use super::results::represent;
use super::solve_stream::{self, Delivery};
use super::status::StatusInfo;
use super::{Shared, no_store, retry_after};
use crate::service::jobs::{Client, Job, Jobs};
use crate::solution::Solution;
use axum::Json;
use axum::extract::State;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use std::sync::Arc;
use tokio::time::timeout;

/// Solve a specification.
#[utoipa::path(post, path = "/solve", tag = "solve", request_body(content = crate::specification::Document, content_type = "application/json"), params(("prefer" = Option<String>, Header, description = "`wait=N` seconds, at most 60, or `respond-async`"), ("idempotency-key" = Option<String>, Header, description = "The same key and body give the same job")), responses((status = 200, description = "The result, in the form that `Accept` asks for", content(
            (Solution = "application/json"),
            (String = "text/csv"),
            (String = "application/x-ndjson"),
            (Vec<u8> = "application/vnd.apache.arrow.stream"),
            (String = "image/svg+xml"),
            (String = "text/event-stream"),
        )), (status = 202, description = "It takes longer; `Location` is the job", body = StatusInfo), Problem))]
pub async fn solve(
    State(shared): State<Shared>,
    client: Client,
    preferences: Preferences,
    delivery: Delivery,
    document: Document,
) -> Answer<Response> {
    // Asked before the specification is read, so that refusing costs next to nothing.
    shared.jobs.admits(client)?;
    let specification = document.specification(&shared).await?;
    let job = shared.jobs.submit(client, specification)?;
    let representation = match delivery {
        Delivery::Whole(representation) => representation,
        Delivery::Stream => return solve_stream::stream(shared, job),
    };
    let wait = preferences.wait();
    let ending = if wait.is_zero() {
        None
    } else {
        let departure = Departure::watch(Arc::clone(&shared.jobs), Arc::clone(&job));
        let ending = timeout(wait, job.ended()).await.ok();
        departure.disarm();
        ending
    };
    let asynchronous = ending.is_none();
    let mut response = match ending {
        Some(ending) => represent(&shared, &job, ending, representation, None).await?,
        None => accepted(&shared.jobs, &job),
    };
    let headers = response.headers_mut();
    headers.insert(header::VARY, HeaderValue::from_static("accept, prefer"));
    if let Some(applied) = preferences.applied(asynchronous) {
        headers.insert("preference-applied", applied);
    }
    if let Ok(link) = HeaderValue::try_from(format!("</jobs/{}>; rel=\"monitor\"", job.id)) {
        headers.insert(header::LINK, link);
    }
    Ok(response)
}

fn accepted(jobs: &Jobs, job: &Job) -> Response {
    let mut response = (StatusCode::ACCEPTED, no_store(), Json(StatusInfo::of(job, jobs))).into_response();
    let headers = response.headers_mut();
    headers.insert(header::RETRY_AFTER, retry_after(jobs.time_to_end(job)));
    if let Ok(location) = HeaderValue::try_from(format!("/jobs/{}", job.id)) {
        headers.insert(header::LOCATION, location);
    }
    response
}

/// Dropped with the waiting request when its client goes away, it forgets the job, whose name nobody was told.
pub struct Departure {
    jobs: Arc<Jobs>,
    job: Option<Arc<Job>>,
}

impl Departure {
    /// Watches over the job of a waiting client.
    pub fn watch(jobs: Arc<Jobs>, job: Arc<Job>) -> Self {
        Self { jobs, job: Some(job) }
    }

    /// The client has its answer.
    pub fn disarm(mut self) {
        self.job = None;
    }
}

impl Drop for Departure {
    fn drop(&mut self) {
        if let Some(job) = &self.job {
            tracing::debug!(job.id = %job.id, "the client of job {} went away", job.id);
            self.jobs.forget(job);
        }
    }
}
