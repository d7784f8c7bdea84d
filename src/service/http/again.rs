//! `POST /jobs/{id}/retry` and `POST /jobs/{id}/continue`: repetition and continuation of a job that has ended.
//!
//! Both create a new job with an id of its own, for the client of the original job. An ended job does not change, so
//! that its id keeps naming the same results and the same reason of failure. A job that was set aside because the
//! service crashed while it ran is retried without its recorded crashes, and is set aside again only after two more.

use super::Shared;
use super::document::Document;
use super::jobs::unreadable;
use super::path::JobPath;
use super::problem::{HandlerResult, Kind, Problem};
use super::representation::run_blocking;
use super::solve::{IdempotencyKey, accepted, job_under};
use super::status::StatusInfo;
use crate::context::address;
use crate::jobs::{Ended, Ending, Job, JobId, Key, Results, SHORT, State as JobState};
use crate::worker::Finding;
use axum::extract::State;
use axum::http::{HeaderValue, header};
use axum::response::Response;
use serde::Deserialize;
use solution::columnar::Rows;
use specification::{NotContinuable, continued};
use std::collections::HashMap;
use std::io;
use std::sync::Arc;
use utoipa::{IntoResponses, ToSchema};

/// The time up to which a job is to be continued.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = Continuation)]
pub struct Further {
    /// The end time of the new job, later than the last time of the trajectory.
    end: f64,
}

/// The new job, whose URL is in `Location`
#[derive(IntoResponses)]
#[response(status = 202, headers(
    ("location" = String, description = "The new job"),
    ("retry-after" = u64, description = "The recommended time until the first request for its results, in seconds"),
    ("link" = String, description = "The original job, as `predecessor-version`")
))]
#[expect(dead_code, reason = "only the OpenAPI description uses it")]
pub struct Successor(StatusInfo);

/// Retry a job that failed or was cancelled.
///
/// A new job with the same specification is queued; the original job does not change.
#[utoipa::path(
    post,
    path = "/jobs/{id}/retry",
    tag = "jobs",
    params(
        ("id" = String, Path, description = "The id of a job, from `Location`"),
        ("idempotency-key" = Option<String>, Header, description = "The same key gives the same new job")
    ),
    responses(
        Successor,
        Problem
    )
)]
pub async fn retry_job(
    State(shared): State<Shared>,
    JobPath(job): JobPath,
    key: IdempotencyKey,
) -> HandlerResult<Response> {
    if ended(&job)?.ending == Ending::Successful {
        return Err(Problem::plain(Kind::AlreadySuccessful).of_job(job.id));
    }
    let document = shared.jobs.document(&job).await.map_err(|error| unreadable(job.id, &error))?;
    successor(&shared, &job, document, key).await
}

/// Continue a job from its end.
///
/// A new job begins at the last time of the trajectory with the states reached then, velocities included; active
/// sets, contacts and regions are determined anew. The results must contain the columns of all states.
#[utoipa::path(
    post,
    path = "/jobs/{id}/continue",
    tag = "jobs",
    params(
        ("id" = String, Path, description = "The id of a job, from `Location`"),
        ("idempotency-key" = Option<String>, Header, description = "The same key and end give the same new job")
    ),
    request_body(content = Further, content_type = "application/json"),
    responses(
        Successor,
        Problem
    )
)]
pub async fn continue_job(
    State(shared): State<Shared>,
    JobPath(job): JobPath,
    key: IdempotencyKey,
    further: Document,
) -> HandlerResult<Response> {
    let ended = ended(&job)?;
    let Further { end } =
        serde_json::from_slice(&further.bytes()).map_err(|error| wrong("", "invalid_value", &error))?;
    let no_end = || refused(job.id, "it has no results");
    let held = ended.held.as_ref().ok_or_else(no_end)?;
    let results = shared.jobs.results(&job, held).await.map_err(|error| unreadable(job.id, &error))?;
    let document = shared.jobs.document(&job).await.map_err(|error| unreadable(job.id, &error))?;
    let (id, large) = (job.id, results.bytes() + document.len() > SHORT);
    let read = run_blocking(&shared, job.client, large, move || last_row(&results)).await?;
    let (start, ends) = match read {
        Ok(Some(last)) => last,
        Ok(None) => {
            // If the results have no trajectory, the job has a type of problem that cannot be continued, or was
            // stopped before its first step.
            let why =
                continued(&document, end, end, |_| None).err().filter(|why| matches!(why, NotContinuable::Problem(_)));
            return Err(refused(id, &why.map_or_else(|| "its trajectory is empty".to_owned(), |why| why.to_string())));
        }
        Err(error) => {
            shared.jobs.found(&job, &error).await;
            return Err(unreadable(id, &error));
        }
    };
    if end <= start {
        let detail = format!("the job ended at t = {start:?}, and `end` is {end:?}");
        return Err(wrong("/end", "end_before_start", &detail));
    }
    let work = move || {
        let last = |name: &str| ends.get(name).copied();
        continued(&document, start, end, last).map_err(|why: NotContinuable| refused(id, &why.to_string()))
    };
    let document = run_blocking(&shared, job.client, large, work).await??;
    successor(&shared, &job, document.into(), key).await.map_err(|problem| no_start(id, problem))
}

/// Returns the last time of a trajectory, and the values of its fields at that time; `None` if the trajectory is
/// empty.
fn last_row(results: &Results) -> io::Result<Option<(f64, HashMap<String, f64>)>> {
    let columns = results.open()?.columns;
    let last = |column| columns.values(column, Rows::last(columns.rows())).map(|mut values| values.pop());
    let names = columns.names().into_iter().map(str::to_owned).enumerate();
    let values = names.map(|(field, name)| Ok(last(field + 1)?.map(|value| (name, value))));
    let values = values.filter_map(io::Result::transpose).collect::<io::Result<_>>()?;
    Ok(last(0)?.map(|time| (time, values)))
}

fn ended(job: &Job) -> HandlerResult<Arc<Ended>> {
    match job.state() {
        JobState::Ended(ended) => Ok(ended),
        JobState::Accepted(_) | JobState::Running { .. } => Err(Problem::plain(Kind::NotEnded).of_job(job.id)),
    }
}

fn refused(job: JobId, why: &str) -> Box<Problem> {
    Problem::new(Kind::NotContinuable, format!("the job cannot be continued: {why}")).of_job(job)
}

/// Turns the errors of a continued specification into the problem that the job cannot be continued: the client did
/// not write that specification, whose initial values are the states at the end of the job.
fn no_start(job: JobId, problem: Box<Problem>) -> Box<Problem> {
    match problem.errors() {
        [] => problem,
        [error, rest @ ..] => {
            let more = if rest.is_empty() { String::new() } else { format!(" (and {} more)", rest.len()) };
            let Finding { pointer, detail, .. } = error;
            refused(job, &format!("its end is no start of the same specification: {pointer}: {detail}{more}"))
        }
    }
}

fn wrong(pointer: &str, code: &'static str, detail: &impl ToString) -> Box<Problem> {
    let expected = Some("`{\"end\": T}` with a time after the end of the job".to_owned());
    let (pointer, detail) = (pointer.to_owned(), detail.to_string());
    vec![Finding { pointer, code: code.into(), detail, expected, did_you_mean: None }].into()
}

/// Creates the new job of a retry or continuation. Its idempotency key is bound to the original job and the new
/// specification.
async fn successor(shared: &Shared, job: &Job, document: Arc<[u8]>, key: IdempotencyKey) -> HandlerResult<Response> {
    let key = key.0.map(|name| Key::new(name, &[job.id.to_string().as_bytes(), &document].concat()));
    let next = job_under(shared, job.client, key, &Document::of(document), true, true).await?;
    let mut response = accepted(&shared.jobs, &next);
    if let Ok(link) =
        HeaderValue::try_from(format!("<{}>; rel=\"predecessor-version\"", address(format_args!("/jobs/{}", job.id))))
    {
        response.headers_mut().insert(header::LINK, link);
    }
    Ok(response)
}
