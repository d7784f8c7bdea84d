//! A sweep over HTTP: an ordinary job, whose answer is a table in every format.

use crate::harness::{Call, Site, one_worker};
use arrow_array::Array;
use arrow_ipc::reader::StreamReader;
use axum::http::StatusCode;
use dvi::service::jobs::Solver;
use std::sync::Arc;

const SWEEP: &str = r#"{"problem": {"dvi": {"parameters": {"k": 1}, "states": {"x": {"initial": 1, "rate": "-k*sqrt(x)"}}}},
    "time": {"end": 1}, "sweep": {"over": {"k": [0, 1], "x.initial": [1, -1]}}}"#;

fn site() -> Site {
    let solver: Solver = Arc::new(dvi::solve);
    Site::new(one_worker(), solver)
}

#[tokio::test]
async fn the_answer_is_a_table_with_a_row_a_member() {
    let reply = Call::solve(SWEEP).send(&site()).await;
    assert_eq!(reply.status, StatusCode::OK, "{}", reply.text());
    let json = reply.json();
    assert_eq!(json["table"]["members"], 4);
    assert_eq!(json["table"]["columns"]["member"], serde_json::json!([0, 1, 2, 3]));
    let x = json["table"]["columns"]["x"].as_array().unwrap();
    // The square root of x decreases by k/2 per unit of time.
    assert!(x[0] == 1.0 && (x[2].as_f64().unwrap() - 0.25).abs() < 1e-5, "{x:?}");
    assert!(x[3].is_null() && json["table"]["columns"]["status"][3] == "failed", "{json}");
    assert!(json["summary"]["x"]["count"].as_u64().unwrap() >= 2);
}

#[tokio::test]
async fn it_comes_in_every_form_and_is_the_same_again() {
    let site = site();
    let form = async |accept: &str| {
        let reply = Call::solve(SWEEP).header("accept", accept).send(&site).await;
        assert_eq!(reply.status, StatusCode::OK, "{accept}: {}", reply.text());
        reply
    };
    let csv = form("text/csv").await;
    assert!(csv.text().starts_with("member,k,x.initial,x,status,trusted,error,"), "{}", csv.text());
    assert_eq!(csv.text().lines().count(), 5);
    assert_eq!(form("application/x-ndjson").await.text().lines().count(), 4);
    let arrow = form("application/vnd.apache.arrow.stream").await;
    let batch = StreamReader::try_new(arrow.body.as_slice(), None).unwrap().next().unwrap().unwrap();
    assert!(batch.num_rows() == 4 && batch.column_by_name("x").unwrap().null_count() > 0);
    assert!(form("image/svg+xml").await.text().contains("<svg"));
    let path = site.accept(1).await;
    site.ended(&path).await;
    let (one, other) = (form("application/json").await, form("application/json").await);
    assert_eq!(one.body, other.body);
}
