//! `GET /docs`: the guide, one page per chapter, with a search; and `GET /docs/interface`, the `OpenAPI` description
//! as a page. The pages run no scripts and load nothing from other hosts.

use super::docs;
use super::openapi::{DESCRIPTION, POLICY};
use super::path::Segment;
use super::problem::{HandlerResult, Kind, Problem};
use crate::context::address;
use crate::guide::{self, Chapter, escaped};
use axum::extract::RawQuery;
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::{Html, IntoResponse};
use std::fmt::Write as _;
use std::sync::LazyLock;

const STYLE: &str = include_str!("docs.css");
const CSS: [(HeaderName, &str); 1] = [(header::CONTENT_TYPE, "text/css; charset=utf-8")];

/// The length in characters to which a search query is truncated.
const LONGEST_QUERY: usize = 200;

static CHAPTERS: LazyLock<Vec<Chapter>> = LazyLock::new(|| guide::chapters(&DESCRIPTION));
static INTERFACE: LazyLock<String> = LazyLock::new(|| page("Interface", "interface", &docs::body(&DESCRIPTION)));

type Page = ([(HeaderName, HeaderValue); 1], Html<String>);

/// Returns a page with its content security policy and with links under the path prefix of the request.
fn answered(html: &str) -> Page {
    ([(header::CONTENT_SECURITY_POLICY, POLICY)], Html(html.replace("=\"/", &format!("=\"{}", address("/")))))
}

/// Read the guide.
///
/// The first chapter as an HTML page without scripts, with links to the other chapters.
#[utoipa::path(
    get,
    path = "/docs",
    tag = "catalogue",
    responses((status = 200, description = "A page", body = String, content_type = "text/html"))
)]
pub async fn read_guide() -> HandlerResult<Page> {
    find(CHAPTERS.first())
}

/// Read a chapter of the guide.
///
/// An HTML page. Links in the guide name the chapters, such as `methods` or `evidence`.
#[utoipa::path(
    get,
    path = "/docs/{chapter}",
    tag = "catalogue",
    params(("chapter" = String, Path, description = "The name of a chapter")),
    responses((status = 200, description = "A page", body = String, content_type = "text/html"), Problem)
)]
pub async fn read_chapter(Segment(name): Segment) -> HandlerResult<Page> {
    find(CHAPTERS.iter().find(|chapter| chapter.name == name))
}

fn find(chapter: Option<&Chapter>) -> HandlerResult<Page> {
    let chapter = chapter.ok_or_else(|| Problem::plain(Kind::NotFound))?;
    Ok(answered(&page(&chapter.title, &chapter.name, &chapter.html)))
}

/// Search in the guide.
///
/// The sections in which every word of the query occurs, as an HTML page.
#[utoipa::path(
    get,
    path = "/docs/search",
    tag = "catalogue",
    params(("q" = Option<String>, Query, description = "The words, at most 200 characters")),
    responses((status = 200, description = "A page", body = String, content_type = "text/html"))
)]
pub async fn search_guide(RawQuery(query): RawQuery) -> Page {
    let pairs = form_urlencoded::parse(query.as_deref().unwrap_or_default().as_bytes());
    let words =
        pairs.into_iter().find(|(name, _)| name == "q").map(|(_, value)| value.into_owned()).unwrap_or_default();
    let words: String = words.chars().take(LONGEST_QUERY).collect();
    let found = guide::search(&CHAPTERS, &words);
    let count = match found.len() {
        0 => "Nothing was found.".to_owned(),
        1 => "One section.".to_owned(),
        n => format!("{n} sections."),
    };
    let mut html = format!("<h1>Search: {}</h1>\n<p>{count}</p>\n<ul class=\"found\">\n", escaped(&words));
    for one in found {
        // Writing HTML to a string cannot fail.
        let _ = writeln!(
            html,
            "<li><a href=\"/docs/{}#{}\">{}</a> <small>{}</small><p>{}</p></li>",
            one.chapter.name,
            one.section.id,
            escaped(&one.section.heading),
            escaped(&one.chapter.title),
            escaped(&one.excerpt)
        );
    }
    html.push_str("</ul>\n");
    answered(&page("Search", "search", &html))
}

/// Read the description of the interface.
///
/// The description of the HTTP interface as an HTML page without scripts.
#[utoipa::path(
    get,
    path = "/docs/interface",
    tag = "catalogue",
    responses((status = 200, description = "A page", body = String, content_type = "text/html"))
)]
pub async fn read_description() -> Page {
    answered(&INTERFACE)
}

/// Fetch the style sheet of the guide.
///
/// The style sheet of all pages under `/docs`.
#[utoipa::path(
    get,
    path = "/docs/style.css",
    tag = "catalogue",
    responses((status = 200, description = "A style sheet", body = String, content_type = "text/css"))
)]
pub async fn find_style() -> impl IntoResponse {
    (CSS, STYLE)
}

/// Renders a page of the guide around `body`: the list of chapters with the current one marked, and the search form.
fn page(title: &str, name: &str, body: &str) -> String {
    let mut links = String::new();
    let entries = CHAPTERS
        .iter()
        .map(|chapter| (chapter.name.as_str(), chapter.title.as_str()))
        .chain([("interface", "Interface over HTTP")]);
    for (other, title) in entries {
        let here = if other == name { " aria-current=\"page\"" } else { "" };
        let _ = writeln!(links, "<li><a href=\"/docs/{other}\"{here}>{}</a></li>", escaped(title));
    }
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{} · dvi</title>\n<link rel=\"icon\" href=\"/page/icon.svg\">\n\
         <link rel=\"stylesheet\" href=\"/docs/style.css\">\n</head>\n<body>\n<a class=\"skip\" href=\"#content\">Skip to the text</a>\n\
         <header>\n<a class=\"home\" href=\"/\">dvi</a>\n<form action=\"/docs/search\" method=\"get\" role=\"search\">\n\
         <input type=\"search\" name=\"q\" aria-label=\"Search the guide\" placeholder=\"Search the guide\" maxlength=\"{LONGEST_QUERY}\">\n\
         <button>Search</button>\n</form>\n</header>\n<div class=\"frame\">\n<nav aria-label=\"Chapters\"><ul>\n{links}</ul></nav>\n\
         <main id=\"content\" tabindex=\"-1\">\n{body}</main>\n</div>\n</body>\n</html>\n",
        escaped(title)
    )
}
