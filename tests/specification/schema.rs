//! The published JSON Schema of specifications.

use dvi::specification::json_schema;
use serde_json::Value;
use std::{env, fs};

const PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/api/specification.schema.json");

#[test]
fn the_published_schema_is_that_of_the_types() {
    let generated = serde_json::to_string_pretty(&json_schema()).unwrap() + "\n";
    if env::var_os("UPDATE").is_some() {
        fs::write(PATH, &generated).unwrap();
    }
    let published = fs::read_to_string(PATH).unwrap_or_default();
    assert!(
        published == generated,
        "api/specification.schema.json is not that of the types; write it anew with\n\
         UPDATE=1 cargo test --test specification schema"
    );
}

#[test]
fn every_reference_in_the_schema_has_its_definition() {
    fn references(schema: &Value, found: &mut Vec<String>) {
        match schema {
            Value::Object(members) => {
                found.extend(members.get("$ref").and_then(Value::as_str).map(String::from));
                members.values().for_each(|value| references(value, found));
            }
            Value::Array(items) => items.iter().for_each(|value| references(value, found)),
            _ => {}
        }
    }
    let schema = json_schema();
    let mut found = Vec::new();
    references(&schema, &mut found);
    assert!(found.len() > 20);
    for reference in found {
        let pointer = reference.strip_prefix('#').unwrap();
        assert!(schema.pointer(pointer).is_some(), "{reference} leads nowhere");
    }
}

#[test]
fn the_schema_forbids_unknown_keys_and_requires_the_problem_and_of_a_time_its_end() {
    let schema = json_schema();
    assert_eq!(schema["additionalProperties"], false);
    assert_eq!(schema["required"], serde_json::json!(["problem"]));
    let either = serde_json::json!([{"required": ["end"]}, {"required": ["until"]}]);
    assert_eq!((&schema["$defs"]["Time"]["oneOf"], schema["$defs"]["Time"].get("required")), (&either, None));
    assert_eq!(schema["$defs"]["BoxBlock"]["additionalProperties"], false);
    assert_eq!(schema["$defs"]["Problem"]["oneOf"][0]["additionalProperties"], false);
}
