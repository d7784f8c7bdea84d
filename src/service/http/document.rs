//! The body of a `POST`: a JSON document of bounded size that arrives in bounded time.
//!
//! `application/json` and every `+json` are taken, and so are no type at all and `application/x-www-form-urlencoded`,
//! which is what `curl -d` says of everything.

use super::Shared;
use super::problem::{HandlerResult, Kind, Problem};
use crate::compiled::Known;
use crate::jobs::{AdmissionError, Client, Fault};
use crate::worker::{Checked, Facts};
use axum::body::{Body, HttpBody};
use axum::extract::{FromRequest, Request};
use axum::http::{HeaderMap, header};
use problem::Control;
use specification::Draft;
use std::future::poll_fn;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::timeout;

/// A document up to this size is read where its connection is served: that takes less time than moving it. It is checked
/// there too if what it declares takes no longer than this.
const SMALL: usize = 4 << 10;
const SOON: Duration = Duration::from_millis(2);

/// The bytes of the body.
pub struct Document(Arc<[u8]>);

impl Document {
    /// What was posted before, or follows from it.
    pub fn of(bytes: Arc<[u8]>) -> Self {
        Self(bytes)
    }

    /// Reads and checks it as a specification. One that is large, or declares much, a worker reads, few at a time and the
    /// clients in turn, for as long as a job may take and its client waits: the checks differentiate every expression, and
    /// look at every node and every pair of bodies.
    ///
    /// # Errors
    /// All that is wrong with it; the bound that is reached.
    pub async fn checked(&self, shared: &Shared, client: Client) -> HandlerResult<Correct> {
        let bytes = self.bytes();
        if bytes.len() <= SMALL {
            if let Some(known) = shared.compiled.find(&bytes) {
                return Ok(Correct::Here(known));
            }
            let draft = Draft::read(&bytes)?;
            if draft.check_time() <= SOON {
                let known = Arc::new(Known::of(shared.jobs.check(draft, &Control::new())?));
                shared.compiled.keep(&bytes, &known);
                return Ok(Correct::Here(known));
            }
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

    /// As it was posted.
    pub fn bytes(&self) -> Arc<[u8]> {
        Arc::clone(&self.0)
    }
}

/// A specification that is correct.
pub enum Correct {
    /// Read here.
    Here(Arc<Known>),
    /// Read by a worker, with its summary as JSON.
    Elsewhere(Facts, Vec<u8>),
}

impl Correct {
    /// Its summary as JSON.
    pub fn summary(self) -> Vec<u8> {
        match self {
            // Every number of a summary is finite, so that it has a JSON form.
            Self::Here(known) => serde_json::to_vec(&known.specification.summary()).unwrap_or_default(),
            Self::Elsewhere(_, summary) => summary,
        }
    }

    /// What is known of it, and the specification itself where it was read here.
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
    let too_large = || Problem::new(Kind::BodyTooLarge, format!("a specification may have {} MiB", limit >> 20));
    let announced = usize::try_from(body.size_hint().lower()).unwrap_or(usize::MAX);
    if announced > limit {
        return Err(too_large());
    }
    // What is announced has yet to come: memory is given for it as it does.
    let mut bytes = Vec::with_capacity(announced.min(SMALL));
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
