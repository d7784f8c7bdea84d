//! Access to the service: pages of other origins, a path prefix behind a proxy, tokens that expire, and the access log.

use crate::harness::{Call, DECAY, Gate, Site, instant, one_worker};
use crate::process::{DVI, Folder, RESPONSE_TIMEOUT, send};
use axum::http::StatusCode;
use dvi::service::Options;
use dvi::service::access::{Scope, create, revoke};
use http_body_util::BodyExt;
use jiff::{SignedDuration, Timestamp};
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use tokio::time::timeout;

const LAB: &str = "https://lab.example";

#[tokio::test]
async fn a_page_of_a_named_origin_may_solve_and_read_the_answer() {
    let options = Options { cors_origin: vec![LAB.to_owned()], ..one_worker() };
    let site = Site::new(options, instant());
    let asked = Call::new("OPTIONS", "/solve").header("origin", LAB).header("access-control-request-method", "POST");
    let granted = asked.send(&site).await;
    assert_eq!((granted.status, granted.header("access-control-allow-origin")), (StatusCode::NO_CONTENT, LAB));
    assert!(granted.header("access-control-allow-headers").contains("authorization"));
    let solved = Call::solve(DECAY).header("origin", LAB).header("sec-fetch-site", "cross-site").send(&site).await;
    assert_eq!((solved.status, solved.header("access-control-allow-origin")), (StatusCode::OK, LAB));
    assert_eq!(solved.header("cross-origin-resource-policy"), "cross-origin");
    assert!(solved.headers.get_all("vary").iter().any(|vary| vary == "origin"));
}

#[tokio::test]
async fn pages_of_other_origins_stay_outside() {
    let options = Options { cors_origin: vec![LAB.to_owned()], ..one_worker() };
    let site = Site::new(options, instant());
    for origin in ["https://evil.example", "https://lab.example.evil.example", "http://lab.example", "null"] {
        let refused = Call::solve(DECAY).header("origin", origin).send(&site).await;
        refused.problem(403, "cross-site");
        assert!(!refused.headers.contains_key("access-control-allow-origin"), "{origin}");
        let asked =
            Call::new("OPTIONS", "/solve").header("origin", origin).header("access-control-request-method", "POST");
        asked.send(&site).await.problem(405, "method-not-allowed");
    }
    let asked = Call::new("OPTIONS", "/solve").header("origin", LAB).header("access-control-request-method", "POST");
    asked.send(&Site::new(one_worker(), instant())).await.problem(405, "method-not-allowed");
}

#[tokio::test]
async fn under_a_path_every_address_has_it() {
    let options = Options { path_prefix: "/dvi/".to_owned(), ..one_worker() };
    let site = Site::new(options, instant());
    for asked in ["/dvi/solve", "/solve"] {
        let call = Call::post(asked, DECAY).client(1).header("prefer", "respond-async");
        let reply = call.send(&site).await;
        assert_eq!(reply.status, StatusCode::ACCEPTED, "{}", reply.text());
        let path = reply.header("location").to_owned();
        assert!(path.starts_with("/dvi/jobs/") && reply.header("link").starts_with("</dvi/jobs/"), "{reply:?}");
        site.ended(&path).await;
        let status = Call::new("GET", &path).client(1).send(&site).await.json();
        assert!(
            status["links"].as_array().unwrap().iter().all(|link| link["href"].as_str().unwrap().starts_with("/dvi/"))
        );
        let events = Call::new("GET", &format!("{path}/events")).client(1).send(&site).await;
        assert!(events.text().contains("\"href\":\"/dvi/jobs/"), "{}", events.text());
    }
    let list = Call::new("GET", "/dvi/jobs?limit=1").client(1).send(&site).await;
    assert!(list.header("link").starts_with("</dvi/jobs?"), "{list:?}");
    assert_eq!(site.get("/dvi/jobs/nothing").await.json()["type"], "/dvi/problems/no-such-job");
    assert_eq!(site.get("/dvi/nothing").await.json()["type"], "/dvi/problems/not-found");
    for page in ["/dvi/", "/", "/dvi/docs", "/dvi/docs/interface", "/dvi/docs/search?q=step"] {
        let page = site.get(page).await;
        assert!(!page.text().replace("=\"/dvi/", "").contains("=\"/"), "{}", page.text());
    }
    for path in ["/healthz", "/dvi/healthz", "/dvi/page/page.js", "/dvi/problems/unknown_key"] {
        assert_eq!(site.get(path).await.status, StatusCode::OK, "{path}");
    }
    let text = site.get("/metrics").await.text().to_owned();
    assert!(text.contains("dvi_request_seconds_count{method=\"POST\",route=\"/solve\"} 2"), "{text}");
}

#[test]
fn flags_that_make_no_sense_are_refused_before_anything_starts() {
    for (flag, value) in
        [("--path-prefix", "dvi"), ("--path-prefix", "/a b"), ("--cors-origin", "*"), ("--cors-origin", "lab.example")]
    {
        let refused = Command::new(DVI).args(["serve", "--ephemeral", "--listen", "127.0.0.1:0", flag, value]).output();
        let refused = refused.unwrap();
        assert_eq!(refused.status.code(), Some(5), "{flag} {value}");
        assert!(String::from_utf8(refused.stderr).unwrap().contains(flag), "{flag} {value}");
    }
}

fn asking(folder: &Folder) -> Options {
    Options { data: Some(folder.path().to_owned()), ephemeral: true, ask_tokens: true, ..one_worker() }
}

fn number(token: &str) -> &str {
    token.split('_').nth(1).unwrap()
}

#[tokio::test]
async fn a_token_ends_by_itself() {
    let folder = Folder::new();
    let soon = Timestamp::now() + SignedDuration::from_millis(1500);
    let token = create(folder.path(), "guest", &[Scope::Submit, Scope::Read], Some(soon)).unwrap().to_string();
    let site = Site::new(asking(&folder), instant());
    let bearer = format!("Bearer {token}");
    assert_eq!(Call::check(DECAY).header("authorization", &bearer).send(&site).await.status, StatusCode::OK);
    tokio::time::sleep(Duration::from_millis(1600)).await;
    Call::check(DECAY).header("authorization", &bearer).send(&site).await.problem(401, "token-required");
}

#[tokio::test]
async fn streams_end_with_their_token() {
    let folder = Folder::new();
    let soon = Timestamp::now() + SignedDuration::from_secs(2);
    let token =
        |expires| create(folder.path(), "somebody", &[Scope::Submit, Scope::Read], expires).unwrap().to_string();
    let (ending, revoked, lasting) = (token(Some(soon)), token(None), token(None));
    let gate = Gate::new();
    let site = Site::new(asking(&folder), gate.solver());
    let mut streams = Vec::new();
    for token in [&ending, &revoked, &lasting] {
        let bearer = format!("Bearer {token}");
        let call = Call::solve(DECAY).header("authorization", &bearer).header("prefer", "respond-async");
        let path = call.send(&site).await.header("location").to_owned();
        let events = Call::new("GET", &format!("{path}/events")).header("authorization", &bearer);
        streams.push(tokio::spawn(events.body(&site).await.collect()));
    }
    revoke(folder.path(), number(&revoked)).unwrap();
    let lasts = streams.pop().unwrap();
    for stream in streams {
        let told = timeout(RESPONSE_TIMEOUT, stream).await.unwrap().unwrap().unwrap().to_bytes();
        assert!(!String::from_utf8_lossy(&told).contains("event: done"));
    }
    assert!(!lasts.is_finished());
    gate.let_through(3);
    let told = timeout(RESPONSE_TIMEOUT, lasts).await.unwrap().unwrap().unwrap().to_bytes();
    assert!(String::from_utf8_lossy(&told).contains("event: done"));
}

#[tokio::test]
async fn tokens_that_cannot_be_read_are_the_fault_of_the_service() {
    let folder = Folder::new();
    let token = create(folder.path(), "anna", &[Scope::Submit], None).unwrap().to_string();
    let site = Site::new(asking(&folder), instant());
    let bearer = format!("Bearer {token}");
    let check = || Call::check(DECAY).header("authorization", &bearer).send(&site);
    let file = folder.path().join("tokens.json");
    let kept = fs::read(&file).unwrap();
    // A folder in place of the token file is unreadable even for root, to whom file modes do not apply.
    fs::remove_file(&file).unwrap();
    fs::create_dir(&file).unwrap();
    tokio::time::sleep(Duration::from_millis(300)).await;
    let refused = check().await;
    refused.problem(503, "tokens-unreadable");
    assert!(!refused.header("retry-after").is_empty() && !refused.headers.contains_key("www-authenticate"));
    fs::remove_dir(&file).unwrap();
    fs::write(&file, kept).unwrap();
    tokio::time::sleep(Duration::from_millis(300)).await;
    assert_eq!(check().await.status, StatusCode::OK);
}

#[test]
fn a_token_belongs_to_whom_the_folder_belongs() {
    let folder = Folder::new();
    fs::create_dir_all(folder.path()).unwrap();
    // Only root can change the owner of a folder; for other users, the owner of the token file is right anyway.
    let given = std::os::unix::fs::chown(folder.path(), Some(65_532), Some(65_532)).is_ok();
    if given {
        create(folder.path(), "anna", &[Scope::Read], None).unwrap();
        let data = fs::metadata(folder.path().join("tokens.json")).unwrap();
        assert_eq!((std::os::unix::fs::MetadataExt::uid(&data), data.permissions().mode() & 0o777), (65_532, 0o600));
    }
}

/// Runs the service as a separate process, and reads its access log.
#[test]
fn a_request_and_its_job_have_a_line_each_joined_by_their_ids_and_without_secrets() {
    let folder = Folder::new();
    // The token is created before the service starts, since the service reads new tokens with a delay.
    fs::create_dir_all(folder.path()).unwrap();
    let token = create(folder.path(), "anna", &[Scope::Submit, Scope::Read], None).unwrap().to_string();
    let mut child = Command::new(DVI)
        .args(["serve", "--listen", "127.0.0.1:0", "--log-format", "json", "--ask-tokens", "--data"])
        .arg(folder.path())
        .env("RUST_LOG", "info")
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut log = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    let address = loop {
        line.clear();
        assert!(log.read_line(&mut line).unwrap() > 0, "no service");
        let told: Value = serde_json::from_str(&line).unwrap();
        if let Some(address) = told["fields"]["address"].as_str() {
            break address.to_owned();
        }
    };
    let trace = "4bf92f3577b34da6a3ce929d0e0e4736";
    let headers = format!(
        "authorization: Bearer {token}\r\nx-request-id: mine\r\ntraceparent: 00-{trace}-00f067aa0ba902b7-01\r\n"
    );
    let labelled = DECAY.replacen('{', "{\"label\":\"confidential\",", 1);
    let answer = send(&address, "POST", "/solve?secret=query", &headers, &labelled);
    let answer = answer.unwrap();
    assert_eq!(answer.status, 200, "{answer:?}");
    let given = answer.field("traceparent").unwrap();
    assert!(given.contains(trace) && !given.contains("00f067aa0ba902b7"), "{given}");
    send(&address, "GET", "/healthz", "", "").unwrap();
    let start = Instant::now();
    std::thread::sleep(Duration::from_millis(200));
    Command::new("kill").args(["-s", "TERM", &child.id().to_string()]).status().unwrap();
    let mut told = String::new();
    log.read_to_string(&mut told).unwrap();
    child.wait().unwrap();
    assert!(start.elapsed() < RESPONSE_TIMEOUT);
    let lines: Vec<Value> = told.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let of = |target: &str| {
        lines.iter().filter(|line| line["target"] == target).map(|line| &line["fields"]).collect::<Vec<_>>()
    };
    let (requests, jobs) = (of("dvi::request"), of("dvi::job"));
    assert_eq!((requests.len(), jobs.len()), (1, 1), "{told}");
    for line in [requests[0], jobs[0]] {
        assert_eq!((&line["request.id"], &line["trace.id"]), (&"mine".into(), &trace.into()), "{told}");
        assert_eq!(line["client"], format!("token {}", number(&token)));
        assert!(line["duration_ms"].as_f64().unwrap() >= 0.0 && line["bytes"].as_u64().unwrap() > 0, "{told}");
    }
    assert_eq!(requests[0]["job.id"], jobs[0]["job.id"]);
    assert_eq!((&requests[0]["http.status"], &requests[0]["bytes"]), (&200.into(), &answer.body.len().into()));
    assert_eq!(jobs[0]["ending"], "successful");
    assert!(
        !told.contains("confidential") && !told.contains("query") && !told.contains(token.split('_').nth(2).unwrap()),
        "{told}"
    );
}
