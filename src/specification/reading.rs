//! From bytes to a [`Document`], with all structural errors reported at once.
//!
//! Serde stops at its first error. Each erroneous value is therefore repaired and the document deserialised again,
//! until that succeeds. The repairs are recorded, so that later checks do not report their consequences.

use super::digest::{Digest, digest};
use super::document::Document;
use super::error::{Errors, SpecificationError};
use super::json::Json;
use super::pointer::{Step, pointer};
use super::repairs::Repairs;
use super::robot;
use super::sweep::{self, Prepared};
use super::syntax;
use super::vectors::{self, Vectors};
use serde::Deserialize;
use serde_path_to_error::{Path, Segment};
use std::sync::Arc;

/// Largest number of bytes deserialised in all while a document is repaired, which bounds the time for a large faulty
/// document.
const WORK: usize = 64 << 20;

/// The byte order mark that some editors write before UTF-8 text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// A specification document after deserialisation, possibly repaired.
#[derive(Debug)]
pub(super) struct Reading {
    pub document: Document,
    pub repairs: Repairs,
    pub errors: Errors,
    pub vectors: Vectors,
    pub prepared: Prepared,
    /// The SHA-256 of the text of the document, if it was read from text.
    pub digest: Option<Digest>,
}

/// Reads a document.
///
/// # Errors
/// The structural errors, if no repair makes the document readable.
pub(super) fn read(text: &[u8]) -> Result<Reading, Vec<SpecificationError>> {
    let reading = read_tree(tree(text)?, &[], text.len())?;
    Ok(Reading { digest: Some(digest(text)), ..reading })
}

/// Parses a document to a tree.
///
/// # Errors
/// The text is not JSON.
pub(super) fn tree(text: &[u8]) -> Result<Json, Vec<SpecificationError>> {
    parse(text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(text)).map_err(|error| vec![error])
}

/// Deserialises a tree whose text has `bytes` bytes. The numbers named in `values` (parameters, initial values and
/// other numbers that a sweep may vary) get new values.
///
/// # Errors
/// The structural errors, if no repair makes the document readable.
pub(super) fn read_tree(
    mut json: Json,
    values: &[(String, f64)],
    bytes: usize,
) -> Result<Reading, Vec<SpecificationError>> {
    let mut errors = Errors::default();
    json.remove_duplicates(&mut Vec::new(), &mut |path| {
        let detail = "this key occurs twice in its object";
        errors.push(SpecificationError::new(pointer(path), "duplicate_key", detail).expected("each key once"));
    });
    rename_until(&mut json, &mut errors);
    let is_swept = matches!(json.child(&Step::Key("sweep".to_owned())), Some(Json::Object(_)));
    let source = is_swept.then(|| Arc::new(json.clone()));
    // Set the given values in two passes: sizes of vectors before the vectors are expanded, and initial values of
    // their elements afterwards.
    let rest: Vec<&str> = if values.is_empty() { Vec::new() } else { sweep::set(&mut json, values) };
    let robot = robot::write_out(&mut json, &mut errors);
    let mut vectors = vectors::write_out(&mut json, &mut errors);
    vectors.robot = robot;
    let rest: Vec<(String, f64)> = values.iter().filter(|(name, _)| rest.contains(&name.as_str())).cloned().collect();
    if !rest.is_empty() {
        sweep::set(&mut json, &rest);
    }
    let targets = if is_swept { sweep::lift(&mut json, &mut vectors, &mut errors) } else { Vec::new() };
    let prepared = Prepared { targets, source };
    let mut repairs = Repairs::default();
    for _ in 0..(WORK / bytes.max(1)).clamp(4, 256) {
        // Tracking the path of an error in the document costs time, so it is done only after an error.
        if let Ok(document) = Document::deserialize(&json) {
            return Ok(Reading { document, repairs, errors, vectors, prepared, digest: None });
        }
        let Err(error) = serde_path_to_error::deserialize::<_, Document>(&json) else { break };
        let path = steps(error.path(), &json);
        if !repairs.mend(&mut json, path, error.into_inner(), &mut errors) {
            break;
        }
    }
    Err(vectors.at_origins(errors.into_list()))
}

/// Renames `until`, the alternative to `end`, which is a reserved word of MATLAB, Octave and Julia.
fn rename_until(json: &mut Json, errors: &mut Errors) {
    let time = [Step::Key("time".to_owned())];
    let Some(Json::Object(members)) = json.at_mut(&time) else { return };
    let [end, until] = ["end", "until"].map(|key| members.iter().position(|(name, _)| name == key));
    match (end, until) {
        (None, Some(until)) => members[until].0 = "end".to_owned(),
        (Some(_), Some(until)) => {
            members.remove(until);
            let detail = "`until` is another name of `end`, and both are given";
            errors.push(SpecificationError::new("/time/until", "conflict", detail).expected("one of the two"));
        }
        (_, None) => {}
    }
}

/// Parses the JSON text of a document; an error names line and column, and the path reached.
fn parse(text: &[u8]) -> Result<Json, SpecificationError> {
    serde_json::from_slice(text).map_err(|error| {
        let mut deserializer = serde_json::Deserializer::from_slice(text);
        let path = match serde_path_to_error::deserialize::<_, Json>(&mut deserializer) {
            Ok(_) => Vec::new(),
            Err(error) => steps(error.path(), &Json::Null),
        };
        syntax::error(text, &error, &path)
    })
}

/// Converts serde's path in a document to steps. Serde enters an externally tagged choice by variant, the document by
/// key.
fn steps(path: &Path, json: &Json) -> Vec<Step> {
    let mut at = Some(json);
    let mut steps = Vec::new();
    for segment in path.iter() {
        let step = match segment {
            // A single value that stands for a list of one element has no index in the document.
            Segment::Seq { index: 0 } if at.is_some_and(|value| !matches!(value, Json::List(_) | Json::Null)) => {
                continue;
            }
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
