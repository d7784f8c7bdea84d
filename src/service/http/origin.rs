//! Refuses what a page of another site makes a browser post. `application/x-www-form-urlencoded`, which `curl -d` says
//! of everything, is also what browsers send across sites without asking the service first (Fetch, "CORS-safelisted
//! request-header"), so the type of the body protects nothing. Browsers say where a request comes from, in
//! `Sec-Fetch-Site` and, those without it, in `Origin`; other clients send neither.

use super::problem::{HandlerResult, Kind, Problem};
use axum::extract::Request;
use axum::http::{HeaderMap, Method, header};

/// Lets through what changes nothing, and what comes from no page or from one of this service.
pub fn refuse_other_sites(request: &Request) -> HandlerResult<()> {
    let changes_nothing = matches!(*request.method(), Method::GET | Method::HEAD | Method::OPTIONS);
    if changes_nothing || is_own(request.headers()) { Ok(()) } else { Err(Problem::plain(Kind::CrossSite)) }
}

fn is_own(headers: &HeaderMap) -> bool {
    // Another port of the same host is of the same site, but not ours.
    if let Some(site) = headers.get("sec-fetch-site") {
        return site == "same-origin" || site == "none";
    }
    let Some(origin) = headers.get(header::ORIGIN) else { return true };
    let authority = origin.to_str().ok().and_then(|origin| origin.split_once("://")).map(|(_, authority)| authority);
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok());
    matches!((authority, host), (Some(authority), Some(host)) if authority.eq_ignore_ascii_case(host))
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::{HeaderName, HeaderValue};

    #[track_caller]
    fn assert_own(lines: &[(&'static str, &'static str)], own: bool) {
        let lines = lines.iter().map(|(name, value)| (HeaderName::from_static(name), HeaderValue::from_static(value)));
        let headers: HeaderMap = lines.collect();
        assert_eq!(is_own(&headers), own, "{headers:?}");
    }

    #[test]
    fn clients_that_are_no_browsers_are_taken() {
        assert_own(&[], true);
        assert_own(&[("host", "localhost:8080"), ("content-type", "application/x-www-form-urlencoded")], true);
    }

    #[test]
    fn a_page_of_the_service_is_taken() {
        assert_own(&[("sec-fetch-site", "same-origin"), ("origin", "http://proxied.example")], true);
        assert_own(&[("sec-fetch-site", "none")], true);
        assert_own(&[("origin", "http://LocalHost:8080"), ("host", "localhost:8080")], true);
    }

    #[test]
    fn a_page_of_another_site_is_refused() {
        assert_own(&[("sec-fetch-site", "cross-site"), ("host", "localhost:8080")], false);
        assert_own(&[("sec-fetch-site", "same-site"), ("origin", "http://localhost:8080")], false);
        assert_own(&[("origin", "http://localhost:3000"), ("host", "localhost:8080")], false);
        assert_own(&[("origin", "http://evil.example"), ("host", "localhost:8080")], false);
        assert_own(&[("origin", "http://localhost:8080.evil.example"), ("host", "localhost:8080")], false);
        assert_own(&[("origin", "null"), ("host", "localhost:8080")], false);
        assert_own(&[("origin", "http://localhost:8080")], false);
    }
}
