//! `GET /examples` and `GET /examples/{name}`: specifications that can be posted to `/solve`.

use super::path::Segment;
use super::problem::{HandlerResult, Kind, Problem};
use crate::context::address;
use axum::Json;
use axum::http::{HeaderName, header};
use axum::response::IntoResponse;
use serde::{Deserialize, Serialize};
use specification::{EXAMPLES, Example};
use utoipa::ToSchema;

/// The entry of an example in the list of examples.
#[derive(Debug, Serialize, ToSchema)]
pub struct Entry {
    /// The name of the example.
    name: &'static str,
    /// A short description of the example.
    title: String,
    /// The URL of the example.
    href: String,
}

/// The label of an example, which is the only part of its specification that the list of examples needs.
#[derive(Deserialize)]
struct Labelled {
    label: Option<String>,
}

impl From<&Example> for Entry {
    fn from(example: &Example) -> Self {
        let label = serde_json::from_str::<Labelled>(example.text).ok().and_then(|labelled| labelled.label);
        let title = label.unwrap_or_else(|| example.name.to_owned());
        Self { name: example.name, title, href: address(format_args!("/examples/{}", example.name)) }
    }
}

/// List the examples.
///
/// Names, titles and URLs of specifications that are ready to be posted to `/solve`.
#[utoipa::path(
    get,
    path = "/examples",
    tag = "catalogue",
    responses((status = 200, description = "All examples", body = Vec<Entry>), Problem)
)]
pub async fn list_examples() -> Json<Vec<Entry>> {
    Json(EXAMPLES.iter().map(Entry::from).collect())
}

/// Fetch an example.
///
/// The specification of the example, ready to be posted to `/solve`, with or without changes.
#[utoipa::path(
    get,
    path = "/examples/{name}",
    tag = "catalogue",
    params(("name" = String, Path, description = "The name of an example in the list")),
    responses((status = 200, description = "A specification", body = specification::Document), Problem)
)]
pub async fn find_example(Segment(name): Segment) -> HandlerResult<impl IntoResponse> {
    const JSON: [(HeaderName, &str); 1] = [(header::CONTENT_TYPE, "application/json")];
    let example = EXAMPLES.iter().find(|example| example.name == name);
    example.map(|example| (JSON, example.text)).ok_or_else(|| Problem::plain(Kind::NoSuchExample))
}
