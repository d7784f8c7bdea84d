//! Refusal of cross-site requests. `application/x-www-form-urlencoded`, which `curl -d` sends by default, is also what
//! browsers send across sites without a preflight request (Fetch, "CORS-safelisted request-header"), so the content
//! type protects nothing. Browsers name the origin of a request in `Sec-Fetch-Site` or, if they lack that, in `Origin`;
//! other clients send neither.

use super::problem::{HandlerResult, Kind, Problem};
use axum::extract::Request;
use axum::http::{HeaderMap, Method, header};

/// Accepts requests that change nothing, and requests from no page or from a page of this service; refuses others.
pub fn refuse_other_sites(request: &Request) -> HandlerResult<()> {
    let changes_nothing = matches!(*request.method(), Method::GET | Method::HEAD | Method::OPTIONS);
    if changes_nothing || is_own(request.headers()) { Ok(()) } else { Err(Problem::plain(Kind::CrossSite)) }
}

fn is_own(headers: &HeaderMap) -> bool {
    // `same-site` is not accepted: another port of the host is the same site, but may be another service.
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
