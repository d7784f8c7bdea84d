//! Cross-origin requests from pages of the origins given by `--cors-origin` (Fetch, "CORS protocol").
//!
//! Origins are compared as a whole. Cookies are not used: a token in a header authorizes a request.

use crate::Options;
use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::response::Response;

const METHODS: HeaderValue = HeaderValue::from_static("GET, HEAD, POST, DELETE");
const TAKEN: HeaderValue = HeaderValue::from_static(
    "authorization, cache-control, content-type, prefer, idempotency-key, last-event-id, x-request-id, traceparent",
);
const GIVEN: HeaderValue = HeaderValue::from_static(
    "location, link, retry-after, dvi-trusted, dvi-repeated, etag, preference-applied, server-timing, x-request-id, traceparent",
);
const RESOURCE_POLICY: HeaderName = HeaderName::from_static("cross-origin-resource-policy");

/// Returns the origin of the requesting page, if the option `cors_origin` of the service lists it.
pub fn allowed(headers: &HeaderMap, options: &Options) -> Option<HeaderValue> {
    let origin = headers.get(header::ORIGIN)?;
    options.cors_origin.iter().any(|allowed| origin == allowed.trim_end_matches('/')).then(|| origin.clone())
}

/// Returns the response to a CORS preflight request from an allowed origin; `None` for other requests.
pub fn preflight(request: &Request, origin: Option<&HeaderValue>) -> Option<Response> {
    origin?;
    if request.method() != Method::OPTIONS || !request.headers().contains_key("access-control-request-method") {
        return None;
    }
    let mut response = Response::new(Body::empty());
    *response.status_mut() = StatusCode::NO_CONTENT;
    let headers = response.headers_mut();
    headers.insert(header::ACCESS_CONTROL_ALLOW_METHODS, METHODS);
    headers.insert(header::ACCESS_CONTROL_ALLOW_HEADERS, TAKEN);
    headers.insert(header::ACCESS_CONTROL_MAX_AGE, HeaderValue::from_static("600"));
    Some(response)
}

/// Adds the CORS headers that let a page of `origin` read the response.
pub fn grant(headers: &mut HeaderMap, origin: HeaderValue) {
    headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, origin);
    headers.insert(header::ACCESS_CONTROL_EXPOSE_HEADERS, GIVEN);
    headers.insert(RESOURCE_POLICY, HeaderValue::from_static("cross-origin"));
}
