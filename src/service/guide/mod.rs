//! The guide: chapters of Markdown (`api/guide`), and beside them three that are made from what the program knows of itself: every
//! key of a specification, every field of an answer, every code. It is rendered once, when it is first asked for.

mod markdown;
mod reference;
mod search;

pub use search::{Found, search};

use serde_json::Value;
use std::sync::LazyLock;

/// A chapter as it stands in `api/guide`.
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

/// Every file of `api/guide`, in the order in which it is read.
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

/// A section: what stands below one heading.
#[derive(Debug)]
pub struct Section {
    /// The id of the heading.
    pub id: String,
    /// The heading as text.
    pub heading: String,
    /// The text below it, without markup.
    pub text: String,
}

/// A chapter that is ready to be shown.
#[derive(Debug)]
pub struct Chapter {
    /// The last segment of its address.
    pub name: String,
    /// Its first heading.
    pub title: String,
    /// Its body as HTML.
    pub html: String,
    /// Its sections, in order.
    pub sections: Vec<Section>,
}

/// All chapters; `answer` is the description of the interface, from which fields of answers are taken.
pub fn chapters(answer: &Value) -> Vec<Chapter> {
    let written = SOURCES.iter().map(|source| markdown::chapter(source.name, source.text));
    written.chain([reference::keys(&SCHEMA), reference::answer(answer), reference::codes()]).collect()
}

/// The JSON Schema of a specification.
static SCHEMA: LazyLock<Value> = LazyLock::new(|| {
    let text = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../api/specification.schema.json"));
    // A test holds it against the code that writes it.
    serde_json::from_str(text).unwrap_or_default()
});

/// Text, and no markup.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Text as HTML, what stands between backticks as code.
fn with_code(text: &str) -> String {
    let escaped = escaped(text);
    let parts = escaped.split('`').enumerate();
    parts.map(|(k, part)| if k % 2 == 1 { format!("<code>{part}</code>") } else { part.to_owned() }).collect()
}

/// The id of a heading: its letters, digits and underscores in lower case, hyphens between words.
fn id_of(heading: &str) -> String {
    let words = heading.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|word| !word.is_empty());
    words.collect::<Vec<_>>().join("-").to_lowercase()
}
