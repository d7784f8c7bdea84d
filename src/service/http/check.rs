//! `POST /check`: the errors of a specification, or its summary. The request creates no job.

use super::Shared;
use super::document::Document;
use super::problem::{HandlerResult, Problem};
use crate::jobs::Client;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};

/// Check a specification without solving it.
///
/// The response has the size, the method and the warnings of a correct specification, or all errors of an incorrect
/// one, each with a JSON pointer. No job is created. The check is stopped if its client disconnects.
#[utoipa::path(
    post,
    path = "/check",
    tag = "solve",
    request_body(content = specification::Document, content_type = "application/json"),
    responses(
        (status = 200, description = "The specification has no errors; its summary", body = serde_json::Value),
        Problem
    )
)]
pub async fn check(State(shared): State<Shared>, client: Client, document: Document) -> HandlerResult<Response> {
    let summary = document.checked(&shared, client).await?.summary();
    Ok(([(header::CONTENT_TYPE, "application/json")], summary).into_response())
}
