//! `GET /jobs/{id}/results`.
//!
//! A solve that failed or was stopped has results all the same: the trajectory so far, with `status` and `error`
//! that say so. A problem is answered only where there is no solution at all.

use super::path::Named;
use super::problem::{Answer, Kind, Problem};
use super::representation::Representation;
use super::{Shared, no_store};
use crate::service::jobs::{self, Ending, Job};
use axum::extract::State;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use std::time::Duration;

/// Fetch the results of a job.
pub async fn find_results(
    State(shared): State<Shared>,
    Named(job): Named,
    representation: Representation,
) -> Answer<Response> {
    let jobs::State::Ended { ending, .. } = job.state() else {
        let time = shared.jobs.time_to_end(&job);
        return Err(Problem::plain(Kind::ResultsNotReady).of_job(job.id).after(time));
    };
    let mut response = represent(&shared, &job, ending, representation).await?;
    response.headers_mut().insert(header::VARY, HeaderValue::from_static("accept"));
    Ok(response)
}

/// The results of a job that has ended, with the time it waited and the time it took.
pub async fn represent(shared: &Shared, job: &Job, ending: Ending, representation: Representation) -> Answer<Response> {
    let results = match ending {
        Ending::Successful(results) | Ending::Failed(results) | Ending::Dismissed(Some(results)) => results,
        Ending::Broken(fault) => return Err(Box::<Problem>::from(fault).of_job(job.id)),
        Ending::Dismissed(None) => return Err(Problem::plain(Kind::Dismissed).of_job(job.id)),
    };
    let mut response = (no_store(), representation.body(job, results, shared).await?).into_response();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, representation.content_type());
    if let Some(timing) = server_timing(job) {
        headers.insert("server-timing", timing);
    }
    Ok(response)
}

fn server_timing(job: &Job) -> Option<HeaderValue> {
    let jobs::State::Ended { started: Some(started), finished, .. } = job.state() else { return None };
    let milliseconds = |time: Duration| time.as_secs_f64() * 1e3;
    let queue = milliseconds(started.clock.saturating_duration_since(job.created.clock));
    let solve = milliseconds(finished.clock.saturating_duration_since(started.clock));
    HeaderValue::try_from(format!("queue;dur={queue:.3}, solve;dur={solve:.3}")).ok()
}
