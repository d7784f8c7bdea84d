//! The forms in which results are given, and the choice among them by `Accept` (RFC 9110, section 12.5.1): the most
//! specific range that fits a form gives its weight, and the form of the greatest weight is taken.

use super::Shared;
use super::jobs::unreadable;
use super::problem::{Answer, Kind, Problem};
use crate::service::jobs::{Job, Results};
use crate::solution::Solution;
use crate::solution::encodings::{write_csv_header, write_csv_rows};
use crate::solution::pictures::write_svg;
use axum::body::{Body, Bytes, HttpBody};
use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, header};
use hyper::body::Frame;
use std::convert::Infallible;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use tokio::task::spawn_blocking;

/// A form of the results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Representation {
    /// All of the solution.
    Json,
    /// The trajectory as a table.
    Csv,
    /// The trajectory as a picture.
    Svg,
}

impl Representation {
    /// In the order of preference of the service.
    const ALL: [Self; 3] = [Self::Json, Self::Csv, Self::Svg];

    /// The type and the subtype of its media type.
    fn media_type(self) -> (&'static str, &'static str) {
        match self {
            Self::Json => ("application", "json"),
            Self::Csv => ("text", "csv"),
            Self::Svg => ("image", "svg+xml"),
        }
    }

    /// The value of `Content-Type`.
    pub fn content_type(self) -> HeaderValue {
        HeaderValue::from_static(match self {
            Self::Json => "application/json",
            Self::Csv => "text/csv; charset=utf-8; header=present",
            Self::Svg => "image/svg+xml",
        })
    }

    /// The results of `job` in this form. JSON has been written already; CSV is written as the client takes it.
    ///
    /// # Errors
    /// [`Kind::Unreadable`] if what was stored is not a solution, [`Kind::Internal`] if the picture could not be drawn.
    pub async fn body(self, job: &Job, results: Arc<Results>, shared: &Shared) -> Answer<Body> {
        Ok(match self {
            Self::Json => Body::from(Bytes::from_owner(JsonOf(results))),
            Self::Csv => Body::new(CsvOf { results: columns(job, results, shared).await?, next: None }),
            Self::Svg => Body::from(picture(job, columns(job, results, shared).await?, shared).await?),
        })
    }

    fn choose(headers: &HeaderMap) -> Option<Self> {
        let lines: Vec<&str> =
            headers.get_all(header::ACCEPT).iter().map(|line| line.to_str().unwrap_or_default()).collect();
        if lines.is_empty() {
            return Some(Self::Json);
        }
        let weighed = Self::ALL.into_iter().map(|form| (form, form.weight(&lines)));
        // Strictly greater: among equals the first, which the service prefers.
        let best = weighed.reduce(|best, other| if other.1 > best.1 { other } else { best });
        best.filter(|(_, weight)| *weight > 0.0).map(|(form, _)| form)
    }

    fn weight(self, lines: &[&str]) -> f64 {
        let (kind, subtype) = self.media_type();
        let mut found = (0, 0.0);
        for range in lines.iter().flat_map(|line| line.split(',')) {
            let mut parts = range.split(';').map(str::trim);
            let name = parts.next().unwrap_or_default();
            let specificity = match name.split_once('/') {
                Some((a, b)) if a.eq_ignore_ascii_case(kind) && b.eq_ignore_ascii_case(subtype) => 3,
                Some((a, "*")) if a.eq_ignore_ascii_case(kind) => 2,
                Some(("*", "*")) => 1,
                _ => continue,
            };
            let weight = parts
                .find_map(|part| part.strip_prefix("q=").or_else(|| part.strip_prefix("Q=")))
                .map_or(1.0, |q| q.parse().unwrap_or(0.0));
            if specificity > found.0 {
                found = (specificity, weight);
            }
        }
        found.1
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Representation {
    type Rejection = Box<Problem>;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Self::Rejection> {
        Self::choose(&parts.headers).ok_or_else(|| Problem::plain(Kind::NotAcceptable))
    }
}

/// The JSON of results, not copied.
struct JsonOf(Arc<Results>);

impl AsRef<[u8]> for JsonOf {
    fn as_ref(&self) -> &[u8] {
        self.0.json()
    }
}

/// The CSV of results, some rows at a time: a large one neither holds up a thread nor stands in memory twice.
struct CsvOf {
    results: Arc<Results>,
    /// The next row; nothing before the header.
    next: Option<usize>,
}

/// Numbers in a piece of CSV, about 64 KiB of text.
const PIECE: usize = 4096;

impl HttpBody for CsvOf {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(mut self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        // Read before the first piece was asked for.
        let Ok(Solution { trajectory, .. }) = self.results.solution() else { return Poll::Ready(None) };
        let mut text = Vec::new();
        let first = self.next.unwrap_or(0);
        let last = first + (PIECE / (trajectory.fields.len() + 1)).max(1);
        // Writing to memory does not fail.
        if self.next.is_none() {
            let _ = write_csv_header(trajectory, &mut text);
        }
        let _ = write_csv_rows(trajectory, first..last, &mut text);
        self.next = Some(last);
        Poll::Ready((!text.is_empty()).then(|| Ok(Frame::data(text.into()))))
    }
}

/// JSON that is read back where the connection is served.
const SHORT: usize = 64 << 10;

/// The results with their columns in hand. A large result from a disk is read on a thread of its own, few at a time.
async fn columns(job: &Job, results: Arc<Results>, shared: &Shared) -> Answer<Arc<Results>> {
    let read = if results.is_read() || results.json().len() <= SHORT {
        results.solution().map(drop)
    } else {
        let _permit = shared.readers.acquire().await.map_err(|_| Problem::plain(Kind::Internal))?;
        let results = Arc::clone(&results);
        let read = spawn_blocking(move || results.solution().map(drop)).await;
        read.map_err(|_| Problem::plain(Kind::Internal))?
    };
    read.map_err(|error| unreadable(job, &error))?;
    Ok(results)
}

/// Numbers that are drawn where the connection is served, within a fraction of a millisecond.
const SKETCH: usize = 16 << 10;

/// The picture of results. A large one is drawn on a thread of its own, few at a time.
async fn picture(job: &Job, results: Arc<Results>, shared: &Shared) -> Answer<Vec<u8>> {
    let label = job.label.clone();
    let trajectory = results.solution().map(|solution| &solution.trajectory);
    let numbers = trajectory.map_or(0, |trajectory| trajectory.t.len() * trajectory.fields.len());
    let draw = move || {
        let mut text = Vec::new();
        if let Ok(solution) = results.solution() {
            // Writing to memory does not fail.
            let _ = write_svg(solution, label.as_deref(), &mut text);
        }
        text
    };
    if numbers <= SKETCH {
        return Ok(draw());
    }
    // The semaphore is never closed and drawing does not panic; if it did, that would be ours to answer for.
    let _permit = shared.readers.acquire().await.map_err(|_| Problem::plain(Kind::Internal))?;
    spawn_blocking(draw).await.map_err(|_| Problem::plain(Kind::Internal))
}

#[cfg(test)]
mod tests {
    use super::*;
    use Representation::{Csv, Json, Svg};

    #[track_caller]
    fn assert_chosen(accept: &str, chosen: Option<Representation>) {
        let mut headers = HeaderMap::new();
        headers.insert(header::ACCEPT, accept.parse().unwrap());
        assert_eq!(Representation::choose(&headers), chosen, "{accept}");
    }

    #[test]
    fn json_is_given_to_who_takes_anything() {
        assert_eq!(Representation::choose(&HeaderMap::new()), Some(Json));
        assert_chosen("*/*", Some(Json));
        assert_chosen("text/csv, application/json", Some(Json));
        assert_chosen("application/*", Some(Json));
    }

    #[test]
    fn the_greater_weight_wins() {
        assert_chosen("application/json;q=0.5, text/csv;q=0.8", Some(Csv));
        assert_chosen("Text/CSV", Some(Csv));
        assert_chosen("text/*, application/json; q=0.9", Some(Csv));
        assert_chosen("image/avif, image/*, */*;q=0.8", Some(Svg));
    }

    #[test]
    fn a_specific_range_overrides_a_general_one() {
        assert_chosen("*/*, application/json;q=0", Some(Csv));
        assert_chosen("application/json;q=0.1, */*;q=0.5", Some(Csv));
    }

    #[test]
    fn what_fits_nothing_is_not_acceptable() {
        assert_chosen("image/png", None);
        assert_chosen("application/json;q=0", None);
        assert_chosen("application/json;q=nonsense", None);
        assert_chosen("", None);
    }
}
