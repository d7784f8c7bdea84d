//! Invalid requests to the service and their responses.

use crate::harness::{Call, DECAY, Site, instant, one_worker};
use axum::http::StatusCode;

fn site() -> Site {
    Site::new(one_worker(), instant())
}

#[tokio::test]
async fn a_specification_with_errors_is_answered_with_all_of_them() {
    let wrong = r#"{"problem":{"dvi":{"states":{"x":{"initial":1,"rate":"-y"}}}},"time":{"start":2,"end":1}}"#;
    let problem = Call::solve(wrong).send(&site()).await.problem(400, "invalid-specification");
    let errors = problem["errors"].as_array().unwrap();
    let pointers: Vec<&str> = errors.iter().map(|error| error["pointer"].as_str().unwrap()).collect();
    assert!(pointers.contains(&"/problem/dvi/states/x/rate"), "{problem}");
    assert!(pointers.iter().any(|pointer| pointer.starts_with("/time")), "{problem}");
    assert!(errors.iter().all(|error| error["code"].is_string() && error["detail"].is_string()));
}

#[tokio::test]
async fn what_is_not_json_is_a_specification_with_an_error() {
    for document in ["", "{", "not json", "\u{0}", "[1, 2", "{\"problem\": NaN}"] {
        let problem = Call::solve(document).send(&site()).await.problem(400, "invalid-specification");
        assert_eq!(problem["errors"].as_array().map(Vec::len), Some(1), "{document:?}: {problem}");
    }
}

#[tokio::test]
async fn a_large_specification_with_errors_is_answered_like_a_small_one() {
    let wrong = format!(r#"{{"unknown": "{}"}}"#, "x".repeat(1 << 18));
    let problem = Call::solve(wrong).send(&site()).await.problem(400, "invalid-specification");
    assert!(!problem["errors"].as_array().unwrap().is_empty());
}

#[tokio::test]
async fn a_body_of_another_type_is_refused() {
    for (name, value) in
        [("content-type", "text/plain"), ("content-type", "application/xml"), ("content-encoding", "gzip")]
    {
        let reply = Call::solve(DECAY).header(name, value).send(&site()).await;
        reply.problem(415, "unsupported-media-type");
    }
}

#[tokio::test]
async fn an_answer_that_cannot_be_given_is_refused_before_any_work() {
    Call::solve("not even json").header("accept", "image/png").send(&site()).await.problem(406, "not-acceptable");
    let site = site();
    let path = site.accept(1).await;
    site.ended(&path).await;
    let results = Call::new("GET", &format!("{path}/results")).header("accept", "application/xml").send(&site).await;
    results.problem(406, "not-acceptable");
}

#[tokio::test]
async fn a_job_that_is_not_there_is_not_found_whatever_its_name() {
    let site = site();
    for id in ["018f0000-0000-7000-8000-000000000000", "seven", "%ff%fe", "..%2f..%2fetc%2fpasswd", "-"] {
        for (method, path) in [("GET", ""), ("DELETE", ""), ("GET", "/results"), ("POST", "/cancel")]
            .map(|(m, p)| (m, format!("/jobs/{id}{p}")))
        {
            Call::new(method, &path).send(&site).await.problem(404, "no-such-job");
        }
    }
}

#[tokio::test]
async fn an_address_of_nothing_names_the_list_of_what_there_is() {
    let site = site();
    let problem = site.get("/jobz").await.problem(404, "not-found");
    let list = problem["detail"].as_str().unwrap().split([' ', ';']).find(|word| word.ends_with(".json")).unwrap();
    assert!(site.get(list).await.json()["paths"]["/solve"]["post"].is_object(), "{problem}");
}

#[tokio::test]
async fn a_method_that_is_not_there_lists_those_that_are() {
    let reply = site().get("/solve").await;
    reply.problem(405, "method-not-allowed");
    assert_eq!(reply.header("allow"), "POST");
    let reply = Call::new("PATCH", "/jobs/018f0000-0000-7000-8000-000000000000").send(&site()).await;
    reply.problem(405, "method-not-allowed");
    assert!(reply.header("allow").contains("DELETE"));
}

#[tokio::test]
async fn a_panic_of_the_solver_answers_the_waiting_client() {
    let site = Site::new(one_worker(), std::sync::Arc::new(|_, _| panic!("on purpose")));
    let reply = Call::solve(DECAY).send(&site).await;
    reply.problem(500, "defect");
    assert_eq!(reply.status, StatusCode::INTERNAL_SERVER_ERROR);
}
