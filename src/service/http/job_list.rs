//! `GET /jobs`: the jobs of the client, or of all clients for an administrator, newest first, one page at a time. The
//! total number is not given: counting would visit every job, and the number would be outdated at once.

use super::access::Visibility;
use super::problem::{HandlerResult, Problem};
use super::query::Query;
use super::status::StatusInfo;
use super::{Shared, no_store};
use crate::context::address;
use crate::jobs::JobId;
use axum::Json;
use axum::extract::{FromRequestParts, State};
use axum::http::request::Parts;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use form_urlencoded::Serializer;
use serde::Serialize;
use std::cmp::Reverse;
use utoipa::ToSchema;

const STATUSES: [&str; 5] = ["accepted", "running", "successful", "failed", "dismissed"];
const DEFAULT_LIMIT: usize = 100;
const MOST: usize = 1000;

/// The query of a list of jobs: status, label and page.
#[derive(Clone, Debug, PartialEq)]
pub struct Filter {
    status: Option<String>,
    label: Option<String>,
    limit: usize,
    /// The last job of the previous page of the list.
    cursor: Option<JobId>,
}

/// A page of the list of jobs.
#[derive(Debug, Serialize, ToSchema)]
pub struct JobList {
    /// The jobs of the page, newest first.
    jobs: Vec<StatusInfo>,
}

/// List your jobs, newest first.
///
/// The jobs of the client, identified by its token or else its address, including ended jobs as long as they are
/// kept. `Link` has the URL of the next page, if there is one.
#[utoipa::path(
    get,
    path = "/jobs",
    tag = "jobs",
    params(
        ("status" = Option<String>, Query, description = "`accepted`, `running`, `successful`, `failed` or `dismissed`"),
        ("label" = Option<String>, Query, description = "The complete label"),
        ("limit" = Option<u64>, Query, minimum = 1, maximum = 1000, description = "The number of jobs per page, 100 by \
                                                                                   default"),
        ("cursor" = Option<String>, Query, description = "The cursor in `Link` of the previous page")
    ),
    responses((status = 200, description = "A page of jobs; `Link` has the address of the next", body = JobList), Problem)
)]
pub async fn list_jobs(State(shared): State<Shared>, visibility: Visibility, filter: Filter) -> Response {
    let mut jobs = shared.jobs.all();
    jobs.retain(|job| visibility.reaches(job));
    jobs.sort_unstable_by_key(|job| Reverse(job.id));
    let rest = jobs.iter().filter(|job| filter.cursor.is_none_or(|last| job.id < last));
    let named = rest.filter(|job| filter.label.is_none() || job.label == filter.label);
    let told = named.map(|job| (job.id, StatusInfo::of(job, &shared.jobs)));
    let mut found = told.filter(|(_, told)| filter.status.as_deref().is_none_or(|status| told.status() == status));
    let page: Vec<(JobId, StatusInfo)> = found.by_ref().take(filter.limit).collect();
    let next = page.last().map(|(last, _)| *last).filter(|_| found.next().is_some());
    let jobs = page.into_iter().map(|(_, told)| told).collect();
    let mut response = (no_store(), Json(JobList { jobs })).into_response();
    if let Some(link) = next.and_then(|last| HeaderValue::try_from(filter.link(last)).ok()) {
        response.headers_mut().insert(header::LINK, link);
    }
    response
}

impl Filter {
    /// Returns the value of the header `Link` for the page of jobs after `last`.
    fn link(&self, last: JobId) -> String {
        let mut query = Serializer::new(String::new());
        for (name, value) in [("status", &self.status), ("label", &self.label)] {
            if let Some(value) = value {
                query.append_pair(name, value);
            }
        }
        query.append_pair("limit", &self.limit.to_string()).append_pair("cursor", &last.to_string());
        format!("<{}>; rel=\"next\"", address(format_args!("/jobs?{}", query.finish())))
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Filter {
    type Rejection = Box<Problem>;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> HandlerResult<Self> {
        let Ok(mut query) = Query::from_request_parts(parts, state).await;
        let within = format_args!("a whole number from 1 to {MOST}").to_string();
        let filter = Self {
            status: query
                .checked("status", STATUSES.join(", "), |text| STATUSES.contains(&text).then(|| text.to_owned())),
            label: query.text("label"),
            limit: query
                .checked("limit", within, |text| text.parse().ok().filter(|limit| (1..=MOST).contains(limit)))
                .unwrap_or(DEFAULT_LIMIT),
            cursor: query.value("cursor", "the cursor in `Link`"),
        };
        query.end()?;
        Ok(filter)
    }
}
