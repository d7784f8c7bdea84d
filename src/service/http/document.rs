//! The body of a `POST`: a JSON document of bounded size that arrives in bounded time.
//!
//! `application/json` and every `+json` are taken, and so are no type at all and `application/x-www-form-urlencoded`,
//! which is what `curl -d` says of everything.

use super::Shared;
use super::problem::{Answer, Kind, Problem};
use axum::body::{Body, HttpBody};
use axum::extract::{FromRequest, Request};
use axum::http::{HeaderMap, header};
use specification::Specification;
use std::future::poll_fn;
use std::pin::Pin;
use std::sync::Arc;
use tokio::task::spawn_blocking;
use tokio::time::timeout;

/// A document up to this size is read where its connection is served: that takes less time than moving it.
const SMALL: usize = 4 << 10;

/// The bytes of the body.
pub struct Document(Arc<[u8]>);

impl Document {
    /// Reads and checks it as a specification. A large one is read on a thread of its own, few at a time, because
    /// the checks differentiate every expression in it.
    ///
    /// # Errors
    /// All that is wrong with it.
    pub async fn specification(&self, shared: &Shared) -> Answer<Arc<Specification>> {
        let bytes = self.bytes();
        let read = if bytes.len() <= SMALL {
            shared.jobs.read(&bytes)
        } else {
            // The semaphore is never closed and the reader does not panic; if it did, that would be ours to answer for.
            let internal = |_| Problem::plain(Kind::Internal);
            let _permit = shared.readers.acquire().await.map_err(|_| Problem::plain(Kind::Internal))?;
            let jobs = Arc::clone(&shared.jobs);
            spawn_blocking(move || jobs.read(&bytes)).await.map_err(internal)?
        };
        Ok(Arc::new(read?))
    }

    /// As it was posted.
    pub fn bytes(&self) -> Arc<[u8]> {
        Arc::clone(&self.0)
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

async fn collect(mut body: Body, limit: usize) -> Answer<Vec<u8>> {
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
