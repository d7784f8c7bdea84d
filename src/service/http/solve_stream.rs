//! `POST /solve` with `Accept: text/event-stream`: the events of the job, then `result` with the whole solution as
//! JSON, or `problem` if there is no solution.

use super::Shared;
use super::event_stream::{EventSink, Gone, MEDIA_TYPE, event_stream};
use super::events::{follow, place};
use super::negotiation::{MediaType, choose};
use super::problem::{HandlerResult, Kind, Problem};
use super::representation::Representation;
use super::results::represent;
use super::solve::AbandonGuard;
use crate::context::Context;
use crate::jobs::{self, Client, Job};
use axum::body::HttpBody;
use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::response::Response;
use std::future::poll_fn;
use std::pin::Pin;
use std::sync::Arc;
use tracing::Instrument;

/// The form in which the client wants the results of a solve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// The client wants the results in one response, in this format.
    Whole(Representation),
    /// The client wants a stream of server-sent events, of which the last has the results.
    Stream,
}

impl<S: Send + Sync> FromRequestParts<S> for Delivery {
    type Rejection = Box<Problem>;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Self::Rejection> {
        let mut offered: Vec<(Self, MediaType)> =
            Representation::OFFERED.iter().map(|(form, media_type)| (Self::Whole(*form), *media_type)).collect();
        offered.push((Self::Stream, MEDIA_TYPE));
        choose(&parts.headers, &offered).ok_or_else(|| Problem::plain(Kind::NotAcceptable))
    }
}

/// Returns the response with the event stream of a new job; the job is deleted if its client disconnects.
///
/// # Errors
/// [`Kind::TooManyStreams`] if the largest number of streams is open.
pub fn stream(shared: Shared, client: Client, job: Arc<Job>) -> HandlerResult<Response> {
    let guard = AbandonGuard::watch(Arc::clone(&shared.jobs), Arc::clone(&job));
    let place = place(&shared)?;
    let (sink, response) = event_stream();
    let told = async move {
        if tell(&shared, client, &job, &sink).await.is_ok() {
            guard.disarm();
        }
        drop(place);
    };
    tokio::spawn(Context::current().around(told).in_current_span());
    Ok(response)
}

async fn tell(shared: &Shared, client: Client, job: &Arc<Job>, sink: &EventSink) -> Result<(), Gone> {
    let Some(seen) = follow(shared, client, job, 0, sink).await? else { return Ok(()) };
    let jobs::State::Ended(ended) = job.state() else { return Ok(()) };
    let mut body = match represent(shared, job, &ended, Representation::Json, None).await {
        Ok(response) => response.into_body(),
        Err(problem) => return sink.event("problem", seen, &problem).await,
    };
    sink.begin("result", seen).await?;
    while let Some(Ok(frame)) = poll_fn(|context| Pin::new(&mut body).poll_frame(context)).await {
        if let Ok(data) = frame.into_data() {
            sink.data(data).await?;
        }
    }
    sink.end().await
}
