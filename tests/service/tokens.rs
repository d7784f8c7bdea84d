//! Access control: tokens, their scopes, and jobs of other clients.

use crate::harness::{Call, DECAY, Gate, Site, count, instant, one_worker};
use crate::process::{Folder, Server};
use crate::supervision::dvi_token;
use axum::http::StatusCode;
use dvi::service::Options;
use dvi::service::access::{Scope, create, revoke};
use std::time::{Duration, Instant};

fn asking(folder: &Folder) -> Options {
    Options { data: Some(folder.path().to_owned()), ephemeral: true, ask_tokens: true, ..one_worker() }
}

fn token(folder: &Folder, scopes: &[Scope]) -> String {
    create(folder.path(), "somebody", scopes, None).unwrap().to_string()
}

fn bearing(call: Call, token: &str) -> Call {
    call.header("authorization", &format!("Bearer {token}"))
}

#[tokio::test]
async fn work_needs_a_token_and_what_is_the_same_for_everyone_does_not() {
    let folder = Folder::new();
    let token = token(&folder, &[Scope::Submit]);
    let site = Site::new(asking(&folder), instant());
    let refused = Call::solve(DECAY).send(&site).await;
    refused.problem(401, "token-required");
    assert!(refused.header("www-authenticate").starts_with("Bearer"));
    for wrong in ["", "dvi_", &token[..token.len() - 1], &token.replace("dvi_", "dvi_0")] {
        bearing(Call::solve(DECAY), wrong).send(&site).await.problem(401, "token-required");
    }
    let last = if token.ends_with('0') { "1" } else { "0" };
    let other_secret = format!("{}{last}", &token[..token.len() - 1]);
    bearing(Call::solve(DECAY), &other_secret).send(&site).await.problem(401, "token-required");
    Call::check(DECAY).send(&site).await.problem(401, "token-required");
    site.get("/jobs/00000000-0000-7000-8000-000000000000").await.problem(401, "token-required");
    assert_eq!(bearing(Call::solve(DECAY), &token).send(&site).await.status, StatusCode::OK);
    for path in ["/healthz", "/readyz", "/version", "/methods", "/examples", "/schema", "/problems"] {
        assert_eq!(site.get(path).await.status, StatusCode::OK, "{path}");
    }
}

#[tokio::test]
async fn a_scope_allows_what_it_says_and_no_more() {
    let folder = Folder::new();
    let (reads, submits) = (token(&folder, &[Scope::Read]), token(&folder, &[Scope::Submit]));
    let site = Site::new(asking(&folder), instant());
    bearing(Call::solve(DECAY), &reads).send(&site).await.problem(403, "scope-missing");
    let path = accept(&site, &submits).await;
    bearing(Call::new("GET", &path), &submits).send(&site).await.problem(403, "scope-missing");
    bearing(Call::new("DELETE", &path), &reads).send(&site).await.problem(403, "scope-missing");
    assert_eq!(bearing(Call::new("DELETE", &path), &submits).send(&site).await.status, StatusCode::NO_CONTENT);
}

#[tokio::test]
async fn the_job_of_another_is_not_found_whatever_is_asked_of_it() {
    let folder = Folder::new();
    let both = [Scope::Submit, Scope::Read];
    let (anna, bert, admin) = (token(&folder, &both), token(&folder, &both), token(&folder, &[Scope::Admin]));
    let gate = Gate::new();
    let site = Site::new(asking(&folder), gate.solver());
    let path = accept(&site, &anna).await;
    let requests = [
        ("GET", path.clone()),
        ("GET", format!("{path}/results")),
        ("GET", format!("{path}/specification")),
        ("POST", format!("{path}/cancel")),
        ("DELETE", path.clone()),
    ];
    let unknown = "00000000-0000-7000-8000-000000000000";
    for (method, address) in &requests {
        let refused = bearing(Call::new(method, address), &bert).send(&site).await;
        refused.problem(404, "no-such-job");
        let id = path.rsplit('/').next().unwrap();
        let nothing = bearing(Call::new(method, &address.replace(id, unknown)), &bert).send(&site).await;
        assert_eq!(refused.text().replace(id, unknown), nothing.text(), "the answer tells whether {address} exists");
    }
    let own = bearing(Call::new("GET", &path), &anna).send(&site).await.json();
    assert!(own["status"] == "running" || own["status"] == "accepted", "{own}");
    assert_eq!(bearing(Call::new("GET", &path), &admin).send(&site).await.status, StatusCode::OK);
    assert_eq!(bearing(Call::new("DELETE", &path), &admin).send(&site).await.status, StatusCode::NO_CONTENT);
}

#[tokio::test]
async fn the_same_key_of_another_client_is_another_key() {
    let site = Site::new(one_worker(), instant());
    let post = |client, document: &str| {
        let call = Call::solve(document.to_owned()).client(client).header("idempotency-key", "k");
        call.header("prefer", "respond-async")
    };
    let first = post(1, DECAY).send(&site).await.header("location").to_owned();
    assert_eq!(post(1, DECAY).send(&site).await.header("location"), first);
    assert_ne!(post(2, DECAY).send(&site).await.header("location"), first);
    post(1, &DECAY.replace("-x", "-2*x")).send(&site).await.problem(422, "key-reused");
    Call::solve(DECAY).header("idempotency-key", "").send(&site).await.problem(400, "bad-key");
    Call::new("DELETE", &first).send(&site).await;
    assert_ne!(post(1, DECAY).send(&site).await.header("location"), first, "a key goes with its job");
}

#[tokio::test]
async fn the_share_of_the_queue_is_that_of_a_token() {
    let folder = Folder::new();
    let (anna, bert) = (token(&folder, &[Scope::Submit]), token(&folder, &[Scope::Submit]));
    let gate = Gate::new();
    let site = Site::new(Options { queue: count(10), client_share: count(1), ..asking(&folder) }, gate.solver());
    accept(&site, &anna).await;
    gate.entered(1).await;
    accept(&site, &anna).await;
    bearing(Call::solve(DECAY), &anna).send(&site).await.problem(429, "client-share");
    accept(&site, &bert).await;
}

#[tokio::test]
async fn a_token_that_is_created_or_revoked_counts_without_a_restart() {
    let folder = Folder::new();
    std::fs::create_dir_all(folder.path()).unwrap();
    let site = Site::new(asking(&folder), instant());
    bearing(Call::check(DECAY), "dvi_none").send(&site).await.problem(401, "token-required");
    let token = token(&folder, &[Scope::Submit]);
    becomes(&site, &token, StatusCode::OK).await;
    assert!(revoke(folder.path(), token.split('_').nth(1).unwrap()).unwrap());
    becomes(&site, &token, StatusCode::UNAUTHORIZED).await;
}

#[test]
fn an_address_that_others_reach_asks_for_the_tokens_that_the_program_makes() {
    let folder = Folder::new();
    let made = dvi_token(&folder, &["create", "--name", "anna of the lab"]);
    let token = String::from_utf8(made.stdout).unwrap().trim().to_owned();
    let listed = String::from_utf8(dvi_token(&folder, &["list"]).stdout).unwrap();
    let (number, secret) = (token.split('_').nth(1).unwrap(), token.split('_').nth(2).unwrap());
    assert!(listed.contains(number) && listed.contains("anna of the lab") && !listed.contains(secret), "{listed}");
    let kept = std::fs::read_to_string(folder.path().join("tokens.json")).unwrap();
    assert!(!kept.contains(secret), "the secret is at rest as it is");

    let server = Server::start_at("0.0.0.0:0", &folder, &[]);
    server.send("POST", "/solve", "", DECAY).problem(401, "token-required");
    let bearer = format!("authorization: Bearer {token}\r\n");
    assert_eq!(server.send("POST", "/solve", &bearer, DECAY).status, 200);
    let path = server.send("POST", "/solve", &format!("{bearer}prefer: respond-async\r\n"), DECAY).header("location");
    drop(server);
    let server = Server::start_at("0.0.0.0:0", &folder, &[]);
    assert_eq!(server.send("GET", &path, &bearer, "").status, 200, "a job stays its token's after a restart");
    drop(server);
    let server = Server::start_at("0.0.0.0:0", &folder, &["--insecure"]);
    assert_eq!(server.send("POST", "/solve", "", DECAY).status, 200);
    assert_eq!(dvi_token(&folder, &["revoke", number]).status.code(), Some(0));
    assert_eq!(dvi_token(&folder, &["revoke", number]).status.code(), Some(1));
}

async fn accept(site: &Site, token: &str) -> String {
    let reply = bearing(Call::solve(DECAY), token).header("prefer", "respond-async").send(site).await;
    assert_eq!(reply.status, StatusCode::ACCEPTED, "{:?}", reply.json());
    reply.header("location").to_owned()
}

/// Waits until the service answers a check request with `token` with the status `status`.
async fn becomes(site: &Site, token: &str, status: StatusCode) {
    let start = Instant::now();
    while bearing(Call::check(DECAY), token).send(site).await.status != status {
        assert!(start.elapsed() < Duration::from_secs(30), "{status} does not come");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}
