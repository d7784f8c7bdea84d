//! `GET /problems` and `GET /problems/{code}`: a page for every code of errors, warnings, verdicts and refusals, at
//! the URL that is the `type` of a problem: as JSON for programs, as HTML for browsers, as text for terminals.

use super::negotiation::{self, MediaType};
use super::path::Segment;
use super::problem::{HandlerResult, Kind, Problem};
use crate::context::address;
use axum::Json;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::{Html, IntoResponse, Response};
use explanation::Page;
use serde::Serialize;
use std::fmt::Write as _;
use utoipa::ToSchema;

/// The explanation of a code.
#[derive(Debug, Serialize, ToSchema)]
pub struct Row {
    /// The URL of the page of the code; of a refusal, it is the `type` of the problem.
    #[serde(rename = "type")]
    address: String,
    /// The name of the code, for programs.
    code: &'static str,
    /// A short title of the code.
    title: &'static str,
    /// The HTTP status of a response that refuses a request with this code.
    #[serde(skip_serializing_if = "Option::is_none")]
    status: Option<u16>,
    /// The meaning of the code.
    meaning: &'static str,
    /// Why the code occurs.
    why: &'static str,
    /// What to do about the code.
    remedy: &'static str,
    /// An example in which the code occurs.
    example: &'static str,
}

impl From<&'static Page> for Row {
    fn from(page: &'static Page) -> Self {
        let Page { code, meaning, why, remedy, example, .. } = *page;
        let refusal = Kind::ALL.iter().find(|kind| kind.slug().replace('-', "_") == code);
        let name = refusal.map_or(code, |kind| kind.slug());
        let title = refusal.map_or(page.kind.title(), |kind| kind.title());
        let status = refusal.map(|kind| kind.status().as_u16());
        Self { address: address(format_args!("/problems/{name}")), code, title, status, meaning, why, remedy, example }
    }
}

/// The format of a page that explains codes.
#[derive(Clone, Copy)]
enum Form {
    Json,
    Html,
    Text,
}

const FORMS: [(Form, MediaType); 3] =
    [(Form::Json, ("application", "json")), (Form::Html, ("text", "html")), (Form::Text, ("text", "plain"))];

/// List the codes of errors, warnings, verdicts and refusals.
///
/// The explanations of all codes; the URL of an explanation is the `type` of a problem.
#[utoipa::path(
    get,
    path = "/problems",
    tag = "catalogue",
    responses(
        (status = 200, description = "One row per code", content(
            (Vec<Row> = "application/json"), (String = "text/html"), (String = "text/plain")
        ), headers(("vary" = String, description = "`accept`"))),
        Problem
    )
)]
pub async fn list_problems(headers: HeaderMap) -> HandlerResult<Response> {
    let rows: Vec<Row> = explanation::pages().iter().map(Row::from).collect();
    answer(&headers, "Codes of errors, warnings and refusals", &rows, |rows| Json(rows).into_response())
}

/// Explain a code: what it means, why it occurs, what to do, an example.
///
/// The explanation as JSON, as an HTML page or as text, by `Accept`. A code may be written with underscores or
/// hyphens.
#[utoipa::path(
    get,
    path = "/problems/{code}",
    tag = "catalogue",
    params(("code" = String, Path, description = "A code, or the last segment of a `type`; `-` is read as `_`")),
    responses(
        (status = 200, description = "The page of the code", content(
            (Row = "application/json"), (String = "text/html"), (String = "text/plain")
        ), headers(("vary" = String, description = "`accept`"))),
        Problem
    )
)]
pub async fn find_problem(Segment(code): Segment, headers: HeaderMap) -> HandlerResult<Response> {
    let page = explanation::find(&code).ok_or_else(|| Problem::plain(Kind::NoSuchProblem))?;
    answer(&headers, page.code, &[Row::from(page)], |rows| Json(rows.first()).into_response())
}

fn answer(
    headers: &HeaderMap,
    title: &str,
    rows: &[Row],
    json: impl FnOnce(&[Row]) -> Response,
) -> HandlerResult<Response> {
    let mut response = match negotiation::choose(headers, &FORMS) {
        Some(Form::Json) => json(rows),
        Some(Form::Html) => Html(html(title, rows)).into_response(),
        Some(Form::Text) => rows.iter().map(text).collect::<Vec<_>>().join("\n").into_response(),
        None => return Err(Problem::plain(Kind::NotAcceptable)),
    };
    response.headers_mut().insert(header::VARY, HeaderValue::from_static("accept"));
    Ok(response)
}

fn text(row: &Row) -> String {
    let Row { code, meaning, why, remedy, example, .. } = row;
    format!("{code}\n  {meaning}\n  Why: {why}\n  What to do: {remedy}\n  Example: {example}\n")
}

fn html(title: &str, rows: &[Row]) -> String {
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>{title}</title>\n</head>\n<body>\n<h1>{title}</h1>\n"
    );
    for row in rows {
        // Writing HTML to a string cannot fail.
        let _ = write!(
            html,
            "<section id=\"{0}\">\n<h2><code>{0}</code></h2>\n<p>{1}</p>\n<dl>\n<dt>Why</dt><dd>{2}</dd>\n<dt>What to do</dt>\
             <dd>{3}</dd>\n<dt>Example</dt><dd>{4}</dd>\n</dl>\n</section>\n",
            row.code,
            marked_up(row.meaning),
            marked_up(row.why),
            marked_up(row.remedy),
            marked_up(row.example)
        );
    }
    html + "</body>\n</html>\n"
}

/// Converts text to HTML, with the text between backticks as code.
fn marked_up(text: &str) -> String {
    let escaped = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    let parts = escaped.split('`').enumerate();
    parts.map(|(k, part)| if k % 2 == 1 { format!("<code>{part}</code>") } else { part.to_owned() }).collect()
}
