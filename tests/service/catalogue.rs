//! The resources that describe the service: examples, schema, methods, health and version.

use crate::harness::{Site, count, instant, one_worker};
use axum::http::StatusCode;
use dvi::service::Options;
use dvi::specification::EXAMPLES;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

fn site() -> Site {
    Site::new(one_worker(), instant())
}

#[test]
fn every_file_of_api_examples_is_an_example() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("api/examples");
    let files = fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().file_name());
    let files: BTreeSet<String> = files.map(|name| name.into_string().unwrap()).collect();
    let embedded: BTreeSet<String> = EXAMPLES.iter().map(|example| format!("{}.json", example.name)).collect();
    assert_eq!(embedded, files);
}

#[tokio::test]
async fn every_listed_example_can_be_fetched() {
    let site = site();
    let list = site.get("/examples").await;
    assert_eq!(list.status, StatusCode::OK);
    let list = list.json();
    assert_eq!(list.as_array().unwrap().len(), EXAMPLES.len());
    for (entry, example) in list.as_array().unwrap().iter().zip(EXAMPLES) {
        let fetched = site.get(entry["href"].as_str().unwrap()).await;
        assert_eq!(fetched.header("content-type"), "application/json");
        assert_eq!(fetched.text(), example.text);
        assert_eq!(entry["title"], fetched.json()["label"], "{}", example.name);
    }
    site.get("/examples/perpetuum_mobile").await.problem(404, "no-such-example");
}

#[tokio::test]
async fn the_service_is_alive_and_ready_and_has_a_version() {
    let site = site();
    assert_eq!(site.get("/healthz").await.json()["status"], "alive");
    assert_eq!(site.get("/readyz").await.json()["status"], "ready");
    assert_eq!(site.get("/version").await.json()["version"], env!("CARGO_PKG_VERSION"));
}

#[tokio::test]
async fn the_published_schema_is_served() {
    let schema = site().get("/schema").await;
    assert_eq!(schema.header("content-type"), "application/schema+json");
    assert_eq!(schema.json(), dvi::specification::json_schema());
}

#[tokio::test]
async fn the_methods_are_listed_with_their_conditions_and_the_limits_in_force() {
    let site = Site::new(Options { queue: count(17), ..one_worker() }, instant());
    let list = site.get("/methods").await;
    assert_eq!(list.status, StatusCode::OK);
    let list = list.json();
    for (s, method) in list["tableaux"].as_array().unwrap().iter().enumerate() {
        let (s, conditions) = (s + 1, &method["conditions"]);
        assert_eq!((&method["stages"], &method["adaptive"]), (&s.into(), &(s % 2 == 1).into()));
        assert_eq!(conditions["quadrature_order"]["order"], 2 * s - 1);
        assert_eq!(conditions["stage_order"]["order"], s);
        for condition in ["algebraic_stability", "positive_diagonal", "stiff_accuracy", "damping"] {
            assert_eq!(conditions[condition]["holds"], true, "{condition} of {s} stages: {conditions}");
        }
        // The first entry of the diagonal D satisfies e_1^T (D A + A^T D) e_1 > 0, where A are the coefficients of
        // the method.
        let d = conditions["positive_diagonal"]["diagonal"][0].as_f64().unwrap();
        assert!(d * method["A"][0][0].as_f64().unwrap() > 0.0);
    }
    assert_eq!(list["tableaux"].as_array().unwrap().len(), 9);
    for family in
        ["problems", "sets", "methods", "switches", "impacts", "impact_laws", "vi_solvers", "limits", "service"]
    {
        let members = list[family].as_array().unwrap();
        assert!(members.len() >= 2 && members.iter().all(|member| member["meaning"].is_string()), "{family}");
    }
    let queue = list["service"].as_array().unwrap().iter().find(|bound| bound["flag"] == "--queue").unwrap();
    assert_eq!((&queue["value"], &queue["variable"]), (&17.into(), &"DVI_QUEUE".into()));
}
