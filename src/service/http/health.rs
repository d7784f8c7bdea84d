//! The state of the service for monitoring: `GET /healthz`, `GET /readyz`, `GET /version`.

use super::Shared;
use super::problem::{HandlerResult, Kind, Problem};
use axum::Json;
use axum::extract::State;
use serde::Serialize;
use std::time::Duration;
use utoipa::ToSchema;

/// The response of a service that is alive, or ready for jobs.
#[derive(Debug, Serialize, ToSchema)]
pub struct Well {
    /// The state of the service, `alive` or `ready`.
    status: &'static str,
}

/// The name and the version of the program that runs the service.
#[derive(Debug, Serialize, ToSchema)]
pub struct Version {
    /// The name of the program.
    name: &'static str,
    /// The version of the program.
    version: &'static str,
}

/// Tell whether the service is alive.
///
/// For probes that restart a service that does not respond. Needs no token and accepts any `Host`, also while the
/// service stops.
#[utoipa::path(
    get,
    path = "/healthz",
    tag = "service",
    responses((status = 200, description = "The service is alive", body = Well), Problem)
)]
pub async fn check_health() -> Json<Well> {
    Json(Well { status: "alive" })
}

/// Tell whether the service accepts jobs.
///
/// For load balancers. The status is 503 while the service stops (`draining`), while the job store cannot be written
/// (`unwritable`), while the NATS servers of the jobs do not respond (`store-away`), and while no worker can be
/// started (`no-workers`). Needs no token and accepts any `Host`.
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

/// Tell the version of the service.
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
