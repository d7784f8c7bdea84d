//! Extraction of the variable segment of a request path: a name, or the id of a job.

use super::Shared;
use super::access::Visibility;
use super::problem::{Kind, Problem};
use crate::jobs::{Job, JobId};
use axum::extract::{FromRequestParts, RawPathParams};
use axum::http::request::Parts;
use std::convert::Infallible;
use std::sync::Arc;

/// The variable segment of a request path; empty, which names nothing, if it is not UTF-8.
pub struct Segment(pub String);

impl<S: Send + Sync> FromRequestParts<S> for Segment {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Infallible> {
        let segments = RawPathParams::from_request_parts(parts, state).await;
        let first = segments.ok().and_then(|segments| segments.iter().next().map(|(_, value)| value.to_owned()));
        Ok(Self(first.unwrap_or_default()))
    }
}

/// The job that the request path names, if the client may access it.
pub struct JobPath(pub Arc<Job>);

impl FromRequestParts<Shared> for JobPath {
    type Rejection = Box<Problem>;

    async fn from_request_parts(parts: &mut Parts, shared: &Shared) -> Result<Self, Self::Rejection> {
        let Ok(Segment(text)) = Segment::from_request_parts(parts, shared).await;
        let Ok(id) = text.parse::<JobId>() else {
            return Err(Problem::new(Kind::NoSuchJob, "the id of a job must be a UUID, from `Location`"));
        };
        let Ok(visibility) = Visibility::from_request_parts(parts, shared).await;
        let job = shared.jobs.look_up(id).await?.filter(|job| visibility.reaches(job));
        let missing = || if shared.jobs.is_damaged(id) { Kind::Damaged } else { Kind::NoSuchJob };
        job.map(Self).ok_or_else(|| Problem::plain(missing()).of_job(id))
    }
}
