//! The resources of the service, a file each, and the router that finds them.

mod access;
mod check;
mod document;
mod examples;
mod health;
mod jobs;
mod methods;
mod observe;
mod path;
mod preferences;
mod problem;
mod problems;
mod representation;
mod results;
mod schema;
mod solve;
mod status;

pub use problem::{Kind, Problem};

use super::access::Tokens;
use super::jobs::Jobs;
use super::{Options, page};
use axum::Router;
use axum::http::{HeaderName, HeaderValue, Method, Uri, header};
use axum::middleware::{from_fn, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use std::any::Any;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Semaphore;
use tower_http::catch_panic::CatchPanicLayer;

/// What handlers share.
#[derive(Clone)]
pub struct Shared {
    /// The jobs of the service.
    pub jobs: Arc<Jobs>,
    /// Its bounds.
    pub options: Arc<Options>,
    /// The tokens of clients, where they are asked for.
    pub tokens: Option<Arc<Tokens>>,
    /// Large specifications that may be read, and large pictures that may be drawn, at a time.
    pub readers: Arc<Semaphore>,
}

/// One line a resource.
pub fn router(shared: Shared) -> Router {
    let work = Router::new()
        .route("/solve", post(solve::solve))
        .route("/check", post(check::check))
        .route("/jobs/{id}", get(jobs::find_job).delete(jobs::delete_job))
        .route("/jobs/{id}/results", get(results::find_results))
        .route("/jobs/{id}/specification", get(jobs::find_specification))
        .route("/jobs/{id}/cancel", post(jobs::cancel_job))
        .route_layer(from_fn_with_state(shared.clone(), access::authorize));
    // The same for everyone, and nobody's secret.
    let open = Router::new()
        .route("/examples", get(examples::list_examples))
        .route("/examples/{name}", get(examples::find_example))
        .route("/methods", get(methods::list_methods))
        .route("/problems", get(problems::list_problems))
        .route("/problems/{slug}", get(problems::find_problem))
        .route("/schema", get(schema::find_schema))
        .route("/healthz", get(health::check_health))
        .route("/readyz", get(health::check_readiness))
        .route("/version", get(health::find_version));
    work.merge(open)
        .merge(page::routes())
        .fallback(nothing_here)
        .method_not_allowed_fallback(no_such_method)
        .layer(CatchPanicLayer::custom(panicked))
        .layer(from_fn(observe::observe))
        .with_state(shared)
}

async fn nothing_here(uri: Uri) -> Box<Problem> {
    let here = "GET /, POST /solve, POST /check, GET /jobs/{id}, GET /jobs/{id}/results, GET /jobs/{id}/specification, \
                POST /jobs/{id}/cancel, DELETE /jobs/{id}, GET /examples, GET /methods, GET /problems, GET /schema, GET /healthz, GET /readyz, GET /version";
    Problem::new(Kind::NotFound, format!("{} names nothing; there are {here}", uri.path()))
}

async fn no_such_method(method: Method, uri: Uri) -> Box<Problem> {
    Problem::new(Kind::MethodNotAllowed, format!("{} has no {method}", uri.path()))
}

fn panicked(_: Box<dyn Any + Send>) -> Response {
    Problem::plain(Kind::Internal).into_response()
}

/// The state of a job is of this moment only.
fn no_store() -> [(HeaderName, HeaderValue); 1] {
    [(header::CACHE_CONTROL, HeaderValue::from_static("no-store"))]
}

/// The value of `Retry-After`: whole seconds, at least one, and at most ten minutes, after which a look is worth
/// while however slow the queue was.
fn retry_after(time: Duration) -> HeaderValue {
    HeaderValue::from(time.as_secs_f64().ceil().clamp(1.0, 600.0) as u64)
}
