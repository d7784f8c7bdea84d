//! `GET /jobs/{id}/results`.
//!
//! A solve that failed or was stopped has results all the same: the trajectory so far, with `status` and `error`
//! that say so. A problem is answered only where there is no solution at all.

use super::jobs::unreadable;
use super::path::Named;
use super::problem::{Answer, Kind, Problem};
use super::representation::Representation;
use super::{Shared, no_store};
use crate::service::jobs::{self, Ended, Ending, Job, Timing};
use axum::extract::State;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};

/// Fetch the results of a job.
pub async fn find_results(
    State(shared): State<Shared>,
    Named(job): Named,
    representation: Representation,
) -> Answer<Response> {
    let jobs::State::Ended(ended) = job.state() else {
        let time = shared.jobs.time_to_end(&job);
        return Err(Problem::plain(Kind::ResultsNotReady).of_job(job.id).after(time));
    };
    let mut response = represent(&shared, &job, &ended, representation).await?;
    response.headers_mut().insert(header::VARY, HeaderValue::from_static("accept"));
    Ok(response)
}

/// The results of a job that has ended, with the time it waited and the time it took.
pub async fn represent(shared: &Shared, job: &Job, ended: &Ended, representation: Representation) -> Answer<Response> {
    let Some(held) = &ended.held else {
        return Err(match &ended.ending {
            Ending::Broken(fault) => Box::<Problem>::from(*fault),
            Ending::Successful | Ending::Failed(_) | Ending::Dismissed => Problem::plain(Kind::Dismissed),
        }
        .of_job(job.id));
    };
    let results = shared.jobs.results(job, held).await.map_err(|error| unreadable(job, &error))?;
    let mut response = (no_store(), representation.body(job, results, shared).await?).into_response();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, representation.content_type());
    if let Some(timing) = ended.timing.and_then(server_timing) {
        headers.insert("server-timing", timing);
    }
    Ok(response)
}

fn server_timing(timing: Timing) -> Option<HeaderValue> {
    let (queue, solve) = (timing.queue.as_secs_f64() * 1e3, timing.solve.as_secs_f64() * 1e3);
    HeaderValue::try_from(format!("queue;dur={queue:.3}, solve;dur={solve:.3}")).ok()
}
