//! `GET /openapi.json`: the description of the HTTP interface (`OpenAPI` 3.1), generated from the handlers.

use super::described;
use super::problem::Problem;
use super::{open, work};
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::IntoResponse;
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::LazyLock;
use utoipa::openapi::response::{Response, ResponseBuilder};
use utoipa::openapi::{ContentBuilder, Ref, RefOr};
use utoipa::{IntoResponses, OpenApi, ToSchema};

const JSON: [(HeaderName, &str); 1] = [(header::CONTENT_TYPE, "application/json")];

/// The content security policy of the pages of the guide: they may load the style sheet and the icon of the service,
/// send the search form, and nothing else.
pub(super) const POLICY: HeaderValue = HeaderValue::from_static(
    "default-src 'none'; style-src 'self'; img-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
);

/// The `OpenAPI` description, generated once.
pub(super) static DESCRIPTION: LazyLock<Value> = LazyLock::new(description);
static TEXT: LazyLock<String> = LazyLock::new(|| DESCRIPTION.to_string());

/// The parts of the `OpenAPI` description that belong to no handler.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "dvi",
        description = "Differential variational inequalities, solved with evidence.",
        contact(name = "The operator of this service")
    ),
    components(schemas(specification::Document, Problem)),
    tags(
        (name = "solve", description = "Solve and check specifications"),
        (name = "jobs", description = "Jobs, from their acceptance until their deletion"),
        (name = "catalogue", description = "Methods, examples, codes, schema and guide"),
        (name = "service", description = "The state of the service")
    )
)]
struct Frame;

/// Returns the `OpenAPI` description of the HTTP interface, generated from the code.
pub fn description() -> Value {
    let mut router = utoipa_axum::router::OpenApiRouter::with_openapi(Frame::openapi()).merge(work()).merge(open());
    // An `OpenAPI` description consists of strings, lists and maps, so that encoding it cannot fail.
    let mut description = serde_json::to_value(router.to_openapi()).unwrap_or_default();
    let mut work = utoipa_axum::router::OpenApiRouter::<super::Shared>::new().merge(work());
    let asks_token = work.to_openapi().paths.paths.into_keys().collect();
    described::complete(&mut description, &asks_token);
    description
}

/// Describes the default response of every operation: a problem (RFC 9457).
impl IntoResponses for Problem {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        let content = ContentBuilder::new().schema(Some(Ref::from_schema_name(Self::name()))).build();
        let response = ResponseBuilder::new()
            .description("A problem of the table at `/problems`, by its status (RFC 9457)")
            .content("application/problem+json", content);
        BTreeMap::from([("default".to_owned(), response.build().into())])
    }
}

/// Fetch the `OpenAPI` description.
///
/// The description of the HTTP interface, from which clients can be generated.
#[utoipa::path(
    get,
    path = "/openapi.json",
    tag = "catalogue",
    responses((status = 200, description = "OpenAPI 3.1", body = Value))
)]
pub async fn find_description() -> impl IntoResponse {
    (JSON, TEXT.as_str())
}
