//! `GET /jobs/{id}/results`: the results of a job, whole or as an excerpt.
//!
//! Results do not change, so that requests can be conditional (`ETag`, RFC 9110, section 13.1.2). The tag consists of
//! the digest of the results as JSON and a hash of the representation and the excerpt. It is a weak tag, since it
//! does not depend on the compression of the response.
//!
//! A solve that failed or was stopped has results as well: the trajectory up to the stop, with `status` and `error`.
//! The response is a problem only if there is no solution at all.
//!
//! `Dvi-Trusted` is `true` or `false` in every response with results, in any representation, since a table has no
//! place for the verdict.

use super::excerpt::ExcerptQuery;
use super::jobs::unreadable;
use super::path::JobPath;
use super::problem::{HandlerResult, Kind, Problem};
use super::representation::Representation;
use super::security::PICTURE;
use super::{Shared, no_store};
use crate::jobs::{self, Ended, Ending, Held, Job, Timing};
use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use solution::Excerpt;
use solution::Solution;
use std::hash::{DefaultHasher, Hash, Hasher};

/// The header that says whether the solution can be trusted, `true` or `false`.
const TRUSTED: HeaderName = HeaderName::from_static("dvi-trusted");

/// The header that says that the solution is that of an earlier request with the identical specification.
const REPEATED: HeaderName = HeaderName::from_static("dvi-repeated");

/// Fetch the results of a job.
///
/// The results in the format of `Accept` (JSON, CSV, JSON lines, an Arrow stream or a picture); whole, or some fields
/// and times only. The results of a job that failed or was cancelled extend to the time that it reached. `ETag` is a
/// digest of the results.
#[utoipa::path(
    get,
    path = "/jobs/{id}/results",
    tag = "jobs",
    params(
        ("id" = String, Path, description = "The id of a job, from `Location`"),
        ("fields" = Option<String>, Query, description = "Names, separated by commas"),
        ("from" = Option<f64>, Query, description = "The least time"),
        ("to" = Option<f64>, Query, description = "The greatest time"),
        ("every" = Option<u64>, Query, minimum = 1, format = "uint64", description = "Keep every n-th of the times \
                                                                                      within the interval")
    ),
    responses(
        (status = 200, description = "The results, in the media type of `Accept`", content(
            (Solution = "application/json"),
            (String = "text/csv"),
            (String = "application/x-ndjson"),
            (Vec<u8> = "application/vnd.apache.arrow.stream"),
            (String = "image/svg+xml"),
        ), headers(("dvi-trusted" = bool, description = "Whether the solution is trusted: `verdict.trusted` of the \
                                                         JSON"))),
        (status = 304, description = "The client has these results already, by its `If-None-Match`"),
        Problem
    )
)]
pub async fn find_results(
    State(shared): State<Shared>,
    JobPath(job): JobPath,
    representation: Representation,
    ExcerptQuery(excerpt): ExcerptQuery,
    headers: HeaderMap,
) -> HandlerResult<Response> {
    let jobs::State::Ended(ended) = job.state() else {
        let time = shared.jobs.time_to_end(&job);
        return Err(Problem::plain(Kind::ResultsNotReady).of_job(job.id).after(time));
    };
    let tag =
        ended.held.as_ref().filter(|_| !ended.damaged).map(|held| entity_tag(held, representation, excerpt.as_ref()));
    let mut response = if tag.as_ref().is_some_and(|tag| is_known(tag, &headers)) {
        StatusCode::NOT_MODIFIED.into_response()
    } else {
        represent(&shared, &job, &ended, representation, excerpt).await?
    };
    let headers = response.headers_mut();
    if let Some(Ok(tag)) = tag.map(HeaderValue::try_from) {
        headers.insert(header::ETAG, tag);
    }
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("private, no-cache"));
    headers.insert(header::VARY, HeaderValue::from_static("accept"));
    Ok(response)
}

/// Returns the entity tag of the uncompressed results of a job: their digest alone for the whole as JSON. For other
/// formats and excerpts, the tag includes the version of the program, since another version may format them
/// differently.
fn entity_tag(held: &Held, representation: Representation, excerpt: Option<&Excerpt>) -> String {
    let digest = held.digest();
    if representation == Representation::Json && excerpt.is_none() {
        return format!("W/\"{digest}\"");
    }
    let mut hasher = DefaultHasher::new();
    format!("{representation:?} {excerpt:?} {}", env!("CARGO_PKG_VERSION")).hash(&mut hasher);
    format!("W/\"{digest}-{:016x}\"", hasher.finish())
}

/// Whether the client already has the representation of `tag`, by its `If-None-Match`.
fn is_known(tag: &str, headers: &HeaderMap) -> bool {
    let opaque = |tag: &str| tag.trim().trim_start_matches("W/").to_owned();
    let lines = headers.get_all(header::IF_NONE_MATCH).iter().filter_map(|line| line.to_str().ok());
    lines.flat_map(|line| line.split(',')).any(|known| known.trim() == "*" || opaque(known) == opaque(tag))
}

/// Returns the response with the results of an ended job, and with the times that it waited and ran.
pub async fn represent(
    shared: &Shared,
    job: &Job,
    ended: &Ended,
    representation: Representation,
    excerpt: Option<Excerpt>,
) -> HandlerResult<Response> {
    if ended.damaged {
        return Err(Problem::plain(Kind::Damaged).of_job(job.id));
    }
    let Some(held) = &ended.held else {
        return Err(match &ended.ending {
            Ending::Broken(fault) => Box::<Problem>::from(*fault),
            Ending::Successful | Ending::Failed(_) | Ending::Dismissed => Problem::plain(Kind::Dismissed),
        }
        .of_job(job.id));
    };
    let results = shared.jobs.results(job, held).await.map_err(|error| unreadable(job.id, &error))?;
    let mut response = (no_store(), representation.body(job, results, excerpt, shared).await?).into_response();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, representation.content_type());
    if representation == Representation::Svg {
        headers.insert(header::CONTENT_SECURITY_POLICY, PICTURE);
    }
    if let Some(verdict) = &ended.verdict {
        headers.insert(TRUSTED, HeaderValue::from_static(if verdict.trusted { "true" } else { "false" }));
    }
    if ended.repeated {
        headers.insert(REPEATED, HeaderValue::from_static("true"));
    }
    if let Some(timing) = ended.timing.and_then(server_timing) {
        headers.insert("server-timing", timing);
    }
    Ok(response)
}

fn server_timing(timing: Timing) -> Option<HeaderValue> {
    let (queue, solve) = (timing.queue.as_secs_f64() * 1e3, timing.solve.as_secs_f64() * 1e3);
    HeaderValue::try_from(format!("queue;dur={queue:.3}, solve;dur={solve:.3}")).ok()
}
