//! The body of a `POST` request: a JSON document of bounded size that arrives within a time limit.
//!
//! The media types `application/json` and `+json` are accepted, and so are a missing type and
//! `application/x-www-form-urlencoded`, which is what `curl -d` sends by default.

use super::Shared;
use super::problem::{HandlerResult, Kind, Problem};
use crate::compiled::Known;
use crate::jobs::{AdmissionError, Client, Fault};
use crate::worker::{Checked, Facts};
use axum::body::{Body, HttpBody};
use axum::extract::{FromRequest, Request};
use axum::http::{HeaderMap, header};
use std::future::poll_fn;
use std::pin::Pin;
use std::sync::Arc;
use tokio::time::timeout;

/// The size in bytes up to which memory for a document is allocated before the document has arrived.
const SHORT: usize = 4 << 10;

/// The body of a request as bytes, expected to be JSON.
pub struct Document(Arc<[u8]>);

impl Document {
    /// Creates a document from the bytes of one posted earlier, or derived from such a document.
    pub fn of(bytes: Arc<[u8]>) -> Self {
        Self(bytes)
    }

    /// Parses and checks the document as a specification. A document that is large, or whose check takes long, is
    /// checked by a worker process: a few at a time, with the clients taking turns, within the time limit of a job
    /// and only while the client waits. The checks differentiate every expression, and examine every node and every
    /// pair of bodies.
    ///
    /// # Errors
    /// All errors of the specification, or the limit that the check exceeds.
    pub async fn checked(&self, shared: &Shared, client: Client) -> HandlerResult<Correct> {
        let bytes = self.bytes();
        if let Some(known) = shared.compiled.read(&bytes, &shared.jobs.limits())? {
            return Ok(Correct::Here(known));
        }
        let turn = shared.checks.turn(client, bytes.len()).await.map_err(AdmissionError::from)?;
        match shared.checkers.check(bytes, shared.jobs.limits(), turn).await {
            Checked::Correct(facts, summary) => Ok(Correct::Elsewhere(facts, summary)),
            Checked::Wrong(findings) => Err(findings.into()),
            Checked::Interrupted => Err(Problem::plain(Kind::CheckTime)),
            Checked::Died(death) => {
                tracing::error!(?death, "the worker that checked a specification died: {}", death.code());
                Err(Fault::of(&death, shared.jobs.limits().memory, None).into())
            }
        }
    }

    /// Returns the document as it was posted.
    pub fn bytes(&self) -> Arc<[u8]> {
        Arc::clone(&self.0)
    }
}

/// A specification that a check found without errors, in this process or in a worker process.
pub enum Correct {
    /// The specification was compiled in this process.
    Here(Arc<Known>),
    /// The specification was checked by a worker process: its main properties, and its summary as JSON.
    Elsewhere(Facts, Vec<u8>),
}

impl Correct {
    /// Returns the summary of the specification as JSON.
    pub fn summary(self) -> Vec<u8> {
        match self {
            // Encoding cannot fail, since all numbers of a summary are finite.
            Self::Here(known) => serde_json::to_vec(&known.specification.summary()).unwrap_or_default(),
            Self::Elsewhere(_, summary) => summary,
        }
    }

    /// Returns the main properties of the specification, such as its estimated memory, and its compiled form if it was
    /// compiled in this process.
    pub fn facts(self) -> (Facts, Option<Arc<Known>>) {
        match self {
            Self::Here(known) => (known.facts.clone(), Some(known)),
            Self::Elsewhere(facts, _) => (facts, None),
        }
    }
}

impl FromRequest<Shared> for Document {
    type Rejection = Box<Problem>;

    async fn from_request(request: Request, shared: &Shared) -> Result<Self, Self::Rejection> {
        let (parts, body) = request.into_parts();
        if !is_json(&parts.headers) {
            return Err(Problem::plain(Kind::UnsupportedMediaType));
        }
        match timeout(shared.options.read_time(), collect(body, shared.options.body_bytes())).await {
            Ok(read) => read.map(|bytes| Self(bytes.into())),
            Err(_) => Err(Problem::plain(Kind::BodyTimeout)),
        }
    }
}

fn is_json(headers: &HeaderMap) -> bool {
    if headers.get(header::CONTENT_ENCODING).is_some_and(|encoding| encoding != "identity") {
        return false;
    }
    let Some(value) = headers.get(header::CONTENT_TYPE) else { return true };
    let value = value.to_str().unwrap_or_default();
    let media_type = value.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
    matches!(media_type.as_str(), "application/json" | "application/x-www-form-urlencoded")
        || (media_type.contains('/') && media_type.ends_with("+json"))
}

async fn collect(mut body: Body, limit: usize) -> HandlerResult<Vec<u8>> {
    let too_large =
        || Problem::new(Kind::BodyTooLarge, format!("a specification may have at most {} MiB", limit >> 20));
    let announced = usize::try_from(body.size_hint().lower()).unwrap_or(usize::MAX);
    if announced > limit {
        return Err(too_large());
    }
    // The announced length is not trusted: memory is allocated as data arrive.
    let mut bytes = Vec::with_capacity(announced.min(SHORT));
    while let Some(frame) = poll_fn(|context| Pin::new(&mut body).poll_frame(context)).await {
        let frame = frame.map_err(|error| Problem::new(Kind::BadRequest, error.to_string()))?;
        if let Some(data) = frame.data_ref() {
            if data.len() > limit - bytes.len() {
                return Err(too_large());
            }
            bytes.extend_from_slice(data);
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn assert_type(content_type: &str, taken: bool) {
        let mut headers = HeaderMap::new();
        headers.insert(header::CONTENT_TYPE, content_type.parse().unwrap());
        assert_eq!(is_json(&headers), taken, "{content_type}");
    }

    #[test]
    fn json_by_any_of_its_names_is_taken() {
        assert_type("application/json", true);
        assert_type("Application/JSON; charset=utf-8", true);
        assert_type("application/vnd.dvi+json", true);
        assert_type("application/x-www-form-urlencoded", true);
        assert!(is_json(&HeaderMap::new()));
    }

    #[test]
    fn anything_else_is_not() {
        assert_type("text/plain", false);
        assert_type("application/jsonlines", false);
        assert_type("multipart/form-data; boundary=json", false);
        let mut compressed = HeaderMap::new();
        compressed.insert(header::CONTENT_ENCODING, "gzip".parse().unwrap());
        assert!(!is_json(&compressed));
    }
}
