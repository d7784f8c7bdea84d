//! Tests of the streams of server-sent events that report the progress of a job.

use crate::harness::{Call, DECAY, Gate, Reply, Site, count, instant, one_worker};
use crate::nats::on_both;
use axum::body::HttpBody;
use axum::http::StatusCode;
use dvi::problem::{Event, EventKind};
use dvi::service::Options;
use serde_json::Value;
use std::future::poll_fn;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

on_both! {
    a_stream_tells_progress_and_switches_and_the_end,
    a_client_that_comes_back_is_told_what_it_missed_and_no_more_than_is_kept,
    an_ended_job_is_done_at_once,
    a_waiting_job_that_is_cancelled_is_done,
    a_streamed_solve_ends_in_its_result,
    a_streamed_solve_that_breaks_down_ends_in_the_problem,
    a_client_that_leaves_its_streamed_solve_takes_it_along,
}

/// Returns the name, id and data of every event of a stream, parsed as a browser does.
fn parsed(text: &str) -> Vec<(String, u64, Value)> {
    let mut events = Vec::new();
    for block in text.split("\n\n").filter(|block| !block.is_empty() && *block != ":") {
        let field = |name: &str| block.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(": ")).unwrap();
        events.push((field("event").to_owned(), field("id").parse().unwrap(), field("data").parse().unwrap()));
    }
    events
}

fn events(reply: &Reply) -> Vec<(String, u64, Value)> {
    assert_eq!(reply.status, StatusCode::OK, "{reply:?}");
    assert_eq!(reply.header("content-type"), "text/event-stream");
    assert_eq!(reply.header("cache-control"), "no-store");
    parsed(reply.text())
}

fn stick(k: u32) -> Event {
    Event { t: f64::from(k), kind: EventKind::Stick, of: format!("foot {k}") }
}

/// Returns a solver that reports `n` stick events and is then blocked until `gate` lets it through.
fn sticking(n: u32, gate: &Arc<Gate>) -> dvi::service::jobs::Solver {
    let solver = gate.solver();
    Arc::new(move |specification, control| {
        control.tell(&(1..=n).map(stick).collect::<Vec<_>>());
        solver(specification, control)
    })
}

/// Lets one blocked solve finish after half a second; meanwhile its event stream is polled.
async fn let_through_later(gate: Arc<Gate>) {
    tokio::time::sleep(Duration::from_millis(500)).await;
    gate.let_through(1);
}

async fn a_stream_tells_progress_and_switches_and_the_end() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), sticking(2, &gate));
    let path = site.accept(1).await;
    gate.entered(1).await;
    site.reported(&path).await;
    tokio::spawn(let_through_later(gate));
    let told = events(&site.get(&format!("{path}/events")).await);
    let order: Vec<(&str, u64)> = told.iter().map(|(name, id, _)| (name.as_str(), *id)).collect();
    assert_eq!(order, [("switch", 1), ("switch", 2), ("progress", 2), ("done", 2)]);
    assert_eq!(told[1].2, serde_json::json!({"number": 2, "t": 2.0, "kind": "stick", "of": "foot 2"}));
    let status = |k: usize| (told[k].2["status"].as_str().unwrap(), told[k].2["progress"].as_u64().unwrap());
    assert_eq!((status(2), status(3)), (("running", 50), ("successful", 100)));
    assert_eq!((told[2].2.get("trusted"), &told[3].2["trusted"]), (None, &true.into()));
}

async fn a_client_that_comes_back_is_told_what_it_missed_and_no_more_than_is_kept() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), sticking(1000, &gate));
    let path = format!("{}/events", site.accept(1).await);
    gate.entered(1).await;
    tokio::spawn(let_through_later(gate));
    let resumed = async |id: &str| {
        let told = events(&Call::new("GET", &path).header("last-event-id", id).send(&site).await);
        told.iter().filter(|(name, ..)| name == "switch").map(|(_, id, _)| *id).collect::<Vec<_>>()
    };
    let (late, nonsense) = tokio::join!(resumed("997"), resumed("-1; DROP TABLE"));
    assert_eq!(late, [998, 999, 1000]);
    assert_eq!(nonsense, (745..=1000).collect::<Vec<_>>());
}

async fn an_ended_job_is_done_at_once() {
    let site = Site::new(one_worker(), instant());
    let path = site.accept(1).await;
    site.ended(&path).await;
    let told = events(&site.get(&format!("{path}/events")).await);
    let names: Vec<&str> = told.iter().map(|(name, ..)| name.as_str()).collect();
    assert_eq!(names, ["done"]);
}

async fn a_waiting_job_that_is_cancelled_is_done() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let (running, waiting) = (site.accept(1).await, site.accept(1).await);
    gate.entered(1).await;
    let cancel = async {
        tokio::time::sleep(Duration::from_millis(300)).await;
        Call::new("POST", &format!("{waiting}/cancel")).send(&site).await
    };
    let events_path = format!("{waiting}/events");
    let (reply, _) = tokio::join!(site.get(&events_path), cancel);
    let told = events(&reply);
    assert_eq!((told[0].0.as_str(), &told[0].2["queue_position"]), ("progress", &0.into()));
    assert_eq!((told[1].0.as_str(), &told[1].2["status"]), ("done", &"dismissed".into()));
    Call::new("DELETE", &running).send(&site).await;
}

#[tokio::test]
async fn the_events_of_a_job_that_is_not_there_are_a_problem() {
    let site = Site::new(one_worker(), instant());
    site.get("/jobs/00000000-0000-7000-8000-000000000000/events").await.problem(404, "no-such-job");
    site.get("/jobs/..%2f..%2fetc/events").await.problem(404, "no-such-job");
}

#[tokio::test(start_paused = true)]
async fn a_silent_stream_is_kept_alive_by_comments() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let path = site.accept(1).await;
    gate.entered(1).await;
    let mut body = Call::new("GET", &format!("{path}/events")).body(&site).await;
    let mut next = async || {
        let frame = poll_fn(|context| Pin::new(&mut body).poll_frame(context)).await.unwrap().unwrap();
        (tokio::time::Instant::now(), frame.into_data().unwrap())
    };
    let (mut before, first) = next().await;
    assert!(first.starts_with(b"event: progress\n"));
    for _ in 0..4 {
        let (now, comment) = next().await;
        assert_eq!(&comment[..], b":\n\n");
        let silence = (now - before).as_secs_f64();
        assert!((14.0..16.0).contains(&silence), "{silence} s");
        before = now;
    }
}

#[tokio::test(start_paused = true)]
async fn a_client_that_takes_nothing_loses_its_stream_and_its_solve() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), sticking(100, &gate));
    let call = Call::solve(DECAY).header("accept", "text/event-stream");
    let mut body = call.body(&site).await;
    site.idle().await;
    let mut taken = 0;
    while poll_fn(|context| Pin::new(&mut body).poll_frame(context)).await.is_some() {
        taken += 1;
    }
    assert!(taken < 100, "{taken} events were held for a client that took none");
}

async fn a_streamed_solve_ends_in_its_result() {
    let site = Site::new(one_worker(), instant());
    let reply = Call::solve(DECAY).header("accept", "text/event-stream").send(&site).await;
    let told = events(&reply);
    let (name, _, result) = told.last().unwrap();
    assert_eq!((name.as_str(), &result["trajectory"]["fields"]["x"]), ("result", &serde_json::json!([1.0, 0.5])));
    let (name, _, status) = &told[told.len() - 2];
    let path = status["links"][0]["href"].as_str().unwrap();
    assert_eq!((name.as_str(), site.get(path).await.status), ("done", StatusCode::OK));
}

async fn a_streamed_solve_that_breaks_down_ends_in_the_problem() {
    let site = Site::new(one_worker(), Arc::new(|_, _| panic!("on purpose")));
    let told = events(&Call::solve(DECAY).header("accept", "text/event-stream").send(&site).await);
    let (name, _, problem) = told.last().unwrap();
    assert_eq!((name.as_str(), &problem["type"]), ("problem", &"/problems/defect".into()));
}

async fn a_client_that_leaves_its_streamed_solve_takes_it_along() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let body = Call::solve(DECAY).header("accept", "text/event-stream").body(&site).await;
    gate.entered(1).await;
    drop(body);
    gate.cancelled(1).await;
    site.idle().await;
}

#[tokio::test]
async fn streams_are_bounded_and_a_place_is_given_back() {
    let gate = Gate::new();
    let site = Site::new(Options { streams: count(1), ..one_worker() }, gate.solver());
    let path = format!("{}/events", site.accept(1).await);
    gate.entered(1).await;
    let first = Call::new("GET", &path).body(&site).await;
    let refused = site.get(&path).await;
    refused.problem(503, "too-many-streams");
    assert_eq!(refused.header("retry-after"), "10");
    Call::solve(DECAY).header("accept", "text/event-stream").send(&site).await.problem(503, "too-many-streams");
    drop(first);
    gate.let_through(1);
    let deadline = tokio::time::Instant::now() + Duration::from_secs(20);
    while site.get(&path).await.status != StatusCode::OK {
        assert!(tokio::time::Instant::now() < deadline, "the place was not given back");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}
