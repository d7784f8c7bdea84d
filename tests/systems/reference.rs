//! Readers of the published examples and of the reference solutions in `tests/reference`.

use serde_json::{Map, Value, json};
use std::path::Path;

/// Returns a published example as JSON, to be modified before it is solved.
pub fn example(name: &str) -> Value {
    read(&format!("api/examples/{name}.json"))
}

/// Reads a JSON file, given by its path in the repository.
pub fn read(path: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    let text = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_slice(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Parses a number that a reference file gives as a string with more digits than a double has.
pub fn digits(value: &Value) -> f64 {
    value.as_str().and_then(|text| text.parse().ok()).unwrap_or_else(|| panic!("{value} is not a string of digits"))
}

/// Returns the test system of the given name in `tests/reference/switching.json`.
pub fn switching(name: &str) -> Value {
    let systems = read("tests/reference/switching.json")["systems"].take();
    let found = systems.as_array().and_then(|systems| systems.iter().find(|system| system["name"] == name));
    found.unwrap_or_else(|| panic!("no switching system `{name}`")).clone()
}

/// Returns a smooth initial value problem of `tests/reference/smooth.json` as a specification without a method.
pub fn smooth(problem: &Value) -> Value {
    let equations = problem["equations"].as_array().expect("equations").iter().enumerate();
    let state = |(i, rate)| (format!("y{}", i + 1), json!({"initial": problem["y0"][i], "rate": rate}));
    let states: Map<String, Value> = equations.map(state).collect();
    let mut dvi = json!({"parameters": problem["params"], "states": states});
    if !problem["mass"].is_null() {
        dvi["mass"] = problem["mass"].clone();
    }
    json!({
        "problem": {"dvi": dvi},
        "time": {"start": problem["t0"], "end": problem["t1"]},
        "output": {"times": [problem["t1"]]},
    })
}
