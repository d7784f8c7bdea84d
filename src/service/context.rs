//! What goes with a request wherever it is served: its ids, by which the lines of a log are joined, and the prefix under
//! which its client knows the addresses of the service.

use std::fmt::{self, Display};
use std::sync::Arc;
use tokio::task_local;

/// The ids of a request, and the prefix of addresses.
#[derive(Clone, Debug, Default)]
pub struct Context {
    /// What stands before every address; empty unless the service lives under a path.
    pub prefix: Arc<str>,
    /// The id of the request.
    pub request: Arc<str>,
    /// The id of the trace that the request is part of (W3C Trace Context), where the client gave one.
    pub trace: Option<TraceId>,
}

/// 32 hexadecimal digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TraceId(u128);

task_local! {
    static CONTEXT: Context;
}

impl Context {
    /// That of the request that is being served; empty outside of requests.
    pub fn current() -> Self {
        CONTEXT.try_with(Self::clone).unwrap_or_default()
    }

    /// Runs what serves this request, or a part of it on a task of its own.
    pub async fn around<F: Future>(self, future: F) -> F::Output {
        CONTEXT.scope(self, future).await
    }
}

/// An address of the service as the client of the request knows it.
pub fn address(path: impl Display) -> String {
    CONTEXT.try_with(|context| format!("{}{path}", context.prefix)).unwrap_or_else(|_| path.to_string())
}

impl TraceId {
    /// That of a `traceparent`, `VERSION-TRACE-PARENT-FLAGS`; nothing where it is malformed or zero.
    pub fn read(traceparent: &str) -> Option<Self> {
        let mut parts = traceparent.trim().split('-');
        let hexadecimal = |part: &str, length| {
            let fits = part.len() == length && part.bytes().all(|c| matches!(c, b'0'..=b'9' | b'a'..=b'f'));
            if fits { u128::from_str_radix(part, 16).ok() } else { None }
        };
        let version = hexadecimal(parts.next()?, 2).filter(|version| *version != 0xff)?;
        let trace = hexadecimal(parts.next()?, 32).filter(|trace| *trace != 0)?;
        hexadecimal(parts.next()?, 16).filter(|parent| *parent != 0)?;
        hexadecimal(parts.next()?, 2)?;
        (version > 0 || parts.next().is_none()).then_some(Self(trace))
    }
}

impl Display for TraceId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trace_is_read_as_the_standard_writes_it() {
        // The example of W3C Trace Context, section 3.2.2.
        let read = TraceId::read("00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01");
        assert_eq!(read.map(|trace| trace.to_string()).as_deref(), Some("4bf92f3577b34da6a3ce929d0e0e4736"));
        for broken in [
            "",
            "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7",
            "ff-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01",
            "00-00000000000000000000000000000000-00f067aa0ba902b7-01",
            "00-4bf92f3577b34da6a3ce929d0e0e4736-0000000000000000-01",
            "00-4BF92F3577B34DA6A3CE929D0E0E4736-00f067aa0ba902b7-01",
            "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01-more",
        ] {
            assert_eq!(TraceId::read(broken), None, "{broken}");
        }
    }

    #[tokio::test]
    async fn addresses_are_those_of_the_request() {
        assert_eq!(address("/jobs"), "/jobs");
        let context = Context { prefix: "/dvi".into(), ..Context::default() };
        assert_eq!(context.around(async { address("/jobs") }).await, "/dvi/jobs");
    }
}
