//! The parts of the `OpenAPI` description that are common to all operations and stated by no handler: which
//! operations need a token, the headers of every response, and the error statuses, each with the problems that have
//! it.

use super::problem::Kind;
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// The HTTP error statuses that every operation of the interface may return.
const ANY: [u16; 3] = [400, 421, 500];
/// The further HTTP error statuses of operations that may require an access token.
const WORK: [u16; 4] = [401, 403, 406, 503];
/// The further HTTP error statuses of operations with a request body.
const BODY: [u16; 6] = [408, 409, 413, 415, 422, 429];

/// Completes an `OpenAPI` description; the operations of the paths in `asks_token` need a token if the service
/// requires tokens.
pub fn complete(description: &mut Value, asks_token: &BTreeSet<String>) {
    description["servers"] =
        json!([{"url": "/", "description": "The root of the service, or the prefix of `--path-prefix`"}]);
    description["components"]["securitySchemes"] = json!({"token": {
        "type": "http",
        "scheme": "bearer",
        "description": "A token of `dvi token create`, if the service requires one: on addresses that other machines \
                        can reach, or with `--ask-tokens`. Reading needs the scope `read`, every other request \
                        `submit`."
    }});
    description["components"]["headers"] = json!({
        "RequestId": {"description": "The id of the request, from the request or new, under which the log has it", "schema": {"type": "string"}},
        "TraceParent": {
            "description": "The trace of the request, if it has one, with a span of the service as the parent (W3C \
                            Trace Context)",
            "schema": {"type": "string"}
        },
        "RetryAfter": {"description": "The recommended time until the next request, in seconds", "schema": {"type": "integer", "minimum": 1}},
        "Challenge": {"description": "`Bearer` (RFC 6750)", "schema": {"type": "string"}}
    });
    bound_tuples(description);
    let kinds = Kind::ALL.iter().fold(BTreeMap::<u16, Vec<&str>>::new(), |mut kinds, kind| {
        kinds.entry(kind.status().as_u16()).or_default().push(kind.slug());
        kinds
    });
    for (path, item) in members(description.get_mut("paths")) {
        for (method, operation) in members(Some(item)) {
            let is_work = asks_token.contains(path);
            operation["security"] = if is_work { json!([{}, {"token": []}]) } else { json!([]) };
            let mut statuses = BTreeSet::from(ANY);
            statuses.extend(WORK.iter().filter(|_| is_work));
            statuses.extend(BODY.iter().filter(|_| method == "post"));
            statuses.extend(path.contains('{').then_some(404));
            let Some(Value::Object(responses)) = operation.get_mut("responses") else { continue };
            let (default, known) = (responses.get("default").cloned(), &kinds);
            for status in statuses {
                let refusal = refusal(known.get(&status).map_or(&[], Vec::as_slice), default.as_ref());
                responses.entry(status.to_string()).or_insert(refusal);
            }
            for (status, response) in responses.iter_mut() {
                let headers = &mut response["headers"];
                headers["x-request-id"] = json!({"$ref": "#/components/headers/RequestId"});
                headers["traceparent"] = json!({"$ref": "#/components/headers/TraceParent"});
                match status.as_str() {
                    "202" | "429" | "503" => {
                        headers["retry-after"] = json!({"$ref": "#/components/headers/RetryAfter"})
                    }
                    "401" => headers["www-authenticate"] = json!({"$ref": "#/components/headers/Challenge"}),
                    _ => {}
                }
            }
        }
    }
}

/// Returns the description of an error response with one of the problems `kinds`, with the content of the default
/// response.
fn refusal(kinds: &[&str], default: Option<&Value>) -> Value {
    let named: Vec<String> = kinds.iter().map(|kind| format!("`{kind}`")).collect();
    let content = default.and_then(|default| default.get("content")).cloned();
    let content = content.unwrap_or_else(
        || json!({"application/problem+json": {"schema": {"$ref": "#/components/schemas/ProblemDetails"}}}),
    );
    json!({"description": format!("A problem, one of {}", named.join(", ")), "content": content})
}

/// Describes tuples in a schema as lists of fixed length: client generators do not know `items: false`.
fn bound_tuples(value: &mut Value) {
    let length = value.get("prefixItems").and_then(Value::as_array).map(Vec::len);
    if let Some(length) = length.filter(|_| value["items"] == Value::Bool(false)) {
        value["items"] = json!({});
        (value["minItems"], value["maxItems"]) = (length.into(), length.into());
    }
    match value {
        Value::Object(members) => members.values_mut().for_each(bound_tuples),
        Value::Array(items) => items.iter_mut().for_each(bound_tuples),
        _ => {}
    }
}

fn members(value: Option<&mut Value>) -> impl Iterator<Item = (&String, &mut Value)> {
    value.and_then(Value::as_object_mut).into_iter().flat_map(Map::iter_mut)
}
