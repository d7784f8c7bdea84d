//! Middleware for every request: request ids, checks of the origin and of the host, metrics and the access log. All
//! responses get the same security headers.
//!
//! The id of a request is the client's `X-Request-Id`, or a new one, and is returned in the response. The trace of a
//! `traceparent` header (W3C Trace Context) is logged for the request and its job, and is returned with a span of
//! this service as its parent.

use super::Shared;
use super::access_log::{self, Line};
use super::cors;
use super::host::refuse_other_hosts;
use super::origin::refuse_other_sites;
use super::problem::Kind;
use super::security::secure;
use crate::context::Context;
use crate::jobs::{Client, JobId};
use crate::trace::{self, Trace};
use axum::body::Body;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::mem;
use std::time::Instant;
use tracing::{Instrument, field};
use uuid::Uuid;

const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
const TRACE: HeaderName = HeaderName::from_static("traceparent");

/// The longest accepted request id, in bytes; a longer one is replaced by a new id.
const LONGEST: usize = 128;

/// Paths that monitoring requests every few seconds, which are left out of the access log.
const WATCHED: [&str; 3] = ["/healthz", "/readyz", "/metrics"];

/// Serves the request, records it, and adds the ids and the security headers to the response.
pub async fn observe(State(shared): State<Shared>, request: Request, next: Next) -> Response {
    let given =
        request.headers().get(&REQUEST_ID).filter(|id| (1..=LONGEST).contains(&id.len()) && id.to_str().is_ok());
    let id = given.cloned().or_else(|| HeaderValue::try_from(Uuid::now_v7().to_string()).ok());
    let text = id.as_ref().and_then(|id| id.to_str().ok()).unwrap_or_default();
    let given = request.headers().get(&TRACE).and_then(|trace| Trace::read(trace.to_str().ok()?));
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    let route = request.extensions().get::<MatchedPath>().map(|path| path.as_str().to_owned());
    let client = request.extensions().get::<Client>().copied();
    let origin = cors::allowed(request.headers(), &shared.options);
    let span = tracing::debug_span!("request", request.id = text, http.method = %method, http.path = path,
        http.status = field::Empty);
    let trace = trace::join(&span, given);
    let context = Context { prefix: shared.options.prefix(), request: text.into(), trace };
    let start = Instant::now();
    let serving = async {
        let refused = refuse_other_hosts(&request, &shared.options)
            .and_then(|()| if origin.is_some() { Ok(()) } else { refuse_other_sites(&request) });
        match (refused, cors::preflight(&request, origin.as_ref())) {
            (Err(problem), _) => problem.into_response(),
            (Ok(()), Some(granted)) => granted,
            (Ok(()), None) => next.run(request).await,
        }
    };
    let mut response = context.clone().around(serving.instrument(span.clone())).await;
    let status = response.status();
    span.record("http.status", status.as_u16());
    // The trace span of a request ends when the headers of its response are known, not its body.
    drop(span);
    if status == StatusCode::INTERNAL_SERVER_ERROR {
        let duration_ms = start.elapsed().as_secs_f64() * 1e3;
        tracing::error!(request.id = text, http.method = %method, http.path = path, duration_ms, "the service failed");
    }
    let route = route.as_deref().map_or("none", |route| route.strip_prefix(&*context.prefix).unwrap_or(route));
    let refusal = response.extensions().get::<Kind>().map(|kind| kind.slug());
    shared.metrics.answered(&method, route, status, refusal, start.elapsed());
    let headers = response.headers_mut();
    secure(headers);
    if !shared.options.cors_origin.is_empty() {
        headers.append(header::VARY, HeaderValue::from_static("origin"));
    }
    if let Some(origin) = origin {
        cors::grant(headers, origin);
    }
    if let Some(trace) = trace
        && let Ok(trace) = HeaderValue::try_from(trace.traceparent())
    {
        headers.insert(TRACE, trace);
    }
    if access_log::is_on() && !WATCHED.contains(&route) {
        let client = response.extensions().get::<Client>().copied().or(client);
        let job = response.extensions().get::<JobId>().copied();
        let line = Line { context, client, method, path, status, job, start };
        let body = mem::replace(response.body_mut(), Body::empty());
        *response.body_mut() = access_log::logged(body, line);
    }
    if let Some(id) = id {
        response.headers_mut().insert(REQUEST_ID, id);
    }
    response
}
