//! Examples and reference answers of the repository.

use serde_json::Value;
use std::path::Path;

/// The text of an example, as JSON to be changed before it is solved.
pub fn example(name: &str) -> Value {
    read(&format!("api/examples/{name}.json"))
}

/// A JSON file of the repository.
pub fn read(path: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    let text = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_slice(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// A number that a reference file holds as a string of more digits than a double has.
pub fn digits(value: &Value) -> f64 {
    value.as_str().and_then(|text| text.parse().ok()).unwrap_or_else(|| panic!("{value} is not a string of digits"))
}

/// The system of that name in `tests/reference/switching.json`.
pub fn switching(name: &str) -> Value {
    let systems = read("tests/reference/switching.json")["systems"].take();
    let found = systems.as_array().and_then(|systems| systems.iter().find(|system| system["name"] == name));
    found.unwrap_or_else(|| panic!("no switching system `{name}`")).clone()
}
