//! The JSON Schema (draft 2020-12) of a specification, from the deserialised types.

use super::deserializer::COMMENT;
use super::document::Document;
use serde_json::{Map, Value, json};
use utoipa::{PartialSchema, ToSchema};

/// Returns the JSON Schema of a specification. It describes the structure of a document; the meaning is checked
/// separately.
pub fn json_schema() -> Value {
    let mut components = Vec::new();
    Document::schemas(&mut components);
    let definitions: Map<String, Value> = components.into_iter().map(|(name, schema)| (name, json!(schema))).collect();
    let mut schema = json!(Document::schema());
    if let Value::Object(schema) = &mut schema {
        schema.insert("$schema".into(), json!("https://json-schema.org/draft/2020-12/schema"));
        schema.insert("title".into(), json!("A differential variational inequality, and how to solve it"));
        schema.insert("$defs".into(), Value::Object(definitions));
    }
    finish(&mut schema);
    allow_until(&mut schema);
    schema
}

/// Adds `until`, the alternative name of `end`, to the schema of `time`.
fn allow_until(schema: &mut Value) {
    let Some(time) = schema.pointer_mut("/$defs/Time").and_then(Value::as_object_mut) else { return };
    if let Some(properties) = time.get_mut("properties").and_then(Value::as_object_mut) {
        let description = "An alternative name of `end`, for programs in which `end` is a reserved word.";
        properties.insert("until".into(), json!({"type": "number", "format": "double", "description": description}));
    }
    time.remove("required");
    time.insert("oneOf".into(), json!([{"required": ["end"]}, {"required": ["until"]}]));
}

/// Rewrites references, which point into the service's `OpenAPI` document, to the definitions of the JSON Schema
/// itself. Closes every object with a list of keys, externally tagged choices included, to keys other than a comment.
fn finish(schema: &mut Value) {
    match schema {
        Value::Object(members) => {
            for (key, value) in members.iter_mut() {
                match value {
                    Value::String(target) if key == "$ref" => {
                        *target = target.replace("#/components/schemas/", "#/$defs/");
                    }
                    _ => finish(value),
                }
            }
            if members.get("type").is_some_and(|kind| kind == "object") && members.contains_key("properties") {
                members.insert("additionalProperties".into(), json!(false));
                if let Some(properties) = members.get_mut("properties").and_then(Value::as_object_mut) {
                    properties.entry(COMMENT).or_insert(json!(true));
                }
            }
        }
        Value::Array(items) => items.iter_mut().for_each(finish),
        _ => {}
    }
}
