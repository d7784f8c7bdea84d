//! Malformed and extreme specifications: reading any input ends, and every refusal has a reason.

use crate::documents::{block, linear};
use dvi::specification::{EXAMPLES, Specification};
use proptest::prelude::*;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

#[path = "../bench/fuzz/mutation.rs"]
mod mutation;

fn answered(text: &[u8]) {
    if let Err(errors) = Specification::from_json(text) {
        assert!(!errors.is_empty());
        assert!(errors.iter().all(|error| !error.code.is_empty() && !error.detail.is_empty()), "{errors:?}");
    }
}

/// Collects the JSON pointers of all values in a document.
fn pointers(value: &Value, at: String, found: &mut Vec<String>) {
    match value {
        Value::Object(members) => members.iter().for_each(|(key, value)| pointers(value, format!("{at}/{key}"), found)),
        Value::Array(items) => {
            items.iter().enumerate().for_each(|(i, value)| pointers(value, format!("{at}/{i}"), found));
        }
        _ => {}
    }
    found.push(at);
}

proptest! {
    #[test]
    fn bytes_changed_at_random_are_answered(
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)
    ) {
        for document in [block(), linear()] {
            let mut text = document.to_string().into_bytes();
            for (place, byte) in &edits {
                let place = place.index(text.len());
                text[place] = *byte;
            }
            answered(&text);
        }
    }
}

/// A short run of `cargo bench --bench fuzz`; faulty mutants are mutated further.
#[test]
fn examples_changed_at_random_are_answered() {
    let mut corpus = [EXAMPLES.iter().map(|example| example.text.into()).collect::<Vec<Vec<u8>>>(), Vec::new()];
    let mut mutation = mutation::Mutation::new(2, &corpus[0]);
    for _ in 0..3000 {
        let document = mutation.change(&corpus);
        answered(&document);
        if document.len() < 4096 {
            corpus[1].push(document);
        }
    }
}

/// If a value of a specification is replaced by one of another type, all errors are at or below this value.
#[test]
fn a_value_of_another_kind_is_answered_at_its_place() {
    let strange = [json!(null), json!(true), json!(-1), json!("?"), json!([]), json!({}), json!({"a": 1, "b": 2})];
    for document in [block(), linear()] {
        let mut places = Vec::new();
        pointers(&document, String::new(), &mut places);
        for place in places.iter().filter(|place| !place.is_empty()) {
            for value in &strange {
                let mut changed = document.clone();
                *changed.pointer_mut(place).unwrap() = value.clone();
                if let Err(errors) = Specification::from_json(changed.to_string().as_bytes()) {
                    assert!(!errors.is_empty());
                    if errors[0].code == "wrong_type" {
                        let stray = errors.iter().find(|error| !error.pointer.starts_with(place.as_str()));
                        assert_eq!(stray, None, "{place} = {value}");
                    }
                }
            }
        }
    }
}

/// Numbers in a specification whose products and squares overflow or underflow: the analysis of a valid specification
/// completes nonetheless.
#[test]
fn numbers_at_the_limits_of_doubles_are_analysed() {
    for name in ["reverse_zeno", "diode_bridge", "fluid_queue", "three_regions", "pendulum"] {
        let path = format!("{}/api/examples/{name}.json", env!("CARGO_MANIFEST_DIR"));
        let document: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
        let mut places = Vec::new();
        pointers(&document["problem"], "/problem".into(), &mut places);
        for place in places {
            for value in [1e308, -1e308, 1e160, 1e-160, 5e-324] {
                let mut changed = document.clone();
                if changed.pointer(&place).is_some_and(|value| !value.is_object() && !value.is_array()) {
                    *changed.pointer_mut(&place).unwrap() = json!(value);
                    answered(changed.to_string().as_bytes());
                }
            }
        }
    }
}

#[test]
fn a_large_document_with_many_errors_is_answered_in_time() {
    let mut document = linear();
    document["problem"]["lcs"]["A"] = json!({
        "shape": [2, 2],
        "entries": (0..300_000).map(|_| json!([0, true, "1"])).collect::<Vec<_>>()
    });
    let text = document.to_string();
    let start = Instant::now();
    let errors = Specification::from_json(text.as_bytes()).unwrap_err();
    assert!(!errors.is_empty());
    assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
}

/// For each of many unknown names in a specification, a search for the nearest of many valid names would take minutes.
#[test]
fn many_wrong_names_among_many_right_ones_are_answered_in_time() {
    const N: usize = 20_000;
    let names = |letter: &str| (0..N).map(|i| format!("{letter}{i}")).collect::<Vec<_>>();
    let states: serde_json::Map<_, _> =
        names("x").into_iter().map(|name| (name, json!({"initial": 0, "rate": 0}))).collect();
    let wrong: serde_json::Map<_, _> =
        names("x").into_iter().map(|name| (name, json!({"initial": 0, "rate": format!("y{N}")}))).collect();
    let document = |states, fields, atol| {
        json!({
            "problem": {"dvi": {"states": states}}, "time": {"end": 1},
            "output": {"fields": fields}, "method": {"atol": atol}
        })
    };
    let tolerances: serde_json::Map<_, _> = names("w").into_iter().map(|name| (name, json!(1))).collect();
    let start = Instant::now();
    for document in [
        document(states.clone(), names("x"), tolerances),
        document(states, names("w"), serde_json::Map::new()),
        document(wrong, names("x"), serde_json::Map::new()),
    ] {
        assert_eq!(Specification::from_json(document.to_string().as_bytes()).unwrap_err().len(), 101);
    }
    assert!(start.elapsed() < Duration::from_secs(30), "{:?}", start.elapsed());
}

#[test]
fn reading_stops_when_it_is_asked_to() {
    let control = dvi::problem::Control::new();
    control.cancel();
    let elastic = r#"{"problem": {"elastic": {"body": {"box": {"x": [0, 1], "y": [0, 1], "z": [0, 1]}},
        "elements": {"x": 24, "y": 24, "z": 24}, "density": 1, "young": 1, "poisson": 0.3, "clamped": ["z_min"],
        "force": [0, 0, "-exp(x*y)"]}}, "time": {"end": 1}}"#;
    let obstacle = r#"{"problem": {"obstacle": {"domain": {"x": [0, 1], "y": [0, 1]}, "elements": {"x": 900, "y": 900},
        "diffusion": 1, "initial": "exp(x*y)", "obstacle": -1}}, "time": {"end": 1}}"#;
    for text in [elastic, obstacle] {
        let errors = Specification::from_json_with(text.as_bytes(), &control).unwrap_err();
        assert_eq!(errors.len(), 1, "{errors:?}");
        assert!(errors[0].is_interruption() && errors[0].code == "interrupted");
    }
}
