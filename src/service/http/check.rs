//! `POST /check`: the errors of a specification, or what it comes to. It makes no job.

use super::Shared;
use super::document::Document;
use super::problem::Answer;
use crate::specification::Summary;
use axum::Json;
use axum::extract::State;

/// Check a specification without solving it.
pub async fn check(State(shared): State<Shared>, document: Document) -> Answer<Json<Summary>> {
    Ok(Json(document.specification(&shared).await?.summary()))
}
