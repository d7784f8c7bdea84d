//! The HTTP resources of the service, one file each, and the router.

mod access;
mod access_log;
mod again;
mod check;
mod cors;
mod described;
mod docs;
mod document;
mod event_stream;
mod events;
mod examples;
mod excerpt;
mod guide;
mod health;
mod host;
mod job_list;
mod jobs;
mod methods;
mod metrics;
mod negotiation;
mod observe;
mod openapi;
mod origin;
mod part;
mod path;
mod pieces;
mod preferences;
mod problem;
mod problems;
mod query;
mod representation;
mod results;
mod schema;
mod security;
mod solve;
mod solve_stream;
mod status;

pub use openapi::description;
pub use pieces::Room;
pub use problem::{Kind, Problem};

use super::access::Tokens;
use super::compiled::Compiled;
use super::jobs::{Client, Jobs, Turns};
use super::metrics::Metrics;
use super::worker::Checkers;
use super::{Options, page};
use axum::Router;
use axum::http::{HeaderName, HeaderValue, Method, Uri, header};
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use std::any::Any;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Semaphore, watch};
use tower_http::CompressionLevel;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::CompressionLayer;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// The state of the service, shared by all HTTP request handlers.
pub type Shared = Arc<Common>;

/// The state of the service that request handlers use.
pub struct Common {
    /// The jobs of the service, with their queue and their store.
    pub jobs: Arc<Jobs>,
    /// The options with which the service was started.
    pub options: Options,
    /// The metrics of the service.
    pub metrics: Arc<Metrics>,
    /// The access tokens of clients, if the service requires tokens.
    pub tokens: Option<Arc<Tokens>>,
    /// The cache of compiled specifications and their solutions.
    pub compiled: Compiled,
    /// Limits how many large responses are prepared concurrently; clients take turns.
    pub turns: Arc<Turns>,
    /// Limits how many specifications are checked concurrently by workers; clients take turns.
    pub checks: Arc<Turns>,
    /// The worker processes that check specifications.
    pub checkers: Arc<Checkers>,
    /// The memory budget of responses that have not been sent completely.
    pub room: Room,
    /// Permits for open event streams, whose number is limited.
    pub streams: Arc<Semaphore>,
    /// Permits for open connections, whose number is limited.
    pub connections: Arc<Semaphore>,
    /// Set to true when the service stops, to end all event streams.
    pub closing: watch::Sender<bool>,
}

impl Common {
    /// Whether an admitted client may stay connected: its token is neither revoked nor expired.
    fn admits(&self, client: Client) -> bool {
        match (&self.tokens, client) {
            (Some(tokens), Client::Token(number)) => tokens.knows(number),
            (None, _) | (Some(_), Client::Address(_)) => true,
        }
    }
}

/// Returns the routes for the work of clients, which may require a token; one line per path.
fn work() -> OpenApiRouter<Shared> {
    OpenApiRouter::new()
        .routes(routes!(solve::solve))
        .routes(routes!(check::check))
        .routes(routes!(job_list::list_jobs))
        .routes(routes!(jobs::find_job, jobs::delete_job))
        .routes(routes!(events::follow_job))
        .routes(routes!(results::find_results))
        .routes(routes!(jobs::find_specification))
        .routes(routes!(jobs::cancel_job))
        .routes(routes!(again::retry_job))
        .routes(routes!(again::continue_job))
}

/// Returns the routes that are the same for all clients and need no token.
fn open() -> OpenApiRouter<Shared> {
    OpenApiRouter::new()
        .routes(routes!(examples::list_examples))
        .routes(routes!(examples::find_example))
        .routes(routes!(methods::list_methods))
        .routes(routes!(problems::list_problems))
        .routes(routes!(problems::find_problem))
        .routes(routes!(schema::find_schema))
        .routes(routes!(openapi::find_description))
        .routes(routes!(guide::read_guide))
        .routes(routes!(guide::read_chapter))
        .routes(routes!(guide::search_guide))
        .routes(routes!(guide::read_description))
        .routes(routes!(guide::find_style))
        .routes(routes!(health::check_health))
        .routes(routes!(health::check_readiness))
        .routes(routes!(health::find_version))
        .routes(routes!(metrics::list_metrics))
}

/// Returns the router of all HTTP resources, with the middleware common to them.
pub fn router(shared: Shared) -> Router {
    let work = match &shared.tokens {
        Some(tokens) => work().route_layer(from_fn_with_state(Arc::clone(tokens), access::authorize)),
        None => work(),
    };
    // The three middlewares form one layer: between layers, the router boxes the service and its response, which
    // takes longer than the middleware.
    let common = (
        from_fn_with_state(Arc::clone(&shared), observe::observe),
        CompressionLayer::new().quality(CompressionLevel::Fastest),
        CatchPanicLayer::custom(panicked),
    );
    let prefix = shared.options.prefix();
    let router = Router::from(work.merge(open()))
        .merge(page::routes(&prefix))
        .fallback(nothing_here)
        .method_not_allowed_fallback(no_such_method)
        .layer(common)
        .with_state(shared);
    // Routes exist with and without the path prefix, since some proxies pass it on and others strip it.
    if prefix.is_empty() { router } else { router.clone().nest(&prefix, router) }
}

async fn nothing_here(uri: Uri) -> Box<Problem> {
    Problem::new(
        Kind::NotFound,
        format!("there is nothing at {}; /openapi.json and /docs list all addresses", uri.path()),
    )
}

async fn no_such_method(method: Method, uri: Uri) -> Box<Problem> {
    Problem::new(Kind::MethodNotAllowed, format!("{} does not allow {method}", uri.path()))
}

fn panicked(_: Box<dyn Any + Send>) -> Response {
    Problem::plain(Kind::Internal).into_response()
}

/// Returns a header that forbids caching, for responses that change over time, such as the state of a job.
fn no_store() -> [(HeaderName, HeaderValue); 1] {
    [(header::CACHE_CONTROL, HeaderValue::from_static("no-store"))]
}

/// Returns the value of `Retry-After`: whole seconds, at least one, and at most ten minutes, after which a retry is
/// reasonable even if the queue is slow.
fn retry_after(time: Duration) -> HeaderValue {
    HeaderValue::from(time.as_secs_f64().ceil().clamp(1.0, 600.0) as u64)
}
