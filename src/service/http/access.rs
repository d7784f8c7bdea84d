//! Authentication and authorization: `Authorization: Bearer TOKEN` (RFC 6750), if the service requires tokens.
//!
//! Reading needs the scope `read`, every other request `submit`. A job of another client is reported as unknown, not
//! as forbidden, so that the existence of an id is not revealed.

use super::problem::{Kind, Problem};
use crate::access::{Scope, Tokens, Unreadable};
use crate::jobs::{Client, Job};
use axum::extract::{FromRequestParts, Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::convert::Infallible;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::time::Duration;

/// A request extension which says that the client may access the jobs of all clients.
#[derive(Clone, Copy, Debug)]
struct Admin;

/// The time to recommend for a retry if the file of tokens is unreadable: the operator may have repaired it by then.
const LATER: Duration = Duration::from_secs(10);

/// Passes on a request whose token has the required scope, and identifies its client by the token; refuses others.
pub async fn authorize(State(tokens): State<Arc<Tokens>>, mut request: Request, next: Next) -> Response {
    let found = match bearer(request.headers()).map(|text| tokens.find(text)) {
        Some(Err(Unreadable)) => return Problem::plain(Kind::TokensUnreadable).after(LATER).into_response(),
        Some(Ok(found)) => found,
        None => None,
    };
    let Some((number, row)) = found else {
        let mut response = Problem::plain(Kind::TokenRequired).into_response();
        response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer realm=\"dvi\""));
        return response;
    };
    let looks = matches!(*request.method(), Method::GET | Method::HEAD);
    let scope = if looks { Scope::Read } else { Scope::Submit };
    if !row.allows(scope) {
        return Problem::new(Kind::ScopeMissing, format!("the token does not have the scope {scope}")).into_response();
    }
    request.extensions_mut().insert(Client::Token(number));
    if row.allows(Scope::Admin) {
        request.extensions_mut().insert(Admin);
    }
    let mut response = next.run(request).await;
    response.extensions_mut().insert(Client::Token(number));
    response
}

fn bearer(headers: &HeaderMap) -> Option<&str> {
    let (scheme, token) = headers.get(header::AUTHORIZATION)?.to_str().ok()?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| token.trim())
}

/// Extracts the client of a request; requests without a connection, as in tests, count as one client.
impl<S: Send + Sync> FromRequestParts<S> for Client {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(parts.extensions.get().copied().unwrap_or(Self::at(IpAddr::V4(Ipv4Addr::UNSPECIFIED))))
    }
}

/// The jobs that a request may access: those of its client, or those of all clients.
#[derive(Clone, Copy, Debug)]
pub struct Visibility {
    client: Client,
    everyone: bool,
}

impl Visibility {
    /// Whether the request may access `job`.
    pub fn reaches(self, job: &Job) -> bool {
        self.everyone || job.client == self.client
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Visibility {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Infallible> {
        let client = Client::from_request_parts(parts, state).await?;
        Ok(Self { client, everyone: parts.extensions.get::<Admin>().is_some() })
    }
}
