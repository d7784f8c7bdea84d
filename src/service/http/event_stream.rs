//! The body of a stream of server-sent events (WHATWG HTML, section 9.2, `text/event-stream`).
//!
//! Writes wait until the client takes the data: a slow client delays its own stream and uses no more memory.

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

/// The media type of a stream of server-sent events.
pub const MEDIA_TYPE: MediaType = ("text", "event-stream");

/// The number of pieces of a stream that are buffered for the client.
const IN_FLIGHT: usize = 4;

/// The time after which a client that takes no data of a stream is considered disconnected.
const WRITE_TIMEOUT: Duration = Duration::from_secs(60);

/// The error that the client of a stream has disconnected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gone;

/// A server-sent event.
#[derive(ToSchema)]
pub struct ServerSentEvent {
    /// The type of the event: `progress`, `switch` and `done` of a job; of a solve also `result` or `problem`.
    event: String,
    /// The id of the event, which a client that reconnects sends as `Last-Event-ID`.
    id: String,
    /// The data of the event: JSON, in one line.
    data: String,
}

/// The writing end of a stream of server-sent events.
pub struct EventSink(Sender<Bytes>);

/// Creates a stream of server-sent events: its writing end, and the response that sends it.
pub fn event_stream() -> (EventSink, Response) {
    let (sender, receiver) = channel(IN_FLIGHT);
    let mut response = Body::new(Stream(receiver)).into_response();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("text/event-stream"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    // The header asks proxies not to buffer the stream.
    headers.insert("x-accel-buffering", HeaderValue::from_static("no"));
    (EventSink(sender), response)
}

impl fmt::Display for ServerSentEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "event: {}\nid: {}\ndata: {}\n\n", self.event, self.id, self.data)
    }
}

impl EventSink {
    /// Writes an event; a client that reconnects sends `id` as `Last-Event-ID`.
    ///
    /// # Errors
    /// The client has disconnected.
    pub async fn event(&self, name: &str, id: u64, data: &impl Serialize) -> Result<(), Gone> {
        // Events of a job can always be encoded, as one line of JSON.
        let data = serde_json::to_string(data).unwrap_or_default();
        self.write(ServerSentEvent { event: name.to_owned(), id: id.to_string(), data }.to_string()).await
    }

    /// Begins an event whose data, one line, are written in pieces.
    ///
    /// # Errors
    /// The client has disconnected.
    pub async fn begin(&self, name: &str, id: u64) -> Result<(), Gone> {
        self.write(format!("event: {name}\nid: {id}\ndata: ")).await
    }

    /// Writes a piece of the data of the event that was begun.
    ///
    /// # Errors
    /// The client has disconnected.
    pub async fn data(&self, piece: Bytes) -> Result<(), Gone> {
        self.write(piece).await
    }

    /// Ends the event begun by [`EventSink::begin`].
    ///
    /// # Errors
    /// The client has disconnected.
    pub async fn end(&self) -> Result<(), Gone> {
        self.write("\n\n").await
    }

    /// Writes a comment, which clients ignore, so that no proxy closes the connection as idle.
    ///
    /// # Errors
    /// The client has disconnected.
    pub async fn keep_alive(&self) -> Result<(), Gone> {
        self.write(":\n\n").await
    }

    /// Waits until the client of the event stream disconnects.
    pub async fn gone(&self) {
        self.0.closed().await;
    }

    async fn write(&self, piece: impl Into<Bytes>) -> Result<(), Gone> {
        self.0.send_timeout(piece.into(), WRITE_TIMEOUT).await.map_err(|_| Gone)
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
