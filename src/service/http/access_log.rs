//! The access log: one line per request, once its response has been sent or its client has gone, with client, method,
//! path, status, bytes and duration. Queries, headers and bodies are left out, since they may be confidential.

use crate::context::Context;
use crate::jobs::{Client, JobId};
use axum::body::{Body, Bytes, HttpBody};
use axum::http::{Method, StatusCode};
use hyper::body::{Frame, SizeHint};
use std::pin::Pin;
use std::task::{Context as Waker, Poll};
use std::time::Instant;

/// The properties of a request in the access log that are known before its response has been sent.
pub struct Line {
    pub context: Context,
    pub client: Option<Client>,
    pub method: Method,
    pub path: String,
    pub status: StatusCode,
    /// The job that the request created or that its path names.
    pub job: Option<JobId>,
    pub start: Instant,
}

/// A response body that writes the line of the access log when it is dropped.
struct Logged {
    body: Body,
    line: Line,
    bytes: u64,
}

/// Whether the access log is enabled.
pub fn is_on() -> bool {
    tracing::enabled!(target: "dvi::request", tracing::Level::INFO)
}

/// Wraps a response body, so that the line of the access log is written at its end.
pub fn logged(body: Body, line: Line) -> Body {
    Body::new(Logged { body, line, bytes: 0 })
}

impl Drop for Logged {
    fn drop(&mut self) {
        let Self { line: Line { context, client, method, path, status, job, start }, bytes, .. } = self;
        tracing::info!(
            target: "dvi::request",
            {
            request.id = &*context.request,
            trace.id = context.trace.map(tracing::field::display),
            job.id = job.map(tracing::field::display),
            client = client.map(tracing::field::display),
            http.method = %method,
            http.path = path,
            http.status = status.as_u16(),
            bytes,
            duration_ms = start.elapsed().as_secs_f64() * 1e3,
            },
            "{method} {path} {}",
            status.as_u16()
        );
    }
}

impl HttpBody for Logged {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(mut self: Pin<&mut Self>, waker: &mut Waker<'_>) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let polled = Pin::new(&mut self.body).poll_frame(waker);
        if let Poll::Ready(Some(Ok(frame))) = &polled
            && let Some(data) = frame.data_ref()
        {
            self.bytes += data.len() as u64;
        }
        polled
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
