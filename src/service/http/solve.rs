//! `POST /solve`: the response has the results, if the solve ends within the time that the client waits, and
//! otherwise the address of the job.
//!
//! If a client disconnects while it waits, its job is cancelled and deleted. A client that has received the address
//! may disconnect: the job continues.

use super::document::Document;
use super::event_stream::ServerSentEvent;
use super::preferences::Preferences;
use super::problem::{HandlerResult, Kind, Problem};
use super::results::represent;
use super::solve_stream::{self, Delivery};
use super::status::StatusInfo;
use super::{Shared, no_store, retry_after};
use crate::context::address;
use crate::jobs::{self, Client, Ended, Job, Jobs, Key, Order};
use axum::Json;
use axum::extract::{FromRequestParts, State};
use axum::http::request::Parts;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use solution::Solution;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::Handle;
use tokio::time::timeout;

/// Solve a specification.
///
/// If the solve ends within the time to wait (`Prefer: wait=SECONDS`, at most 60, by default 30), the response has
/// its results in the format of `Accept`; with `Prefer: transient`, the job is then deleted. Otherwise, and at once
/// with `Prefer: respond-async`, the response is 202 with the address of the job, which is then durable.
/// `Accept: text/event-stream` streams progress, switches and the end. A client that disconnects while it waits
/// cancels the job.
#[utoipa::path(
    post,
    path = "/solve",
    tag = "solve",
    request_body(content = specification::Document, content_type = "application/json"),
    params(
        ("prefer" = Option<String>, Header, description = "`wait=N` seconds, at most 60, or `respond-async`; \
                                                           `transient` leaves no job behind results"),
        ("idempotency-key" = Option<String>, Header, description = "The same key and body give the same job"),
        ("cache-control" = Option<String>, Header, description = "`no-cache` solves the specification again, even if a \
                                                                  stored result exists")
    ),
    responses(
        (status = 200, description = "The result, in the media type of `Accept`", content(
            (Solution = "application/json"),
            (String = "text/csv"),
            (String = "application/x-ndjson"),
            (Vec<u8> = "application/vnd.apache.arrow.stream"),
            (String = "image/svg+xml"),
            (ServerSentEvent = "text/event-stream"),
        ), headers(
            ("dvi-trusted" = bool, description = "Whether the solution is trusted: `verdict.trusted` of the JSON"),
            ("dvi-repeated" = Option<bool>, description = "`true` if the response is the stored result of an earlier \
                                                           request with the same text, byte for byte")
        )),
        (status = 202, description = "The solve takes longer; `Location` is the job", body = StatusInfo),
        Problem
    )
)]
pub async fn solve(
    State(shared): State<Shared>,
    client: Client,
    preferences: Preferences,
    delivery: Delivery,
    key: IdempotencyKey,
    Anew(anew): Anew,
    document: Document,
) -> HandlerResult<Response> {
    let representation = match delivery {
        Delivery::Whole(representation) => representation,
        Delivery::Stream => {
            // A client that asks for a stream of events gets a solve, not a stored solution.
            let job = job(&shared, client, key, &document, false, true).await?;
            return solve_stream::stream(shared, client, job);
        }
    };
    let wait = preferences.wait();
    let job = job(&shared, client, key, &document, wait.is_zero(), anew).await?;
    let ended = if wait.is_zero() {
        // A job that was posted earlier under the idempotency key of this request may be in memory only, and is made
        // durable here.
        shared.jobs.outlive(&job).await?;
        None
    } else {
        wait_for(&shared.jobs, &job, wait).await?
    };
    let asynchronous = ended.is_none();
    // Dropping this guard deletes the job, also when the client disconnects before it has received the response.
    let passing = (preferences.is_transient() && !asynchronous)
        .then(|| AbandonGuard::watch(Arc::clone(&shared.jobs), Arc::clone(&job)));
    let mut response = match ended {
        Some(ended) => represent(&shared, &job, &ended, representation, None).await?,
        None => accepted(&shared.jobs, &job),
    };
    response.extensions_mut().insert(job.id);
    let headers = response.headers_mut();
    headers.insert(header::VARY, HeaderValue::from_static("accept, prefer"));
    if let Some(applied) = preferences.applied(asynchronous) {
        headers.insert("preference-applied", applied);
    }
    if passing.is_none()
        && let Ok(link) =
            HeaderValue::try_from(format!("<{}>; rel=\"monitor\"", address(format_args!("/jobs/{}", job.id))))
    {
        headers.insert(header::LINK, link);
    }
    Ok(response)
}

/// Admits a new job, or returns the earlier job with the idempotency key of the request.
async fn job(
    shared: &Shared,
    client: Client,
    key: IdempotencyKey,
    document: &Document,
    durable: bool,
    anew: bool,
) -> HandlerResult<Arc<Job>> {
    let key = key.0.map(|name| Key::new(name, &document.bytes()));
    job_under(shared, client, key, document, durable, anew).await
}

/// Admits a new job under `key`, or returns the earlier job with that key. `durable` jobs are stored before they are
/// accepted, and `anew` refuses stored solutions.
pub async fn job_under(
    shared: &Shared,
    client: Client,
    key: Option<Key>,
    document: &Document,
    durable: bool,
    anew: bool,
) -> HandlerResult<Arc<Job>> {
    let document_bytes = document.bytes();
    if let Some(key) = &key
        && let Some(job) = shared.jobs.recall(client, key, document_bytes.len()).await?
    {
        return Ok(job);
    }
    // The limits are checked before the specification is parsed, so that a refusal costs little.
    shared.jobs.admits(client, document_bytes.len())?;
    let (facts, known) = document.checked(shared, client).await?.facts();
    let order = Order { client, facts, known, anew, document: document_bytes, key };
    Ok(shared.jobs.submit(order, durable).await?)
}

/// Waits for the end of a job, for at most `wait`. If the job has not ended then, makes it durable and returns
/// `None`.
async fn wait_for(jobs: &Arc<Jobs>, job: &Arc<Job>, wait: Duration) -> HandlerResult<Option<Arc<Ended>>> {
    let guard = AbandonGuard::watch(Arc::clone(jobs), Arc::clone(job));
    let ended = timeout(wait, job.settled()).await.ok().flatten();
    guard.disarm();
    if ended.is_some() {
        return Ok(ended);
    }
    if let Err(unwritable) = jobs.outlive(job).await {
        // The client has not learned the id of the job, so that the job can be deleted.
        jobs.forget(job).await?;
        return Err(unwritable.into());
    }
    Ok(match job.state() {
        jobs::State::Ended(ended) => Some(ended),
        jobs::State::Accepted(_) | jobs::State::Running { .. } => None,
    })
}

/// Returns the response 202 (Accepted) with the status of a job that has not ended.
pub fn accepted(jobs: &Jobs, job: &Job) -> Response {
    let mut response = (StatusCode::ACCEPTED, no_store(), Json(StatusInfo::of(job, jobs))).into_response();
    response.extensions_mut().insert(job.id);
    let headers = response.headers_mut();
    headers.insert(header::RETRY_AFTER, retry_after(jobs.time_to_end(job)));
    if let Ok(location) = HeaderValue::try_from(address(format_args!("/jobs/{}", job.id))) {
        headers.insert(header::LOCATION, location);
    }
    response
}

/// A guard of a job whose id no client knows: dropping the guard deletes the job, because the client has
/// disconnected, or has its results and asked for a transient job. A job with an idempotency key is not deleted,
/// since the client can repeat its request, and another request may wait for the job.
pub struct AbandonGuard {
    jobs: Arc<Jobs>,
    job: Option<Arc<Job>>,
}

impl AbandonGuard {
    /// Creates a guard of a job for which a client waits; jobs with an idempotency key are not guarded.
    pub fn watch(jobs: Arc<Jobs>, job: Arc<Job>) -> Self {
        Self { jobs, job: Some(job).filter(|job| !job.has_key()) }
    }

    /// Disarms the guard, which would delete the job, since the client gets a response with the id of the job.
    pub fn disarm(mut self) {
        self.job = None;
    }
}

impl Drop for AbandonGuard {
    fn drop(&mut self) {
        if let Some(job) = self.job.take() {
            tracing::debug!(job.id = %job.id, "nobody knows job {} any more", job.id);
            let jobs = Arc::clone(&self.jobs);
            // Without an async runtime, the process is about to end, and the job with it.
            if let Ok(runtime) = Handle::try_current() {
                runtime.spawn(async move { jobs.forget(&job).await });
            }
        }
    }
}

/// Whether the client refuses stored solutions: `Cache-Control: no-cache` (RFC 9111, section 5.2.1.4).
pub struct Anew(bool);

impl<S: Send + Sync> FromRequestParts<S> for Anew {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        let lines = parts.headers.get_all(header::CACHE_CONTROL).iter().filter_map(|line| line.to_str().ok());
        let mut directives = lines.flat_map(|line| line.split(','));
        Ok(Self(directives.any(|directive| directive.trim().eq_ignore_ascii_case("no-cache"))))
    }
}

/// The value of the header `Idempotency-Key`, if the request has one.
pub struct IdempotencyKey(pub Option<String>);

/// The longest accepted idempotency key, in bytes.
const LONGEST_KEY: usize = 255;

impl<S: Send + Sync> FromRequestParts<S> for IdempotencyKey {
    type Rejection = Box<Problem>;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Self::Rejection> {
        let Some(name) = parts.headers.get("idempotency-key") else { return Ok(Self(None)) };
        let name = name.to_str().unwrap_or_default();
        if !(1..=LONGEST_KEY).contains(&name.len()) {
            return Err(Problem::plain(Kind::BadKey));
        }
        Ok(Self(Some(name.to_owned())))
    }
}
