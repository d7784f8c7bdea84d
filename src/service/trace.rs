//! The trace that a request belongs to (W3C Trace Context): it comes from the client, identifies the log lines and
//! the spans of the request and its job, and is passed on to the worker process and back to the client.

use std::fmt::{self, Display};
use tracing::Span;
use uuid::Uuid;

/// The reference to a span of a trace, as passed from one program to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trace {
    /// The id of the trace, written with 32 hexadecimal digits.
    pub id: u128,
    /// The id of the span within the trace, written with 16 hexadecimal digits.
    pub span: u64,
    /// The flags of W3C Trace Context; bit 0 says whether the trace is recorded.
    pub flags: u8,
}

impl Trace {
    /// Parses a `traceparent` header, `VERSION-TRACE-PARENT-FLAGS`; returns `None` if it is malformed or has a zero
    /// id.
    pub fn read(traceparent: &str) -> Option<Self> {
        let mut parts = traceparent.trim().split('-');
        let hexadecimal = |part: &str, length| {
            let fits = part.len() == length && part.bytes().all(|c| matches!(c, b'0'..=b'9' | b'a'..=b'f'));
            if fits { u128::from_str_radix(part, 16).ok() } else { None }
        };
        let version = hexadecimal(parts.next()?, 2).filter(|version| *version != 0xff)?;
        let id = hexadecimal(parts.next()?, 32).filter(|id| *id != 0)?;
        let span =
            hexadecimal(parts.next()?, 16).and_then(|span| u64::try_from(span).ok()).filter(|span| *span != 0)?;
        let flags = hexadecimal(parts.next()?, 2).and_then(|flags| u8::try_from(flags).ok())?;
        (version > 0 || parts.next().is_none()).then_some(Self { id, span, flags })
    }

    /// Returns the `traceparent` header to pass to the next program of the trace.
    pub fn traceparent(&self) -> String {
        let Self { id, span, flags } = self;
        format!("00-{id:032x}-{span:016x}-{flags:02x}")
    }

    /// Returns the trace with the id of a new span of this program in place of its span.
    fn continued(self) -> Self {
        let (_, span) = Uuid::now_v7().as_u64_pair();
        Self { span, ..self }
    }
}

/// Writes the id of the trace, which connects log lines.
impl Display for Trace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", self.id)
    }
}

/// Adds `span` to the trace, and returns the trace with the id of that span. If the client gave no trace and spans
/// are exported to a collector, a new trace begins with `span`.
pub fn join(span: &Span, trace: Option<Trace>) -> Option<Trace> {
    exported(span, trace).or_else(|| trace.map(Trace::continued))
}

/// Returns the trace and span ids under which a collector receives `span`; `None` if no collector is configured.
#[cfg(feature = "otlp")]
fn exported(span: &Span, trace: Option<Trace>) -> Option<Trace> {
    use opentelemetry::trace::{SpanContext, SpanId, TraceContextExt, TraceFlags, TraceId, TraceState};
    use tracing_opentelemetry::OpenTelemetrySpanExt;

    if let Some(Trace { id, span: parent, flags }) = trace {
        let (id, parent) = (TraceId::from(id), SpanId::from(parent));
        let parent = SpanContext::new(id, parent, TraceFlags::new(flags), true, TraceState::default());
        // `set_parent` fails if no collector is configured.
        let _ = span.set_parent(opentelemetry::Context::new().with_remote_span_context(parent));
    }
    let context = span.context();
    let here = Some(context.span().span_context().clone()).filter(SpanContext::is_valid)?;
    Some(Trace {
        id: u128::from_be_bytes(here.trace_id().to_bytes()),
        span: u64::from_be_bytes(here.span_id().to_bytes()),
        flags: here.trace_flags().to_u8(),
    })
}

/// Returns `None`: without the feature `otlp`, no span is exported.
#[cfg(not(feature = "otlp"))]
fn exported(_span: &Span, _trace: Option<Trace>) -> Option<Trace> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example `traceparent` of W3C Trace Context, section 3.2.2.
    const EXAMPLE: &str = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";

    #[test]
    fn a_trace_is_read_and_written_as_the_standard_does() {
        let read = Trace::read(EXAMPLE).unwrap();
        assert_eq!(read.to_string(), "4bf92f3577b34da6a3ce929d0e0e4736");
        assert_eq!(read.traceparent(), EXAMPLE);
        let next = read.continued();
        assert_eq!((next.id, next.flags), (read.id, read.flags));
        assert_ne!(next.span, read.span);
        for broken in [
            "",
            "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7",
            "ff-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01",
            "00-00000000000000000000000000000000-00f067aa0ba902b7-01",
            "00-4bf92f3577b34da6a3ce929d0e0e4736-0000000000000000-01",
            "00-4BF92F3577B34DA6A3CE929D0E0E4736-00f067aa0ba902b7-01",
            "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01-more",
        ] {
            assert_eq!(Trace::read(broken), None, "{broken}");
        }
    }
}
