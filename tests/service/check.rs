//! `POST /check`: the summary or the errors of a specification, without a job.

use crate::harness::{Call, Gate, Site, one_worker};
use axum::http::StatusCode;

const BRIDGE: &str = include_str!("../../api/examples/diode_bridge.json");
const REVERSE_ZENO: &str = include_str!("../../api/examples/reverse_zeno.json");

#[tokio::test]
async fn a_check_tells_index_and_uniqueness_without_a_solve() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let reply = Call::check(BRIDGE).send(&site).await;
    assert_eq!(reply.status, StatusCode::OK);
    let told = reply.json();
    assert_eq!((&told["states"], &told["variables"]), (&2.into(), &4.into()));
    assert_eq!((&told["index"], &told["uniqueness"]), (&0.into(), &"unique".into()));
    assert!(told["because"].as_str().unwrap().contains("passive"), "{told}");
    assert_eq!(told["method"], "radau");
    assert!(told["left_out"].as_array().unwrap().iter().any(|part| part == "mass matrix: it is the identity"));
}

#[tokio::test]
async fn a_check_claims_no_more_than_it_can_certify() {
    let site = Site::new(one_worker(), Gate::new().solver());
    let told = Call::check(REVERSE_ZENO).send(&site).await.json();
    assert_eq!((&told["index"], &told["uniqueness"]), (&1.into(), &"exists_not_certified".into()));
    assert!(told["because"].as_str().unwrap().contains("a P-matrix"), "{told}");
    assert_eq!(told["warnings"][0]["code"], "uniqueness_not_guaranteed");
}

#[tokio::test]
async fn a_check_tells_every_error() {
    let site = Site::new(one_worker(), Gate::new().solver());
    let problem = Call::check(r#"{"problem": {"dvi": {"states": {}}}, "time": {"ende": 1}}"#).send(&site).await;
    let errors = problem.problem(400, "invalid-specification")["errors"].clone();
    assert!(errors.as_array().unwrap().len() >= 2, "{errors}");
}
