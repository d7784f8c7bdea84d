//! `GET /methods`: the available methods with their checked conditions, and the limits in force.

use super::Shared;
use super::problem::Problem;
use crate::options::Bound;
use axum::Json;
use axum::extract::State;
use serde::Serialize;
use specification::{Catalogue, catalogue};

/// The catalogue of methods, and the limits of the service.
#[derive(Debug, Serialize)]
pub struct Methods {
    #[serde(flatten)]
    catalogue: &'static Catalogue,
    service: Vec<Bound>,
}

/// List problem types, methods and limits.
///
/// Types of problems, sets, methods with their tableaux and checked conditions, and the limits of this service, each
/// with its command-line flag.
#[utoipa::path(
    get,
    path = "/methods",
    tag = "catalogue",
    responses(
        (status = 200, description = "Problem types, methods, tableaux with their verified conditions, solvers, limits", body = serde_json::Value),
        Problem
    )
)]
pub async fn list_methods(State(shared): State<Shared>) -> Json<Methods> {
    Json(Methods { catalogue: catalogue(), service: shared.options.in_force() })
}
