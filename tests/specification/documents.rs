//! Valid specifications that tests make faulty, and assertions on the resulting errors.

use dvi::specification::{Specification, SpecificationError};
use serde_json::{Value, json};

/// A small valid specification: a mass on a spring with dry friction.
pub fn block() -> Value {
    json!({
        "problem": {"dvi": {
            "parameters": {"k": 1, "m": 1, "F0": 0.3},
            "states": {
                "x": {"initial": 1, "rate": "v"},
                "v": {"initial": 0, "rate": "(-k*x - F)/m"}
            },
            "variables": {"F": {"inequality": "-v"}},
            "set": [{"box": {"of": ["F"], "lower": "-F0", "upper": "F0"}}]
        }},
        "time": {"end": 10}
    })
}

/// A small valid specification of a linear complementarity system.
pub fn linear() -> Value {
    json!({
        "problem": {"lcs": {
            "A": [[0, 1], [-1, 0]], "B": [[0], [1]], "C": [[0, 1]], "D": [[0]],
            "a": [0, "sin(t)"], "initial": [1, 0], "set": [{"nonnegative": ["z1"]}]
        }},
        "time": {"end": 1}
    })
}

/// Returns the JSON `document` with the value at `pointer` replaced or inserted.
pub fn with(mut document: Value, pointer: &str, value: Value) -> Value {
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match document.pointer_mut(parent).unwrap() {
        Value::Object(members) => {
            members.insert(key.into(), value);
        }
        Value::Array(items) => items[key.parse::<usize>().unwrap()] = value,
        _ => panic!("nothing to put a value in at {parent}"),
    }
    document
}

/// Returns the JSON `document` without the value at `pointer`.
pub fn without(mut document: Value, pointer: &str) -> Value {
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    document.pointer_mut(parent).unwrap().as_object_mut().unwrap().remove(key).unwrap();
    document
}

/// Returns the errors of a faulty specification.
pub fn errors_of(text: impl AsRef<[u8]>) -> Vec<SpecificationError> {
    Specification::from_json(text.as_ref()).expect_err("the document is wrong and should be told so")
}

/// Asserts that a specification text is refused with exactly these errors, as `(pointer, code, part of the detail)`, in
/// this order.
#[track_caller]
pub fn assert_text(text: impl AsRef<[u8]>, expected: &[(&str, &str, &str)]) {
    let errors = errors_of(text);
    let found: Vec<_> = errors.iter().map(|error| (error.pointer.as_str(), error.code)).collect();
    let wanted: Vec<_> = expected.iter().map(|&(pointer, code, _)| (pointer, code)).collect();
    assert_eq!(found, wanted, "{errors:#?}");
    for (error, (_, _, part)) in errors.iter().zip(expected) {
        assert!(error.detail.contains(part), "{:?} does not say {part:?}", error.detail);
    }
}

/// Asserts that a JSON document is refused as a specification with exactly these errors, as `(pointer, code, part of
/// the detail)`.
#[track_caller]
pub fn assert_errors(document: &Value, expected: &[(&str, &str, &str)]) {
    assert_text(document.to_string(), expected);
}

/// Asserts that a JSON document is refused as a specification with exactly one error, which proposes `suggestion`.
#[track_caller]
pub fn assert_suggestion(document: &Value, pointer: &str, code: &str, suggestion: &str) {
    let errors = errors_of(document.to_string());
    assert_eq!(errors.len(), 1, "{errors:#?}");
    assert_eq!((errors[0].pointer.as_str(), errors[0].code), (pointer, code));
    assert_eq!(errors[0].did_you_mean.as_deref(), Some(suggestion));
}
