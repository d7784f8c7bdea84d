//! What every request meets: an id, which the client may give in `X-Request-Id` and which is given back to it, a span
//! under that id in a log that goes into detail, and a look at where it comes from and whom it asks. Whatever the answer is, it is counted
//! and leaves under the same security headers.

use super::Shared;
use super::host::refuse_other_hosts;
use super::origin::refuse_other_sites;
use super::security::secure;
use axum::extract::{Request, State};
use axum::http::{HeaderName, HeaderValue, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::time::Instant;
use tracing::Instrument;
use uuid::Uuid;

const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// A longer id is not one that somebody looks for in a log.
const LONGEST: usize = 128;

/// Runs the request, logs how it went and gives its id to the answer.
pub async fn observe(State(shared): State<Shared>, request: Request, next: Next) -> Response {
    let given =
        request.headers().get(&REQUEST_ID).filter(|id| (1..=LONGEST).contains(&id.len()) && id.to_str().is_ok());
    let id = given.cloned().or_else(|| HeaderValue::try_from(Uuid::now_v7().to_string()).ok());
    let text = id.as_ref().and_then(|id| id.to_str().ok()).unwrap_or_default();
    let (method, path) = (request.method().clone(), request.uri().clone());
    // Of an ordinary log only a failure is told, with all that the span says.
    let span = tracing::debug_span!("request", request.id = text, http.method = %method, http.path = path.path());
    let start = Instant::now();
    let mut response = async {
        let response = match refuse_other_hosts(&request, &shared.options).and_then(|()| refuse_other_sites(&request)) {
            Ok(()) => next.run(request).await,
            Err(problem) => problem.into_response(),
        };
        let (status, duration_ms) = (response.status(), start.elapsed().as_secs_f64() * 1e3);
        if status == StatusCode::INTERNAL_SERVER_ERROR {
            let path = path.path();
            tracing::error!(request.id = text, http.method = %method, http.path = path, duration_ms, "the service failed");
        } else {
            tracing::debug!(http.status = status.as_u16(), duration_ms, "answered {status}");
        }
        response
    }
    .instrument(span)
    .await;
    shared.metrics.answered(response.status());
    secure(response.headers_mut());
    if let Some(id) = id {
        response.headers_mut().insert(REQUEST_ID, id);
    }
    response
}
