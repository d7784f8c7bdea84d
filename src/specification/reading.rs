//! From bytes to a [`Document`], with every structural error named at once.
//!
//! Serde stops at its first error. So the place of each is mended and the document read again, until it can be read;
//! what was mended is remembered, so that later checks do not complain about it a second time.

use super::document::Document;
use super::error::{Errors, SpecificationError};
use super::json::Json;
use super::place::{Step, pointer};
use super::repairs::Repairs;
use serde::Deserialize;
use serde_path_to_error::{Path, Segment};

/// Bytes that may be read again in all while mending: it bounds the time that a large and bad document can take.
const WORK: usize = 64 << 20;

/// A document that could be read, perhaps after mending.
#[derive(Debug)]
pub(super) struct Reading {
    pub document: Document,
    pub repairs: Repairs,
    pub errors: Errors,
}

/// Reads a document.
///
/// # Errors
/// The structural errors, where no mending led to a readable document.
pub(super) fn read(text: &[u8]) -> Result<Reading, Errors> {
    let mut errors = Errors::default();
    let mut json = match parse(text) {
        Ok(json) => json,
        Err(error) => {
            errors.push(error);
            return Err(errors);
        }
    };
    json.remove_duplicates(&mut Vec::new(), &mut |path| {
        let detail = "this key stands twice in its object";
        errors.push(SpecificationError::new(pointer(path), "duplicate_key", detail).expected("each key once"));
    });
    let mut repairs = Repairs::default();
    for _ in 0..(WORK / text.len().max(1)).clamp(4, 256) {
        // The place of an error costs time to keep, so it is looked for only when there is one.
        if let Ok(document) = Document::deserialize(&json) {
            return Ok(Reading { document, repairs, errors });
        }
        let Err(error) = serde_path_to_error::deserialize::<_, Document>(&json) else { break };
        let path = steps(error.path(), &json);
        if !repairs.mend(&mut json, path, error.into_inner(), &mut errors) {
            break;
        }
    }
    Err(errors)
}

/// Reads JSON text; an error names its line and column, and the place as far as it was reached.
fn parse(text: &[u8]) -> Result<Json, SpecificationError> {
    serde_json::from_slice(text).map_err(|error| {
        let mut deserializer = serde_json::Deserializer::from_slice(text);
        let path = match serde_path_to_error::deserialize::<_, Json>(&mut deserializer) {
            Ok(_) => Vec::new(),
            Err(error) => steps(error.path(), &Json::Null),
        };
        syntax_error(text, &error, &path)
    })
}

fn syntax_error(text: &[u8], error: &serde_json::Error, path: &[Step]) -> SpecificationError {
    let message = error.to_string();
    if text.trim_ascii().is_empty() {
        return SpecificationError::new("", "syntax", "the document is empty").expected("a JSON object");
    }
    let (code, expected) = if message.starts_with("number out of range") {
        ("number_out_of_range", "a number between -1.8e308 and 1.8e308")
    } else if message.starts_with("recursion limit exceeded") {
        // The path of a document that is nothing but depth says nothing.
        return SpecificationError::new("", "too_deep", message).expected("at most 127 levels of lists and objects");
    } else {
        ("syntax", "a JSON object")
    };
    SpecificationError::new(pointer(path), code, message).expected(expected)
}

/// A path as steps. Into an externally tagged choice the path goes by variant, the document by key.
fn steps(path: &Path, json: &Json) -> Vec<Step> {
    let mut at = Some(json);
    let mut steps = Vec::new();
    for segment in path.iter() {
        let step = match segment {
            Segment::Seq { index } => Step::Index(*index),
            Segment::Map { key } => Step::Key(key.clone()),
            Segment::Enum { variant } if matches!(at, Some(Json::Object(_))) => Step::Key(variant.clone()),
            Segment::Enum { .. } | Segment::Unknown => break,
        };
        at = at.and_then(|value| value.child(&step));
        steps.push(step);
    }
    steps
}
