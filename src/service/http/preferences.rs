//! The time that a client is willing to wait: the header `Prefer` (RFC 7240).
//!
//! `wait=N` means N seconds, at most 60. `respond-async` alone means no wait. With both, the client waits N seconds
//! and then accepts the address of the job in place of results (section 4.1); every client of the service must accept
//! that. Without either, the client waits 30 seconds. With `transient`, a job is deleted once its results have been
//! sent. An invalid preference is ignored (section 2).

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue};
use std::convert::Infallible;
use std::time::Duration;

const DEFAULT_SECONDS: u64 = 30;
const MOST_SECONDS: u64 = 60;

/// The preferences of a client (header `Prefer`): the time to wait for results, and whether the job is to be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preferences {
    wait: Option<u64>,
    respond_async: bool,
    transient: bool,
}

impl Preferences {
    /// Whether the job is to be deleted once its results have been sent.
    pub fn is_transient(self) -> bool {
        self.transient
    }

    /// Returns the time that the client wants to wait for the results of a solve.
    pub fn wait(self) -> Duration {
        Duration::from_secs(match self {
            Self { wait: Some(seconds), .. } => seconds,
            Self { respond_async: true, .. } => 0,
            Self { .. } => DEFAULT_SECONDS,
        })
    }

    /// Returns the value of the header `Preference-Applied` of a response that is `asynchronous` (202) or not.
    pub fn applied(self, asynchronous: bool) -> Option<HeaderValue> {
        let Self { wait, respond_async, transient } = self;
        let applied = [
            (respond_async && asynchronous).then(|| "respond-async".to_owned()),
            wait.map(|seconds| format!("wait={seconds}")),
            (transient && !asynchronous).then(|| "transient".to_owned()),
        ];
        let text = applied.into_iter().flatten().collect::<Vec<_>>().join(", ");
        if text.is_empty() {
            return None;
        }
        HeaderValue::try_from(text).ok()
    }

    fn read(headers: &HeaderMap) -> Self {
        let mut read = Self { wait: None, respond_async: false, transient: false };
        for preference in
            headers.get_all("prefer").iter().filter_map(|line| line.to_str().ok()).flat_map(|line| line.split(','))
        {
            let token = preference.split(';').next().unwrap_or_default();
            let (name, value) = token.split_once('=').unwrap_or((token, ""));
            let (name, value) = (name.trim(), value.trim().trim_matches('"'));
            // If a preference has several values, the first applies (RFC 7240, section 2).
            if name.eq_ignore_ascii_case("wait") && read.wait.is_none() {
                read.wait = value.parse().ok().map(|seconds: u64| seconds.min(MOST_SECONDS));
            } else if name.eq_ignore_ascii_case("respond-async") {
                read.respond_async = true;
            } else if name.eq_ignore_ascii_case("transient") {
                read.transient = true;
            }
        }
        read
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Preferences {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(Self::read(&parts.headers))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn assert_read(lines: &[&str], seconds: u64, synchronous: Option<&str>, asynchronous: Option<&str>) {
        let mut headers = HeaderMap::new();
        for line in lines {
            headers.append("prefer", line.parse().unwrap());
        }
        let read = Preferences::read(&headers);
        assert_eq!(read.wait(), Duration::from_secs(seconds));
        assert_eq!(read.applied(false), synchronous.map(|text| text.parse().unwrap()));
        assert_eq!(read.applied(true), asynchronous.map(|text| text.parse().unwrap()));
    }

    #[test]
    fn who_prefers_nothing_waits_thirty_seconds() {
        assert_read(&[], 30, None, None);
    }

    #[test]
    fn a_wait_is_at_most_a_minute_and_says_so() {
        assert_read(&["wait=7"], 7, Some("wait=7"), Some("wait=7"));
        assert_read(&["wait=3600"], 60, Some("wait=60"), Some("wait=60"));
        assert_read(&["Wait = \"7\"; foo=bar"], 7, Some("wait=7"), Some("wait=7"));
    }

    #[test]
    fn respond_async_alone_does_not_wait() {
        assert_read(&["respond-async"], 0, None, Some("respond-async"));
    }

    #[test]
    fn respond_async_with_a_wait_waits_first() {
        let both = Some("respond-async, wait=10");
        assert_read(&["respond-async, wait=10"], 10, Some("wait=10"), both);
        assert_read(&["wait=10, wait=20", "respond-async"], 10, Some("wait=10"), both);
    }

    #[test]
    fn what_is_transient_says_so_with_its_results() {
        assert_read(&["wait=3, transient"], 3, Some("wait=3, transient"), Some("wait=3"));
        assert_read(&["Transient"], 30, Some("transient"), None);
    }

    #[test]
    fn what_makes_no_sense_is_ignored() {
        assert_read(&["wait=soon, wait=-1, wait=99999999999999999999, handling=strict"], 30, None, None);
    }
}
