//! Consistency of the API and its `OpenAPI` description.

use crate::harness::{Call, Site, instant, one_worker};
use axum::http::StatusCode;
use serde_json::Value;
use std::path::Path;
use std::{env, fs};

#[test]
fn the_published_description_is_that_of_the_code() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("api/openapi.json");
    let text = format!("{:#}\n", dvi::service::http::description());
    if env::var_os("UPDATE").is_some() {
        fs::write(file, text).unwrap();
        return;
    }
    assert!(
        fs::read_to_string(file).unwrap() == text,
        "api/openapi.json is not what the code says; write it anew:\n    UPDATE=1 cargo test --test service openapi"
    );
}

#[tokio::test]
async fn every_operation_is_described_in_full() {
    let site = Site::new(one_worker(), instant());
    let description = site.get("/openapi.json").await.json();
    assert!(description["openapi"].as_str().unwrap().starts_with("3.1"));
    let mut names = Vec::new();
    for (path, item) in description["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            let place = format!("{method} {path}");
            assert!(operation["summary"].as_str().is_some_and(|text| text.ends_with('.')), "{place} has no summary");
            assert!(
                operation["description"].as_str().is_some_and(|text| text.ends_with('.')),
                "{place} is not described"
            );
            let responses = operation["responses"].as_object().unwrap();
            assert!(responses.keys().any(|status| status.starts_with('2')), "{place} never succeeds");
            for (status, response) in responses {
                assert!(!response["description"].as_str().unwrap().is_empty(), "{place} {status}");
            }
            let described: Vec<&str> = operation["parameters"]
                .as_array()
                .into_iter()
                .flatten()
                .filter(|parameter| parameter["in"] == "path")
                .map(|parameter| parameter["name"].as_str().unwrap())
                .collect();
            let segments: Vec<&str> =
                path.split('/').filter_map(|part| part.strip_prefix('{')?.strip_suffix('}')).collect();
            assert_eq!(described, segments, "{place}");
            names.push(operation["operationId"].as_str().unwrap().to_owned());
        }
    }
    names.sort();
    let count = names.len();
    names.dedup();
    assert_eq!(names.len(), count, "two operations share a name");
}

#[tokio::test]
async fn every_reference_of_the_description_leads_somewhere() {
    fn check(value: &Value, whole: &Value) {
        match value {
            Value::Object(members) => {
                if let Some(target) = members.get("$ref").and_then(Value::as_str) {
                    assert!(whole.pointer(target.trim_start_matches('#')).is_some(), "{target}");
                }
                members.values().for_each(|value| check(value, whole));
            }
            Value::Array(items) => items.iter().for_each(|value| check(value, whole)),
            _ => {}
        }
    }
    let description = dvi::service::http::description();
    check(&description, &description);
}

#[tokio::test]
async fn what_is_described_answers_and_what_is_not_does_not() {
    let site = Site::new(one_worker(), instant());
    for (path, item) in dvi::service::http::description()["paths"].as_object().unwrap() {
        let here = path.replace("{id}", "00000000-0000-7000-8000-000000000000");
        let refused = Call::new("PATCH", &here).send(&site).await;
        refused.problem(405, "method-not-allowed");
        let mut allowed: Vec<String> =
            refused.header("allow").split(',').map(str::to_lowercase).filter(|method| method != "head").collect();
        allowed.sort();
        let mut described: Vec<&String> = item.as_object().unwrap().keys().collect();
        described.sort();
        assert_eq!(allowed.iter().collect::<Vec<_>>(), described, "{path}");
    }
    site.get("/openapi.yaml").await.problem(404, "not-found");
}

#[tokio::test]
async fn the_page_shows_every_operation_and_needs_nobody_else() {
    let site = Site::new(one_worker(), instant());
    let page = site.get("/docs/interface").await;
    assert_eq!(page.status, StatusCode::OK);
    assert!(page.header("content-type").starts_with("text/html"));
    let policy = page.header("content-security-policy");
    assert!(policy.contains("default-src 'none'") && !policy.contains("unsafe") && !policy.contains("script-src"));
    let text = page.text();
    for path in dvi::service::http::description()["paths"].as_object().unwrap().keys() {
        assert!(text.contains(&format!("<code>{path}</code>")), "{path}");
    }
    assert!(!text.contains("<script") && !text.contains("http://") && !text.contains("https://"), "{text}");
    assert!(site.get("/docs/style.css").await.header("content-type").starts_with("text/css"));
}

#[tokio::test]
async fn security_headers_and_refusals_are_described_as_they_are() {
    let description = dvi::service::http::description();
    assert_eq!(description["components"]["securitySchemes"]["token"]["scheme"], "bearer");
    let of = |pointer: &str| description.pointer(pointer).unwrap_or_else(|| panic!("no {pointer}"));
    assert_eq!(of("/paths/~1solve/post/security")[1]["token"], serde_json::json!([]));
    assert_eq!(of("/paths/~1healthz/get/security"), &serde_json::json!([]));
    let site = Site::new(one_worker(), instant());
    let path = site.accept(1).await;
    site.ended(&path).await;
    for (path, template) in [
        (path.clone(), "/jobs/{id}"),
        (format!("{path}/results"), "/jobs/{id}/results"),
        ("/jobs/none".into(), "/jobs/{id}"),
    ] {
        let reply = Call::new("GET", &path).send(&site).await;
        let response = &description["paths"][template]["get"]["responses"][reply.status.as_str()];
        assert!(response.is_object(), "{template} {} is not described", reply.status);
        assert!(response["headers"]["x-request-id"].is_object() && reply.headers.contains_key("x-request-id"));
    }
}

#[test]
fn every_field_of_every_schema_is_explained() {
    let description = dvi::service::http::description();
    for (name, schema) in description["components"]["schemas"].as_object().unwrap() {
        for (field, what) in schema["properties"].as_object().into_iter().flatten() {
            let choices = what["oneOf"].as_array().into_iter().flatten();
            let told = choices.chain([what]).any(|what| what["description"].is_string() || what["$ref"].is_string());
            assert!(told, "{name}.{field} has no description");
        }
    }
}
