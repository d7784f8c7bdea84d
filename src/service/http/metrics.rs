//! `GET /metrics`: metrics for Prometheus, in the text format of `OpenMetrics` 1.0.

use super::Shared;
use super::problem::Problem;
use crate::places;
use axum::extract::State;
use axum::http::{HeaderName, header};
use axum::response::IntoResponse;

const CONTENT_TYPE: [(HeaderName, &str); 1] =
    [(header::CONTENT_TYPE, "application/openmetrics-text; version=1.0.0; charset=utf-8")];

/// Fetch the metrics of the service.
///
/// `OpenMetrics` text for Prometheus: jobs, workers, responses, the store, the process. Accepts any `Host`.
#[utoipa::path(
    get,
    path = "/metrics",
    tag = "service",
    responses(
        (status = 200, description = "OpenMetrics text", body = String, content_type = "application/openmetrics-text"),
        Problem
    )
)]
pub async fn list_metrics(State(shared): State<Shared>) -> impl IntoResponse {
    let connections = places(shared.options.connections).saturating_sub(shared.connections.available_permits());
    (CONTENT_TYPE, shared.metrics.text(&shared.jobs, connections, shared.checks.taken(shared.options.checkers())))
}
