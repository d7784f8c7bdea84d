//! A line of the log for every request, once its answer has gone out or its client has: who asked what, how it was answered,
//! how many bytes and how long it took. No query, no header and no body is in it, since they may hold what is nobody's
//! business.

use crate::context::Context;
use crate::jobs::{Client, JobId};
use axum::body::{Body, Bytes, HttpBody};
use axum::http::{Method, StatusCode};
use hyper::body::{Frame, SizeHint};
use std::pin::Pin;
use std::task::{Context as Waker, Poll};
use std::time::Instant;

/// What is known of a request before its answer has gone out.
pub struct Line {
    pub context: Context,
    pub client: Option<Client>,
    pub method: Method,
    pub path: String,
    pub status: StatusCode,
    /// The job that was accepted or answered.
    pub job: Option<JobId>,
    pub start: Instant,
}

/// A body that writes the line when it ends.
struct Logged {
    body: Body,
    line: Line,
    bytes: u64,
}

/// Whether lines are wanted.
pub fn is_on() -> bool {
    tracing::enabled!(target: "dvi::request", tracing::Level::INFO)
}

/// The body, which writes the line when it ends.
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
