//! Refusal of requests to foreign host names. A web page can make its own host name resolve to a loopback address
//! after it was loaded (DNS rebinding); the browser then takes the service for the origin of the page, which may post
//! and read anything. Only the name in `Host` reveals such a request. If tokens are required, or if other machines
//! can connect, the name protects nothing and is not checked.
//!
//! Every request of HTTP/1.1 has exactly one `Host` (RFC 9112, section 3.2).

use super::problem::{HandlerResult, Kind, Problem};
use crate::Options;
use axum::extract::Request;
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderValue, Version, header};
use std::net::IpAddr;

/// Paths that monitoring may request under any host name, since they reveal nothing about jobs.
const OPEN: [&str; 3] = ["/healthz", "/readyz", "/metrics"];

/// Accepts requests to the host names of this service, and refuses others.
pub fn refuse_other_hosts(request: &Request, options: &Options) -> HandlerResult<()> {
    let given = host(request.headers(), request.version())?;
    if options.asks_tokens() || !options.listen.ip().is_loopback() || OPEN.contains(&request.uri().path()) {
        return Ok(());
    }
    // A host in the request target takes precedence over the header `Host`.
    let Some(host) = request.uri().host().or(given.as_ref().map(Authority::host)) else { return Ok(()) };
    if is_own(host, options) {
        return Ok(());
    }
    let detail = format!(
        "this service does not accept the host name `{host}`: use `{}`, or start the service with `--host {host}` if \
         that is its name",
        options.listen
    );
    Err(Problem::new(Kind::ForeignHost, detail))
}

/// Returns the value of the single `Host` header; `None` for an HTTP/1.0 request without one.
fn host(headers: &HeaderMap, version: Version) -> HandlerResult<Option<Authority>> {
    let mut given = headers.get_all(header::HOST).iter();
    match (given.next(), given.next()) {
        (None, _) if version < Version::HTTP_11 => Ok(None),
        (Some(host), None) => read(host).map(Some).ok_or_else(|| Problem::plain(Kind::BadHost)),
        (None, _) | (_, Some(_)) => Err(Problem::plain(Kind::BadHost)),
    }
}

fn read(host: &HeaderValue) -> Option<Authority> {
    let authority = Authority::try_from(host.as_bytes()).ok()?;
    (!authority.as_str().contains('@')).then_some(authority)
}

/// Whether `host` is one of the service's names. Ports are ignored, since a forwarded port differs.
fn is_own(host: &str, options: &Options) -> bool {
    let bare = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
    match bare.parse::<IpAddr>() {
        Ok(address) => address.is_loopback() || address == options.listen.ip(),
        Err(_) => ["localhost"]
            .into_iter()
            .chain(options.host.iter().map(String::as_str))
            .any(|own| own.eq_ignore_ascii_case(host)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::Body;

    fn asked(options: &Options, path: &str, hosts: &[&str]) -> Result<(), Kind> {
        let mut request = Request::builder().uri(path);
        for host in hosts {
            request = request.header("host", *host);
        }
        refuse_other_hosts(&request.body(Body::empty()).unwrap(), options).map_err(|problem| problem.kind())
    }

    #[track_caller]
    fn assert_asked(options: &Options, host: &str, answer: Result<(), Kind>) {
        assert_eq!(asked(options, "/jobs", &[host]), answer, "{host}");
    }

    #[test]
    fn the_names_of_this_machine_are_taken_on_any_port() {
        let options = Options::default();
        for host in ["localhost", "LocalHost:8080", "127.0.0.1", "127.0.0.1:9999", "[::1]", "[::1]:8080"] {
            assert_asked(&options, host, Ok(()));
        }
    }

    #[test]
    fn other_names_are_refused_unless_they_are_said_to_be_its_own() {
        let options = Options { host: vec!["dvi.example".to_owned()], ..Options::default() };
        assert_asked(&options, "dvi.example", Ok(()));
        assert_asked(&options, "DVI.example:443", Ok(()));
        for host in ["evil.example:8080", "localhost.evil.example", "127.0.0.1.evil.example", "10.0.0.1", "[::2]:8080"]
        {
            assert_asked(&options, host, Err(Kind::ForeignHost));
        }
        assert_eq!(asked(&options, "http://evil.example/jobs", &["localhost"]), Err(Kind::ForeignHost));
        for path in OPEN {
            assert_eq!(asked(&options, path, &["evil.example"]), Ok(()), "{path}");
        }
    }

    #[test]
    fn a_name_protects_nothing_where_tokens_do_or_others_can_connect() {
        let options = Options { ask_tokens: true, ..Options::default() };
        assert_asked(&options, "dvi.example", Ok(()));
        let options = Options { listen: ([0, 0, 0, 0], 8080).into(), insecure: true, ..Options::default() };
        assert_asked(&options, "dvi.example", Ok(()));
    }

    #[test]
    fn there_is_one_host() {
        let options = Options::default();
        for hosts in [&[][..], &["localhost", "localhost"], &["me@localhost"], &["a b"], &[""]] {
            assert_eq!(asked(&options, "/healthz", hosts), Err(Kind::BadHost), "{hosts:?}");
        }
        let mut old = Request::new(Body::empty());
        *old.version_mut() = Version::HTTP_10;
        assert!(refuse_other_hosts(&old, &options).is_ok());
    }
}
