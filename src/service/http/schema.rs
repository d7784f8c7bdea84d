//! `GET /schema`: the JSON Schema of specifications, as posted to `/solve`.

use super::problem::Problem;
use axum::http::{HeaderName, header};
use axum::response::IntoResponse;

const SCHEMA: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../api/specification.schema.json"));
const CONTENT_TYPE: [(HeaderName, &str); 1] = [(header::CONTENT_TYPE, "application/schema+json")];

/// Fetch the JSON Schema of a specification.
///
/// JSON Schema 2020-12, for editors that complete and check a specification during typing.
#[utoipa::path(
    get,
    path = "/schema",
    tag = "catalogue",
    responses(
        (status = 200, description = "A JSON Schema", body = serde_json::Value, content_type = "application/schema+json"),
        Problem
    )
)]
pub async fn find_schema() -> impl IntoResponse {
    (CONTENT_TYPE, SCHEMA)
}
