//! The guide: chapters written in Markdown (`api/guide`), and three generated ones, which list every key of a
//! specification, every field of a response and every error code. The guide is rendered once, on its first request.

mod markdown;
mod reference;
mod search;

pub use search::{Found, search};

use serde_json::Value;
use std::sync::LazyLock;

/// The Markdown source of a chapter, as it stands in `api/guide`.
struct Source {
    name: &'static str,
    text: &'static str,
}

macro_rules! chapters {
    ($($name:literal)*) => {
        &[$(Source {
            name: $name,
            text: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../api/guide/", $name, ".md")),
        }),*]
    };
}

/// Every Markdown file of `api/guide`, in reading order.
const SOURCES: &[Source] = chapters! {
    "start"
    "specification"
    "expressions"
    "problems"
    "methods"
    "evidence"
    "examples"
    "recipes"
    "administration"
};

/// A section of a chapter: a heading and the text below it.
#[derive(Debug)]
pub struct Section {
    /// The id of the section's heading, used in links.
    pub id: String,
    /// The heading of the section, without markup.
    pub heading: String,
    /// The text below the heading, without markup.
    pub text: String,
}

/// A chapter of the guide, rendered as HTML.
#[derive(Debug)]
pub struct Chapter {
    /// The last segment of the chapter's URL path.
    pub name: String,
    /// The title of the chapter: its first heading.
    pub title: String,
    /// The body of the chapter as HTML.
    pub html: String,
    /// The sections of the chapter of the guide, in reading order.
    pub sections: Vec<Section>,
}

/// Returns all chapters of the guide; `answer` is the `OpenAPI` description of the service, from which the fields of
/// responses are listed.
pub fn chapters(answer: &Value) -> Vec<Chapter> {
    let written = SOURCES.iter().map(|source| markdown::chapter(source.name, source.text));
    written.chain([reference::keys(&SCHEMA), reference::answer(answer), reference::codes()]).collect()
}

/// The JSON Schema of a specification, parsed once.
static SCHEMA: LazyLock<Value> = LazyLock::new(|| {
    let text = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../api/specification.schema.json"));
    // Parsing cannot fail: a test compares the schema file with the schema that the code generates.
    serde_json::from_str(text).unwrap_or_default()
});

/// Escapes the special characters of HTML in `text`.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Converts text to HTML, with the text between backticks as code.
fn with_code(text: &str) -> String {
    let escaped = escaped(text);
    let parts = escaped.split('`').enumerate();
    parts.map(|(k, part)| if k % 2 == 1 { format!("<code>{part}</code>") } else { part.to_owned() }).collect()
}

/// Returns the id of a heading: its letters, digits and underscores in lower case, with hyphens between words.
fn id_of(heading: &str) -> String {
    let words = heading.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|word| !word.is_empty());
    words.collect::<Vec<_>>().join("-").to_lowercase()
}
