//! What goes with a request wherever it is served: its ids, by which the lines of a log are joined, and the prefix under
//! which its client knows the addresses of the service.

use super::trace::Trace;
use std::fmt::Display;
use std::sync::Arc;
use tokio::task_local;

/// The ids of a request, and the prefix of addresses.
#[derive(Clone, Debug, Default)]
pub struct Context {
    /// What stands before every address; empty unless the service lives under a path.
    pub prefix: Arc<str>,
    /// The id of the request.
    pub request: Arc<str>,
    /// The trace that the request is part of, if any.
    pub trace: Option<Trace>,
}

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
