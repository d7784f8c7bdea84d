//! The forms in which results are given.

use super::Shared;
use super::negotiation::{MediaType, choose};
use super::part::Part;
use super::problem::{Answer, Kind, Problem};
use crate::jobs::{Client, Job, Refusal, Results};
use axum::body::{Body, Bytes, HttpBody};
use axum::extract::FromRequestParts;
use axum::http::HeaderValue;
use axum::http::request::Parts;
use hyper::body::Frame;
use solution::Excerpt;
use solution::encodings::{Arrow, Csv, Lines, Table, write_piece};
use solution::pictures::write_svg;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use tokio::task::spawn_blocking;

/// A form of the results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Representation {
    /// All of the solution; the only one with the whole verdict, beside the metadata of Arrow.
    Json,
    /// The trajectory as a table.
    Csv,
    /// The trajectory as objects, one a line.
    Lines,
    /// The trajectory as columns for programs.
    Arrow,
    /// The trajectory as a picture.
    Svg,
}

impl Representation {
    /// All with their media types, in the order of preference of the service.
    pub const OFFERED: [(Self, MediaType); 5] = [
        (Self::Json, ("application", "json")),
        (Self::Csv, ("text", "csv")),
        (Self::Lines, ("application", "x-ndjson")),
        (Self::Arrow, ("application", "vnd.apache.arrow.stream")),
        (Self::Svg, ("image", "svg+xml")),
    ];

    /// The value of `Content-Type`.
    pub fn content_type(self) -> HeaderValue {
        HeaderValue::from_static(match self {
            Self::Json => "application/json",
            Self::Csv => "text/csv; charset=utf-8; header=present",
            Self::Lines => "application/x-ndjson",
            Self::Arrow => "application/vnd.apache.arrow.stream",
            Self::Svg => "image/svg+xml",
        })
    }

    /// The results of `job`, or an excerpt of them, in this form. The JSON of the whole has been written already; a
    /// table is written as the client takes it.
    ///
    /// # Errors
    /// [`Kind::BadQuery`] if the excerpt names a field that is not there, [`Kind::Internal`] if a thread was lost,
    /// [`Kind::Unreadable`] if what was stored is not a solution.
    pub async fn body(
        self,
        job: &Job,
        results: Arc<Results>,
        excerpt: Option<Excerpt>,
        shared: &Shared,
    ) -> Answer<Body> {
        if self == Self::Json && excerpt.is_none() {
            return Ok(Body::from(Bytes::from_owner(JsonOf(results))));
        }
        let large = results.json().len() > SHORT;
        let id = job.id;
        let part = aside(shared, job.client, large, move || Part::of(id, results, excerpt.as_ref())).await??;
        let table: Box<dyn Table> = match self {
            Self::Json => return Ok(Body::from(aside(shared, job.client, large, move || part.json()).await?)),
            Self::Svg => {
                let label = job.label.clone();
                return Ok(Body::from(
                    aside(shared, job.client, large, move || picture(&part, label.as_deref())).await?,
                ));
            }
            Self::Csv => Box::new(Csv),
            Self::Lines => Box::new(Lines),
            Self::Arrow => Box::new(part.solution().map(|part| Arrow::with(&part.verdict)).unwrap_or_default()),
        };
        Ok(Body::new(Rows { part, table, next: Some(0) }))
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Representation {
    type Rejection = Box<Problem>;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Self::Rejection> {
        choose(&parts.headers, &Self::OFFERED).ok_or_else(|| Problem::plain(Kind::NotAcceptable))
    }
}

/// Results whose JSON is no longer are worked on where the connection is served, within a fraction of a millisecond.
pub const SHORT: usize = 64 << 10;

/// Does work on results; on large ones on a thread of its own, few at a time and the clients in turn.
pub async fn aside<T: Send + 'static>(
    shared: &Shared,
    client: Client,
    large: bool,
    work: impl FnOnce() -> T + Send + 'static,
) -> Answer<T> {
    if !large {
        return Ok(work());
    }
    let turn = shared.turns.turn(client, 0).await.map_err(Refusal::from)?;
    let work = move || {
        let _turn = turn;
        work()
    };
    // The work does not panic; if it did, that would be ours to answer for.
    spawn_blocking(work).await.map_err(|_| Problem::plain(Kind::Internal))
}

fn picture(part: &Part, label: Option<&str>) -> Vec<u8> {
    let mut text = Vec::new();
    if let Some(solution) = part.solution() {
        // Writing to memory does not fail.
        let _ = write_svg(solution, label, &mut text);
    }
    text
}

/// The JSON of results, not copied.
struct JsonOf(Arc<Results>);

impl AsRef<[u8]> for JsonOf {
    fn as_ref(&self) -> &[u8] {
        self.0.json()
    }
}

/// A table, some rows at a time: a large one neither holds up a thread nor stands in memory twice.
struct Rows {
    part: Part,
    table: Box<dyn Table>,
    /// The next row, while there is more.
    next: Option<usize>,
}

impl HttpBody for Rows {
    type Data = Bytes;
    type Error = io::Error;

    fn poll_frame(mut self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<Option<io::Result<Frame<Bytes>>>> {
        let Self { part, table, next } = &mut *self;
        let (Some(row), Some(solution)) = (next.take(), part.solution()) else { return Poll::Ready(None) };
        let mut bytes = Vec::new();
        let written = write_piece(&mut **table, &solution.trajectory, row, &mut bytes);
        Poll::Ready(Some(written.map(|rest| {
            *next = rest;
            Frame::data(bytes.into())
        })))
    }
}
