//! `GET /problems` and `GET /problems/{slug}`: what the `type` of an error answers to.

use super::path::Segment;
use super::problem::{Answer, Kind, Problem};
use axum::Json;
use serde::Serialize;
use utoipa::ToSchema;

/// A row of the table of problems.
#[derive(Debug, Serialize, ToSchema)]
pub struct Row {
    #[serde(rename = "type")]
    address: String,
    title: &'static str,
    status: u16,
    meaning: &'static str,
}

impl From<Kind> for Row {
    fn from(kind: Kind) -> Self {
        let address = format!("/problems/{}", kind.slug());
        Self { address, title: kind.title(), status: kind.status().as_u16(), meaning: kind.meaning() }
    }
}

/// List the types of problems.
#[utoipa::path(
    get,
    path = "/problems",
    tag = "catalogue",
    responses((status = 200, description = "The table", body = Vec<Row>), Problem)
)]
pub async fn list_problems() -> Json<Vec<Row>> {
    Json(Kind::ALL.iter().copied().map(Row::from).collect())
}

/// Describe a type of problem.
#[utoipa::path(
    get,
    path = "/problems/{slug}",
    tag = "catalogue",
    params(("slug" = String, Path, description = "The last segment of a `type`")),
    responses((status = 200, description = "Its row", body = Row), Problem)
)]
pub async fn find_problem(Segment(slug): Segment) -> Answer<Json<Row>> {
    let kind = Kind::ALL.iter().copied().find(|kind| kind.slug() == slug);
    kind.map(|kind| Json(kind.into())).ok_or_else(|| Problem::plain(Kind::NoSuchProblem))
}
