//! All problems with which a request can fail, in one table, and their form in responses: `application/problem+json`
//! (RFC 9457). The `type` of a problem is the URL of its explanation.

use super::retry_after;
use crate::context::address;
use crate::jobs::{AdmissionError, Away, Fault, JobId, Unwritable};
use crate::worker::Finding;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Serialize, Serializer};
use specification::SpecificationError;
use std::time::Duration;
use utoipa::ToSchema;

macro_rules! problems {
    ($($kind:ident, $slug:literal, $status:ident, $title:literal, $meaning:literal;)*) => {
        /// The kinds of problems with which a request can fail.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Kind { $(#[doc = $meaning] $kind,)* }

        impl Kind {
            /// All kinds of problems with which a request can fail.
            pub const ALL: &[Self] = &[$(Self::$kind),*];

            /// Returns the last segment of the URL of the problem.
            pub fn slug(self) -> &'static str {
                match self { $(Self::$kind => $slug,)* }
            }

            /// Returns the HTTP status of responses with the problem.
            pub fn status(self) -> StatusCode {
                match self { $(Self::$kind => StatusCode::$status,)* }
            }

            /// Returns the title of the problem, equal for every occurrence.
            pub fn title(self) -> &'static str {
                match self { $(Self::$kind => $title,)* }
            }

            /// Returns the explanation of the problem: when it occurs, and what to do about it.
            pub fn meaning(self) -> &'static str {
                match self { $(Self::$kind => $meaning,)* }
            }
        }
    };
}

problems! {
    InvalidSpecification, "invalid-specification", BAD_REQUEST, "The specification has errors",
        "The body is not a valid specification; `errors` lists all errors, each with a JSON pointer.";
    BadRequest, "bad-request", BAD_REQUEST, "The request could not be read",
        "The body was incomplete or not well-formed HTTP; send it again.";
    BadQuery, "bad-query", BAD_REQUEST, "The query of the address is invalid",
        "A parameter is unknown, repeated or has an invalid value; `detail` names each.";
    CrossSite, "cross-site", FORBIDDEN, "The request comes from a page of another site",
        "Browsers may send requests that change something only from the service's own pages; `Sec-Fetch-Site` or \
         `Origin` names another.";
    TokenRequired, "token-required", UNAUTHORIZED, "A token is required",
        "The header `Authorization: Bearer TOKEN` is missing, or its token is unknown or expired; `dvi token create` \
         creates one.";
    TokensUnreadable, "tokens-unreadable", SERVICE_UNAVAILABLE, "The tokens cannot be read",
        "The service cannot read its file of tokens, so that it accepts no token; that of the request may be valid.";
    ScopeMissing, "scope-missing", FORBIDDEN, "The token does not allow this request",
        "Reading jobs needs the scope `read`, every other request `submit`; `dvi token list` shows the scopes.";
    NotFound, "not-found", NOT_FOUND, "There is nothing at this address",
        "The address names no resource of this service; `GET /openapi.json` lists the resources.";
    NoSuchJob, "no-such-job", NOT_FOUND, "There is no such job",
        "You have no job with this id: it never existed, was deleted, or is too old to be kept.";
    NoSuchExample, "no-such-example", NOT_FOUND, "There is no such example",
        "No example has this name; `GET /examples` lists all examples.";
    NoSuchProblem, "no-such-problem", NOT_FOUND, "There is no page with this name",
        "No page explains this code; `GET /problems` lists all codes.";
    ResultsNotReady, "results-not-ready", NOT_FOUND, "The results are not ready",
        "The job is waiting or running; ask again after the seconds in `Retry-After`.";
    MethodNotAllowed, "method-not-allowed", METHOD_NOT_ALLOWED, "The resource does not allow this method",
        "The address exists but not with this method; `Allow` lists its methods.";
    NotAcceptable, "not-acceptable", NOT_ACCEPTABLE, "No media type of the response is acceptable",
        "No type in `Accept` is available; results are available as `application/json`, `text/csv`, \
         `application/x-ndjson`, `application/vnd.apache.arrow.stream` and `image/svg+xml`, a solve also as \
         `text/event-stream`.";
    BodyTimeout, "body-timeout", REQUEST_TIMEOUT, "The body took too long to arrive",
        "The whole body must arrive within the time limit `--read-seconds`.";
    KeyInUse, "key-in-use", CONFLICT, "The first request with this key is not finished",
        "A job was posted with the same `Idempotency-Key` and is not yet on the disk; send the request again.";
    NotEnded, "not-ended", CONFLICT, "The job has not ended",
        "Only a job that has ended can be retried or continued; wait for its end, or cancel it first.";
    AlreadySuccessful, "already-successful", CONFLICT, "The job was successful",
        "The same specification would give the same result; `POST /jobs/{id}/continue` continues from its end.";
    NotContinuable, "not-continuable", CONFLICT, "The job cannot be continued",
        "The state at the end does not determine the continuation, or the job has no end state; solve from the start \
         with a later `time.end`.";
    Dismissed, "dismissed", GONE, "The job was dismissed before it started",
        "The job was cancelled while it waited, so that it has no results.";
    BodyTooLarge, "body-too-large", PAYLOAD_TOO_LARGE, "The body is too large",
        "A specification is limited to `--body-mib`; write large matrices as sparse entries.";
    UnsupportedMediaType, "unsupported-media-type", UNSUPPORTED_MEDIA_TYPE, "The body is not JSON",
        "A specification is sent as `application/json`, not compressed; curl's default type counts as JSON.";
    QueueFull, "queue-full", TOO_MANY_REQUESTS, "The queue is full",
        "The number of waiting jobs has reached `--queue`; ask again after the seconds in `Retry-After`.";
    QueueBytes, "queue-bytes", TOO_MANY_REQUESTS, "The waiting specifications are too large",
        "The specifications of waiting jobs have reached `--queue-mib`; ask again after the seconds in `Retry-After`.";
    ClientShare, "client-share", TOO_MANY_REQUESTS, "This client's share of the queue is full",
        "The number of this client's waiting jobs has reached `--client-share`; wait for one of them to end.";
    Defect, "defect", INTERNAL_SERVER_ERROR, "The solver failed with a defect",
        "A defect of the program ended the worker of this job, and no other job; the log has details under the id of \
         the job.";
    StackOverflow, "stack-overflow", INTERNAL_SERVER_ERROR, "The stack of the worker overflowed",
        "The specification is nested too deeply, which the program should have refused; please report it.";
    Killed, "killed", INTERNAL_SERVER_ERROR, "The worker was killed",
        "The kernel, for lack of memory, or another process killed the worker of this job, and no other job; send it \
         again.";
    Overran, "overran", INTERNAL_SERVER_ERROR, "The job exceeded its deadline",
        "The job exceeded the time limit within a single step, where it cannot stop, so that its worker was ended.";
    Internal, "internal", INTERNAL_SERVER_ERROR, "The service failed",
        "A defect of the service, not of the request; the log has details under the id of the request or the job.";
    BadKey, "bad-key", BAD_REQUEST, "The idempotency key is invalid",
        "An `Idempotency-Key` has 1 to 255 visible ASCII characters, for example a UUID.";
    KeyReused, "key-reused", UNPROCESSABLE_ENTITY, "The key belongs to another specification",
        "A different specification was posted with the same `Idempotency-Key`; use a separate key for each \
         specification.";
    Poisoned, "poisoned", INTERNAL_SERVER_ERROR, "The job was set aside",
        "The service ended several times while only this job was running, or two workers on other machines were lost, so \
         that it is not started again; please report its specification, or try it once more with `POST /jobs/{id}/retry`.";
    Unreadable, "unreadable", INTERNAL_SERVER_ERROR, "The store could not be read",
        "The stored job is missing or of another version; the log has details under the id of the job.";
    Damaged, "damaged", INTERNAL_SERVER_ERROR, "The stored job is damaged",
        "The bytes read from the disk differ from those written, so that they are not shown; they are kept, and `dvi \
         store check` lists all damage. Send the specification again.";
    Unwritable, "unwritable", SERVICE_UNAVAILABLE, "The store cannot be written",
        "The disk is full, or the data folder was removed or replaced: no jobs are accepted until there is room, or \
         the folder is restored. Meanwhile jobs can be deleted, and results are kept in memory and written afterwards.";
    StoreAway, "store-away", SERVICE_UNAVAILABLE, "The servers of the jobs do not answer",
        "The service shares its jobs over NATS servers, which it cannot reach now; no accepted job is lost. Ask again after \
         the seconds in `Retry-After`.";
    NoWorkers, "no-workers", SERVICE_UNAVAILABLE, "No worker can be started",
        "The system starts no process for the solve, for lack of memory or processes; accepted jobs wait, and the \
         service tries again every few seconds.";
    ResultTooLarge, "result-too-large", UNPROCESSABLE_ENTITY, "The result is too large",
        "The result is larger than `--result-mib` allows; ask for fewer output times or fields.";
    TooMuchMemory, "too-much-memory", UNPROCESSABLE_ENTITY, "The solve takes too much memory",
        "The estimate or the memory of the solve exceeds `--memory-mib`; ask for fewer times or fields, a coarser mesh \
         or longer steps.";
    CheckTime, "check-time", UNPROCESSABLE_ENTITY, "The specification takes too long to check",
        "The check of a specification is limited to `--wall-seconds`; use a coarser mesh or fewer bodies.";
    ForeignHost, "foreign-host", MISDIRECTED_REQUEST, "The service does not have this host name",
        "A service on a loopback address without tokens accepts only `localhost` and its own address as the host, so \
         that no web page can reach it under a foreign name; `dvi serve --host NAME` adds a name.";
    BadHost, "bad-host", BAD_REQUEST, "The request does not name one host",
        "A request has exactly one `Host`, a name or an address with or without a port (RFC 9112, section 3.2).";
    TooManyStreams, "too-many-streams", SERVICE_UNAVAILABLE, "Too many streams of events are open",
        "The number of open streams has reached `--streams`; ask `GET /jobs/{id}` meanwhile.";
    Draining, "draining", SERVICE_UNAVAILABLE, "The service is about to stop",
        "The service has been asked to stop and accepts no more jobs; ask its successor.";
}

/// An occurrence of a problem (RFC 9457).
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = ProblemDetails)]
pub struct Problem {
    /// The URL of the page that explains the problem.
    #[serde(rename = "type", serialize_with = "address_of")]
    #[schema(value_type = String)]
    kind: Kind,
    /// The title of the problem, equal for every occurrence.
    title: &'static str,
    /// The HTTP status of the response.
    status: u16,
    /// The cause of this occurrence of the problem.
    detail: String,
    /// The URL of the job that the problem concerns.
    #[serde(skip_serializing_if = "Option::is_none")]
    instance: Option<String>,
    /// All errors of the specification, if the problem is that it is invalid.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    errors: Vec<Finding>,
    #[serde(skip)]
    #[schema(ignore)]
    retry_after: Option<Duration>,
}

/// The result of a request handler; problems are boxed, since they are large and rare.
pub type HandlerResult<T> = Result<T, Box<Problem>>;

impl Problem {
    /// Creates a problem of `kind`; `detail` describes the occurrence.
    pub fn new(kind: Kind, detail: impl Into<String>) -> Box<Self> {
        Box::new(Self {
            kind,
            title: kind.title(),
            status: kind.status().as_u16(),
            detail: detail.into(),
            instance: None,
            errors: Vec::new(),
            retry_after: None,
        })
    }

    /// Creates a problem of `kind`, described by the general text of its kind.
    pub fn plain(kind: Kind) -> Box<Self> {
        Self::new(kind, kind.meaning())
    }

    /// Returns the kind of the problem.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// Returns the description of this occurrence of the problem.
    pub fn detail(&self) -> &str {
        &self.detail
    }

    /// Returns the errors of the specification that the problem reports, if any.
    pub fn errors(&self) -> &[Finding] {
        &self.errors
    }

    /// Names the job that the problem concerns.
    pub fn of_job(mut self: Box<Self>, id: JobId) -> Box<Self> {
        self.instance = Some(address(format_args!("/jobs/{id}")));
        self
    }

    /// Sets the time after which the client should retry, sent as `Retry-After`.
    pub fn after(mut self: Box<Self>, time: Duration) -> Box<Self> {
        self.retry_after = Some(time);
        self
    }
}

impl From<Vec<SpecificationError>> for Box<Problem> {
    fn from(errors: Vec<SpecificationError>) -> Self {
        errors.into_iter().map(Finding::from).collect::<Vec<_>>().into()
    }
}

impl From<Vec<Finding>> for Box<Problem> {
    fn from(errors: Vec<Finding>) -> Self {
        let detail = match errors.as_slice() {
            [error] if error.pointer.is_empty() => error.detail.clone(),
            [error] => format!("{}: {}", error.pointer, error.detail),
            errors => format!("{} errors", errors.len()),
        };
        let mut problem = Problem::new(Kind::InvalidSpecification, detail);
        problem.errors = errors;
        problem
    }
}

impl From<AdmissionError> for Box<Problem> {
    fn from(error: AdmissionError) -> Self {
        match error {
            AdmissionError::QueueFull(time) => Problem::plain(Kind::QueueFull).after(time),
            AdmissionError::QueueBytes(time) => Problem::plain(Kind::QueueBytes).after(time),
            AdmissionError::ClientShare(time) => Problem::plain(Kind::ClientShare).after(time),
            AdmissionError::Memory(bytes) => {
                let detail = format!("about {} MiB are needed: {}", bytes >> 20, Kind::TooMuchMemory.meaning());
                Problem::new(Kind::TooMuchMemory, detail)
            }
            AdmissionError::KeyReused => Problem::plain(Kind::KeyReused),
            AdmissionError::KeyInUse => Problem::plain(Kind::KeyInUse).after(Duration::from_secs(1)),
            AdmissionError::Unwritable => Unwritable.into(),
            AdmissionError::Away => Away.into(),
            AdmissionError::Draining => Problem::plain(Kind::Draining).after(Duration::from_secs(10)),
        }
    }
}

impl From<Unwritable> for Box<Problem> {
    fn from(_: Unwritable) -> Self {
        Problem::plain(Kind::Unwritable).after(Duration::from_secs(10))
    }
}

impl From<Away> for Box<Problem> {
    fn from(_: Away) -> Self {
        Problem::plain(Kind::StoreAway).after(Duration::from_secs(5))
    }
}

impl From<Fault> for Box<Problem> {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Defect => {
                Problem::new(Kind::Defect, "the solver failed with a defect on this specification; please report it")
            }
            Fault::TooMuchMemory { allowed, asked, estimate } => {
                let asked =
                    asked.map_or(String::new(), |bytes| format!(", with a last request of {} MiB", bytes >> 20));
                let estimate =
                    estimate.map_or(String::new(), |bytes| format!("; the estimate was {} MiB", bytes >> 20));
                let detail = format!("the process exceeded its {} MiB of memory{asked}{estimate}", allowed >> 20);
                Problem::new(Kind::TooMuchMemory, detail)
            }
            Fault::StackOverflow => Problem::plain(Kind::StackOverflow),
            Fault::Killed { signal } => {
                Problem::new(Kind::Killed, format!("signal {signal}: {}", Kind::Killed.meaning()))
            }
            Fault::Overran => Problem::plain(Kind::Overran),
            Fault::Poisoned => Problem::plain(Kind::Poisoned),
            Fault::Unreadable => Problem::plain(Kind::Unreadable),
            Fault::Damaged => Problem::plain(Kind::Damaged),
            Fault::Unwritable => Unwritable.into(),
            Fault::TooLarge { limit } => Problem::new(
                Kind::ResultTooLarge,
                format!("the result has more than {} MiB: ask for fewer output times or fields", limit >> 20),
            ),
        }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        // A problem consists of strings and numbers, so that encoding it cannot fail.
        let body = serde_json::to_vec(&self).unwrap_or_default();
        let mut response = (self.kind.status(), body).into_response();
        response.extensions_mut().insert(self.kind);
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
        if let Some(time) = self.retry_after {
            headers.insert(header::RETRY_AFTER, retry_after(time));
        }
        response
    }
}

impl IntoResponse for Box<Problem> {
    fn into_response(self) -> Response {
        (*self).into_response()
    }
}

fn address_of<S: Serializer>(kind: &Kind, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&address(format_args!("/problems/{}", kind.slug())))
}
