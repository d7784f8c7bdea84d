//! The context of an HTTP request: the request and trace ids, which connect its log lines, and the path prefix under
//! which its client knows the service.

use super::trace::Trace;
use std::fmt::Display;
use std::sync::Arc;
use tokio::task_local;

/// The ids of an HTTP request, and the path prefix under which its client reaches the service.
#[derive(Clone, Debug, Default)]
pub struct Context {
    /// The prefix of every URL path; empty unless a proxy shows the service under a path.
    pub prefix: Arc<str>,
    /// The id of the HTTP request.
    pub request: Arc<str>,
    /// The trace (W3C Trace Context) that the request belongs to, if any.
    pub trace: Option<Trace>,
}

task_local! {
    static CONTEXT: Context;
}

impl Context {
    /// Returns the context of the current HTTP request; an empty context outside of requests.
    pub fn current() -> Self {
        CONTEXT.try_with(Self::clone).unwrap_or_default()
    }

    /// Runs `future`, a handler of the request or a task spawned for it, in this request context.
    pub async fn around<F: Future>(self, future: F) -> F::Output {
        CONTEXT.scope(self, future).await
    }
}

/// Returns a URL path of the service with the path prefix under which the client of the current request knows it.
pub fn address(path: impl Display) -> String {
    CONTEXT.try_with(|context| format!("{}{path}", context.prefix)).unwrap_or_else(|_| path.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn addresses_are_those_of_the_request() {
        assert_eq!(address("/jobs"), "/jobs");
        let context = Context { prefix: "/dvi".into(), ..Context::default() };
        assert_eq!(context.around(async { address("/jobs") }).await, "/dvi/jobs");
    }
}
