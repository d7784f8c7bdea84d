//! `GET /jobs/{id}/events`: the progress of a job, as server-sent events.
//!
//! - `progress`: the status of the job, whenever it has changed;
//! - `switch`: an event of the trajectory, `{number, t, kind, of}`; while the job runs, only the latest events are
//!   kept, and a gap in the numbers means that the reader was too slow for some (the results contain all);
//! - `done`: the final status of the job, with the verdict on its solution; the last event.
//!
//! The id of an event is the number of `switch` events sent so far, so that `Last-Event-ID` resumes after the last of
//! them. A stream that ends without `done` was ended because the service stops, or because the token of its client is
//! no longer valid.

use super::Shared;
use super::event_stream::{EventSink, Gone, ServerSentEvent, event_stream};
use super::path::JobPath;
use super::problem::{HandlerResult, Kind, Problem};
use super::status::StatusInfo;
use crate::context::Context;
use crate::jobs::{self, Client, Job};
use axum::extract::{FromRequestParts, State};
use axum::http::request::Parts;
use axum::response::Response;
use problem::{Control, Event};
use serde::Serialize;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::{Instant, MissedTickBehavior, interval};
use tracing::Instrument;

/// The interval between two polls of the status of a job whose events are streamed to a client.
const POLL_INTERVAL: Duration = Duration::from_millis(200);

/// The longest time without data on a stream: proxies commonly close a connection after half a minute or a minute of
/// silence.
const SILENCE: Duration = Duration::from_secs(15);

/// Follow the progress of a job.
///
/// Server-sent events: `progress` with the time reached and the number of steps, `switch` for every change of an
/// active set, a contact or a region, and `done` with the final status of the job, after which the stream ends. A
/// client that reconnects with `Last-Event-ID` gets the events that follow.
#[utoipa::path(
    get,
    path = "/jobs/{id}/events",
    tag = "jobs",
    params(
        ("id" = String, Path, description = "The id of a job, from `Location`"),
        ("last-event-id" = Option<String>, Header, description = "The number of switches reported before")
    ),
    responses(
        (status = 200, description = "Events `progress`, `switch` and `done`", body = ServerSentEvent, content_type = "text/event-stream"),
        Problem
    )
)]
pub async fn follow_job(
    State(shared): State<Shared>,
    client: Client,
    JobPath(job): JobPath,
    LastEventId(seen): LastEventId,
) -> HandlerResult<Response> {
    let place = place(&shared)?;
    let (sink, response) = event_stream();
    let told = async move {
        // It is not an error if the client disconnects before the end of the event stream.
        let _ = follow(&shared, client, &job, seen, &sink).await;
        drop(place);
    };
    tokio::spawn(Context::current().around(told).in_current_span());
    Ok(response)
}

/// Returns a permit for one more event stream.
///
/// # Errors
/// [`Kind::TooManyStreams`] if the largest number of streams is open.
pub fn place(shared: &Shared) -> HandlerResult<OwnedSemaphorePermit> {
    let taken = Arc::clone(&shared.streams).try_acquire_owned();
    taken.map_err(|_| Problem::plain(Kind::TooManyStreams).after(Duration::from_secs(10)))
}

/// Sends the events of a job, from the `switch` event after number `seen` to its end. Returns the number of the last
/// `switch` event sent; `None` if the stream ended before the job.
///
/// # Errors
/// The client has disconnected.
pub async fn follow(
    shared: &Shared,
    client: Client,
    job: &Job,
    seen: u64,
    sink: &EventSink,
) -> Result<Option<u64>, Gone> {
    let mut followed = Followed { seen, ..Followed::default() };
    let mut closing = shared.closing.subscribe();
    let closed = async move { closing.wait_for(|closing| *closing).await.is_ok() };
    let mut looks = interval(POLL_INTERVAL);
    looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let settled = job.settled();
    tokio::pin!(settled, closed);
    loop {
        tokio::select! {
            biased;
            () = sink.gone() => return Err(Gone),
            ended = &mut settled => match ended {
                Some(_) => break,
                // The job was parked at the stop of the service, for the next process to continue; the stream ends
                // without an end of the job.
                None => return Ok(None),
            },
            _ = &mut closed => return Ok(None),
            _ = looks.tick() => {
                if !shared.admits(client) {
                    return Ok(None);
                }
                followed.look(shared, job, sink).await?;
            }
        }
    }
    followed.switches(sink).await?;
    sink.event("done", followed.seen, &StatusInfo::of(job, &shared.jobs)).await?;
    Ok(Some(followed.seen))
}

/// The state of an event stream: what has been sent to the client.
#[derive(Default)]
struct Followed {
    seen: u64,
    /// The control of the solve, from the first poll that finds the job running; keeps the events until the end.
    control: Option<Arc<Control>>,
    status: Option<StatusInfo>,
    last: Option<Instant>,
}

impl Followed {
    async fn look(&mut self, shared: &Shared, job: &Job, sink: &EventSink) -> Result<(), Gone> {
        self.control = job.control().or(self.control.take());
        // In its first time slice, a job may yet be stopped and started again, which repeats its events. They are
        // sent only once the job is sure to keep its worker.
        if matches!(job.state(), jobs::State::Running { .. }) {
            self.switches(sink).await?;
        }
        let status = StatusInfo::of(job, &shared.jobs);
        if self.status.as_ref() != Some(&status) {
            self.last = Some(Instant::now());
            sink.event("progress", self.seen, &status).await?;
            self.status = Some(status);
        } else if self.last.is_none_or(|last| last.elapsed() >= SILENCE) {
            self.last = Some(Instant::now());
            sink.keep_alive().await?;
        }
        Ok(())
    }

    async fn switches(&mut self, sink: &EventSink) -> Result<(), Gone> {
        let Some(control) = &self.control else { return Ok(()) };
        for (number, event) in control.events_after(self.seen) {
            self.seen = number;
            sink.event("switch", number, &Numbered { number, event: &event }).await?;
        }
        Ok(())
    }
}

/// An event of the trajectory, with its number, as it is sent on the stream.
#[derive(Serialize)]
struct Numbered<'a> {
    number: u64,
    #[serde(flatten)]
    event: &'a Event,
}

/// The number of `switch` events that the client has received earlier; zero if the header is absent or invalid.
pub struct LastEventId(pub u64);

impl<S: Send + Sync> FromRequestParts<S> for LastEventId {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        let given = parts.headers.get("last-event-id").and_then(|id| id.to_str().ok()?.trim().parse().ok());
        Ok(Self(given.unwrap_or(0)))
    }
}
