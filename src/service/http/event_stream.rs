//! The body of a stream of server-sent events (WHATWG HTML, section 9.2, `text/event-stream`).
//!
//! What is written waits for the client to take it: a slow one holds up its own stream and costs no memory.

use super::negotiation::MediaType;
use axum::body::{Body, Bytes, HttpBody};
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use hyper::body::Frame;
use serde::Serialize;
use std::convert::Infallible;
use std::fmt;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::sync::mpsc::{Receiver, Sender, channel};
use utoipa::ToSchema;

/// The media type.
pub const MEDIA_TYPE: MediaType = ("text", "event-stream");

/// Pieces on their way to the client.
const IN_FLIGHT: usize = 4;

/// A client that takes nothing for so long has gone.
const PATIENCE: Duration = Duration::from_secs(60);

/// The client has gone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gone;

/// An event, by its fields.
#[derive(ToSchema)]
pub struct ServerSentEvent {
    /// `progress`, `switch` and `done` of a job; of a solve also `result` or `problem`.
    event: String,
    /// What a client that comes back gives as `Last-Event-ID`.
    id: String,
    /// JSON, in one line.
    data: String,
}

/// Where events are written.
pub struct EventSink(Sender<Bytes>);

/// A stream, and its answer.
pub fn event_stream() -> (EventSink, Response) {
    let (sender, receiver) = channel(IN_FLIGHT);
    let mut response = Body::new(Stream(receiver)).into_response();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("text/event-stream"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    // Proxies that gather answers before they pass them on would hold the stream back.
    headers.insert("x-accel-buffering", HeaderValue::from_static("no"));
    (EventSink(sender), response)
}

impl fmt::Display for ServerSentEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "event: {}\nid: {}\ndata: {}\n\n", self.event, self.id, self.data)
    }
}

impl EventSink {
    /// Writes an event; `id` is what a client that comes back gives as `Last-Event-ID`.
    ///
    /// # Errors
    /// The client has gone.
    pub async fn event(&self, name: &str, id: u64, data: &impl Serialize) -> Result<(), Gone> {
        // What is told has a JSON form, which is one line.
        let data = serde_json::to_string(data).unwrap_or_default();
        self.write(ServerSentEvent { event: name.to_owned(), id: id.to_string(), data }.to_string()).await
    }

    /// Begins an event whose data comes in pieces of one line.
    ///
    /// # Errors
    /// The client has gone.
    pub async fn begin(&self, name: &str, id: u64) -> Result<(), Gone> {
        self.write(format!("event: {name}\nid: {id}\ndata: ")).await
    }

    /// Writes a piece of that line.
    ///
    /// # Errors
    /// The client has gone.
    pub async fn data(&self, piece: Bytes) -> Result<(), Gone> {
        self.write(piece).await
    }

    /// Ends the event that was begun.
    ///
    /// # Errors
    /// The client has gone.
    pub async fn end(&self) -> Result<(), Gone> {
        self.write("\n\n").await
    }

    /// Writes what clients pass over, so that nobody on the way takes the connection for dead.
    ///
    /// # Errors
    /// The client has gone.
    pub async fn keep_alive(&self) -> Result<(), Gone> {
        self.write(":\n\n").await
    }

    /// Returns when the client goes.
    pub async fn gone(&self) {
        self.0.closed().await;
    }

    async fn write(&self, piece: impl Into<Bytes>) -> Result<(), Gone> {
        self.0.send_timeout(piece.into(), PATIENCE).await.map_err(|_| Gone)
    }
}

struct Stream(Receiver<Bytes>);

impl HttpBody for Stream {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        self.0.poll_recv(context).map(|piece| piece.map(|piece| Ok(Frame::data(piece))))
    }
}
