//! The media types in which the results of a job are available, and the bodies of their responses.

use super::Shared;
use super::jobs::unreadable;
use super::negotiation::{MediaType, choose};
use super::part::{Part, no_excerpt};
use super::pieces::{Making, Pieces, Taken, Unwritten};
use super::problem::{HandlerResult, Kind, Problem};
use crate::jobs::{AdmissionError, Client, Job, JobId, Results, SHORT};
use axum::body::{Body, Bytes};
use axum::extract::FromRequestParts;
use axum::http::HeaderValue;
use axum::http::request::Parts;
use solution::Excerpt;
use solution::columnar::{JsonPieces, TablePieces};
#[cfg(feature = "parquet")]
use solution::encodings::Parquet;
use solution::encodings::{Arrow, Csv, Lines, MembersForm, MembersPieces, Table, write_members};
use solution::pictures::write_svg;
use std::io;
use std::sync::Arc;
use tokio::task::spawn_blocking;

/// A format of the results of a job, chosen by the media type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Representation {
    /// The whole solution as JSON, the only format that contains all of it, diagnostics included.
    Json,
    /// The trajectory, or the table of a sweep, as comma-separated values.
    Csv,
    /// The trajectory, or the table of a sweep, as JSON objects, one per line.
    Lines,
    /// The trajectory, or the table of a sweep, as an Arrow stream, with the verdict in its metadata.
    Arrow,
    /// The trajectory, or the table of a sweep, as a Parquet file.
    #[cfg(feature = "parquet")]
    Parquet,
    /// A picture of the trajectory as SVG.
    Svg,
}

impl Representation {
    /// All formats with their media types, in the service's order of preference.
    pub const OFFERED: &[(Self, MediaType)] = &[
        (Self::Json, ("application", "json")),
        (Self::Csv, ("text", "csv")),
        (Self::Lines, ("application", "x-ndjson")),
        (Self::Arrow, ("application", "vnd.apache.arrow.stream")),
        #[cfg(feature = "parquet")]
        (Self::Parquet, ("application", "vnd.apache.parquet")),
        (Self::Svg, ("image", "svg+xml")),
    ];

    /// Returns the value of the header `Content-Type` for results in this format.
    pub fn content_type(self) -> HeaderValue {
        HeaderValue::from_static(match self {
            Self::Json => "application/json",
            Self::Csv => "text/csv; charset=utf-8; header=present",
            Self::Lines => "application/x-ndjson",
            Self::Arrow => "application/vnd.apache.arrow.stream",
            #[cfg(feature = "parquet")]
            Self::Parquet => "application/vnd.apache.parquet",
            Self::Svg => "image/svg+xml",
        })
    }

    /// Returns the format of the table of a sweep; `None` for JSON and pictures.
    fn of_members(self) -> Option<MembersForm> {
        match self {
            Self::Csv => Some(MembersForm::Csv),
            Self::Lines => Some(MembersForm::Lines),
            Self::Arrow => Some(MembersForm::Arrow),
            #[cfg(feature = "parquet")]
            Self::Parquet => Some(MembersForm::Parquet),
            Self::Json | Self::Svg => None,
        }
    }

    /// Returns a response body with the results of `job`, or an excerpt of them, in this format. The JSON of short
    /// results is sent from memory; long results are generated as the client takes them.
    ///
    /// # Errors
    /// [`Kind::BadQuery`] if the excerpt names a field that does not exist, [`Kind::Internal`] if a thread was lost,
    /// [`Kind::Damaged`] or [`Kind::Unreadable`] if the stored results cannot be read.
    pub async fn body(
        self,
        job: &Job,
        results: Arc<Results>,
        excerpt: Option<Excerpt>,
        shared: &Shared,
    ) -> HandlerResult<Body> {
        if self == Self::Json
            && excerpt.is_none()
            && let Some(json) = results.text()
        {
            let room = if json.len() > UNCOUNTED { shared.room.take(json.len()).await } else { None };
            return Ok(Body::from(Bytes::from_owner(Taken::new(JsonOf(results), room))));
        }
        let (id, large) = (job.id, results.bytes() > SHORT);
        let room = shared.room.clone();
        let open = move || Part::of(&results, excerpt.as_ref(), &room);
        let part = match run_blocking(shared, job.client, large, open).await? {
            Ok(part) => part,
            Err(error) => return Err(no_excerpt(shared, job, error).await),
        };
        let numbers = part.numbers();
        if let Some(form) = self.of_members().filter(|_| part.columns.members().is_some()) {
            let verdict = part.skeleton.verdict().map_err(|error| unreadable(id, &error))?;
            let making = Making::Members(MembersPieces::new(form, &verdict).into());
            return pieces(Unwritten { part, making }, numbers, id, shared);
        }
        if let Some(form) = self.of_members().filter(|_| part.skeleton.has_table()) {
            let room = shared.room.take(part.skeleton.text().len()).await;
            let written = run_blocking(shared, job.client, large, move || members(&part, form)).await?;
            return Ok(Body::from(Bytes::from_owner(Taken::new(
                written.map_err(|error| unreadable(id, &error))?,
                room,
            ))));
        }
        let table: Box<dyn Table> = match self {
            Self::Json => {
                let making = Making::Json(JsonPieces::new(part.selection.clone(), part.skeleton.clone()));
                return pieces(Unwritten { part, making }, numbers, id, shared);
            }
            Self::Svg => {
                let label = job.label.clone();
                let room = shared.room.take(numbers.saturating_mul(size_of::<f64>())).await;
                let drawn = run_blocking(shared, job.client, large, move || picture(&part, label.as_deref())).await?;
                return Ok(Body::from(Bytes::from_owner(Taken::new(
                    drawn.map_err(|error| unreadable(id, &error))?,
                    room,
                ))));
            }
            Self::Csv => Box::new(Csv),
            Self::Lines => Box::new(Lines),
            Self::Arrow => Box::new(arrow(&part).map_err(|error| unreadable(id, &error))?),
            #[cfg(feature = "parquet")]
            Self::Parquet => Box::new(Parquet::like(arrow(&part).map_err(|error| unreadable(id, &error))?)),
        };
        let making = Making::Table(TablePieces::new(part.selection.clone(), table));
        pieces(Unwritten { part, making }, numbers, id, shared)
    }
}

/// The size in bytes up to which a response is not counted in the memory budget of responses, since its connection
/// takes more memory anyway.
const UNCOUNTED: usize = 4 << 10;

/// The largest number of values of a response that is generated at once, not in pieces.
const FEW: usize = 256;

/// Returns a response body with `numbers` values: generated in pieces, or at once if they are few.
fn pieces(mut answer: Unwritten, numbers: usize, job: JobId, shared: &Shared) -> HandlerResult<Body> {
    if numbers > FEW {
        return Ok(Body::new(Pieces::new(answer, shared.room.clone())));
    }
    let mut bytes = Vec::new();
    while answer.write(&mut bytes).map_err(|error| unreadable(job, &error))? {}
    Ok(Body::from(bytes))
}

impl<S: Send + Sync> FromRequestParts<S> for Representation {
    type Rejection = Box<Problem>;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Self::Rejection> {
        choose(&parts.headers, Self::OFFERED).ok_or_else(|| Problem::plain(Kind::NotAcceptable))
    }
}

/// Does `work` on the results of a job; if the results are large, on a thread for blocking calls, when the client
/// gets one of a limited number of permits.
pub async fn run_blocking<T: Send + 'static>(
    shared: &Shared,
    client: Client,
    large: bool,
    work: impl FnOnce() -> T + Send + 'static,
) -> HandlerResult<T> {
    if !large {
        return Ok(work());
    }
    let turn = shared.turns.turn(client, 0).await.map_err(AdmissionError::from)?;
    let work = move || {
        let _turn = turn;
        work()
    };
    // The result is an error only if the work has panicked, which is not expected.
    spawn_blocking(work).await.map_err(|_| Problem::plain(Kind::Internal))
}

/// Creates an encoder of an Arrow stream with the verdict and the provenance of a solution.
fn arrow(part: &Part) -> io::Result<Arrow> {
    let (verdict, provenance) = (part.skeleton.verdict()?, part.skeleton.provenance()?);
    Ok(Arrow::with(&verdict).of(provenance.as_ref()))
}

fn picture(part: &Part, label: Option<&str>) -> io::Result<Vec<u8>> {
    let mut text = Vec::new();
    write_svg(&part.solution()?, label, &mut text)?;
    Ok(text)
}

fn members(part: &Part, form: MembersForm) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    write_members(&part.solution()?, form, &mut bytes)?;
    Ok(bytes)
}

/// The JSON of short results, shared and not copied.
struct JsonOf(Arc<Results>);

impl AsRef<[u8]> for JsonOf {
    fn as_ref(&self) -> &[u8] {
        self.0.text().unwrap_or_default()
    }
}
