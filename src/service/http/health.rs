//! `GET /healthz`, `GET /readyz`, `GET /version`.

use super::Shared;
use super::problem::{HandlerResult, Kind, Problem};
use axum::Json;
use axum::extract::State;
use serde::Serialize;
use std::time::Duration;
use utoipa::ToSchema;

/// That all is well.
#[derive(Debug, Serialize, ToSchema)]
pub struct Well {
    /// `alive` or `ready`.
    status: &'static str,
}

/// What runs here.
#[derive(Debug, Serialize, ToSchema)]
pub struct Version {
    /// The name of the program.
    name: &'static str,
    /// Its version.
    version: &'static str,
}

/// Tell whether the service is alive.
///
/// For probes that restart what does not answer. It needs no token and answers to any `Host`, also while the service stops.
#[utoipa::path(
    get,
    path = "/healthz",
    tag = "service",
    responses((status = 200, description = "The service is alive", body = Well), Problem)
)]
pub async fn check_health() -> Json<Well> {
    Json(Well { status: "alive" })
}

/// Tell whether the service takes on work.
///
/// For load balancers. It is 503 while the service stops (`draining`), while the store takes nothing (`unwritable`), while the servers of the jobs are
/// away (`store-away`), and while no worker can be started (`no-workers`). It needs no token and answers to any `Host`.
#[utoipa::path(
    get,
    path = "/readyz",
    tag = "service",
    responses((status = 200, description = "The service accepts jobs", body = Well), Problem)
)]
pub async fn check_readiness(State(shared): State<Shared>) -> HandlerResult<Json<Well>> {
    if shared.jobs.is_draining() {
        return Err(Problem::plain(Kind::Draining));
    }
    shared.jobs.near()?;
    if !shared.jobs.is_writable() {
        return Err(Problem::plain(Kind::Unwritable));
    }
    if !shared.jobs.has_workers() {
        return Err(Problem::plain(Kind::NoWorkers).after(Duration::from_secs(10)));
    }
    Ok(Json(Well { status: "ready" }))
}

/// Tell which version runs.
///
/// The name and the version of the program.
#[utoipa::path(
    get,
    path = "/version",
    tag = "service",
    responses((status = 200, description = "Name and version", body = Version), Problem)
)]
pub async fn find_version() -> Json<Version> {
    Json(Version { name: "dvi", version: env!("CARGO_PKG_VERSION") })
}
