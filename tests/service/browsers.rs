//! Protection of the service against pages of other sites, and of its users against content of responses.

use crate::harness::{Call, DECAY, Site, instant, one_worker};
use axum::http::StatusCode;

const FORM: &str = "application/x-www-form-urlencoded";

#[tokio::test]
async fn a_page_of_another_site_can_neither_solve_nor_cancel() {
    let site = Site::new(one_worker(), instant());
    let path = site.accept(1).await;
    let foreign = |call: Call| call.header("host", "localhost:8080").header("origin", "https://evil.example");
    foreign(Call::solve(DECAY).header("content-type", FORM)).send(&site).await.problem(403, "cross-site");
    foreign(Call::check(DECAY)).send(&site).await.problem(403, "cross-site");
    foreign(Call::new("POST", &format!("{path}/cancel"))).send(&site).await.problem(403, "cross-site");
    foreign(Call::new("DELETE", &path)).send(&site).await.problem(403, "cross-site");
    let fetched = Call::solve(DECAY).header("sec-fetch-site", "same-site").send(&site).await;
    fetched.problem(403, "cross-site");
    assert_eq!(site.get(&path).await.status, StatusCode::OK);
}

#[tokio::test]
async fn curl_and_the_own_page_can() {
    let site = Site::new(one_worker(), instant());
    let curl = Call::solve(DECAY).header("host", "localhost:8080").header("content-type", FORM).send(&site).await;
    assert_eq!(curl.status, StatusCode::OK);
    let page = Call::solve(DECAY).header("host", "localhost:8080").header("origin", "http://localhost:8080");
    assert_eq!(page.header("sec-fetch-site", "same-origin").send(&site).await.status, StatusCode::OK);
}

#[tokio::test]
async fn every_answer_lets_browsers_run_nothing() {
    let site = Site::new(one_worker(), instant());
    let path = site.accept(1).await;
    site.ended(&path).await;
    for path in [&path, "/nothing", "/metrics", "/examples", &format!("{path}/results"), &format!("{path}/events")] {
        let reply = site.get(path).await;
        let policy = reply.header("content-security-policy");
        assert!(policy.contains("default-src 'none'") && policy.contains("frame-ancestors 'none'"), "{path}: {policy}");
        assert!(!policy.contains("script-src"), "{path}: {policy}");
        assert_eq!(reply.header("x-content-type-options"), "nosniff", "{path}");
        assert_eq!(reply.header("referrer-policy"), "no-referrer", "{path}");
        assert_eq!(reply.header("cross-origin-resource-policy"), "same-origin", "{path}");
    }
}

#[tokio::test]
async fn a_picture_has_its_style_and_no_more() {
    let site = Site::new(one_worker(), instant());
    let reply = Call::solve(DECAY).header("accept", "image/svg+xml").send(&site).await;
    let policy = reply.header("content-security-policy");
    assert!(policy.contains("style-src 'unsafe-inline'") && policy.contains("sandbox"), "{policy}");
}
