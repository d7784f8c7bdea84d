//! A mismatch between a document and the types it is deserialised into: serde's error, kept as data instead of text.

use super::wording::abridged;
use serde::de::{self, Expected, Unexpected};
use std::fmt::{self, Display, Formatter};

/// A structural error of a document: a value that does not fit the type expected at its place.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(super) enum Mismatch {
    #[error("unknown key `{key}`")]
    UnknownKey { key: String, valid: &'static [&'static str] },
    #[error("missing key `{key}`")]
    MissingKey { key: &'static str },
    #[error("unknown choice `{name}`")]
    UnknownVariant { name: String, valid: &'static [&'static str] },
    #[error("found {found}")]
    NotAVariant { found: String, valid: &'static [&'static str] },
    #[error("found {found}")]
    WrongType { found: String, expected: String },
    #[error("{0}")]
    Other(String),
}

impl de::Error for Mismatch {
    fn custom<T: Display>(message: T) -> Self {
        Self::Other(message.to_string())
    }

    fn invalid_type(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::WrongType { found: Found(found).to_string(), expected: plain(&expected.to_string()) }
    }

    fn invalid_value(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::invalid_type(found, expected)
    }

    fn invalid_length(length: usize, expected: &dyn Expected) -> Self {
        Self::WrongType { found: format!("{length} entries"), expected: plain(&expected.to_string()) }
    }

    fn unknown_variant(name: &str, valid: &'static [&'static str]) -> Self {
        Self::UnknownVariant { name: name.into(), valid }
    }

    fn unknown_field(key: &str, valid: &'static [&'static str]) -> Self {
        Self::UnknownKey { key: key.into(), valid }
    }

    fn missing_field(key: &'static str) -> Self {
        Self::MissingKey { key }
    }
}

/// The value found in a document, shown in the terms of JSON instead of Rust.
struct Found<'a>(Unexpected<'a>);

impl Display for Found<'_> {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        match self.0 {
            Unexpected::Bool(value) => write!(formatter, "{value}"),
            Unexpected::Unsigned(value) => write!(formatter, "the number {value}"),
            Unexpected::Signed(value) => write!(formatter, "the number {value}"),
            Unexpected::Float(value) => write!(formatter, "the number {value}"),
            Unexpected::Str(text) => write!(formatter, "the string \"{}\"", abridged(text)),
            Unexpected::Unit | Unexpected::Option => formatter.write_str("null"),
            Unexpected::Seq => formatter.write_str("a list"),
            Unexpected::Map => formatter.write_str("an object"),
            ref other => write!(formatter, "{other}"),
        }
    }
}

/// Translates the Rust types of serde's expectations to the terms of JSON.
fn plain(expected: &str) -> String {
    match expected {
        "f64" => "a number".into(),
        "usize" | "u64" => "a whole number, zero or more".into(),
        "a sequence" => "a list".into(),
        _ if expected.starts_with("struct ") => "an object".into(),
        _ => match expected.split_once(" element") {
            Some((count, _)) => format!("{count} entries"),
            None => match expected.rsplit_once("of size ") {
                Some((_, size)) => format!("{size} entries"),
                None => expected.into(),
            },
        },
    }
}
