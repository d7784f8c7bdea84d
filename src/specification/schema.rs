//! The JSON Schema (draft 2020-12) of a specification, from the types that are deserialised.

use super::document::Document;
use serde_json::{Map, Value, json};
use utoipa::{PartialSchema, ToSchema};

/// The JSON Schema of a specification. It says what a document may look like; what it may mean is checked further.
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
    relocate(&mut schema);
    schema
}

/// References point into an OpenAPI document; here the definitions stand beside the schema itself.
fn relocate(schema: &mut Value) {
    match schema {
        Value::Object(members) => {
            for (key, value) in members {
                match value {
                    Value::String(target) if key == "$ref" => {
                        *target = target.replace("#/components/schemas/", "#/$defs/");
                    }
                    _ => relocate(value),
                }
            }
        }
        Value::Array(items) => items.iter_mut().for_each(relocate),
        _ => {}
    }
}
