//! `POST /solve`: a response with the result if the solve ends within the wait, or with a job to monitor.

use crate::harness::{Call, DECAY, Gate, Site, count, halving, instant, one_worker};
use crate::nats::on_both;
use axum::http::StatusCode;
use dvi::problem::Control;
use dvi::service::Options;
use dvi::solution::Status;
use dvi::specification::Specification;
use std::sync::Arc;
use std::time::{Duration, Instant};

on_both! {
    a_solve_within_the_wait_answers_with_the_result,
    what_is_transient_leaves_no_job_behind_its_results,
    a_wait_of_zero_answers_before_the_solve_ends,
    a_request_that_is_dropped_takes_its_job_with_it,
    a_request_that_is_dropped_while_its_job_waits_leaves_the_queue,
    failed_numerics_are_an_answer_with_the_trajectory_so_far,
    a_solve_that_the_wall_time_stops_is_a_failed_job_with_its_trajectory,
    a_long_table_is_whole,
    server_timing_tells_waiting_and_solving_apart,
}

async fn a_solve_within_the_wait_answers_with_the_result() {
    let site = Site::new(one_worker(), instant());
    let reply = Call::solve(DECAY).header("prefer", "wait=20").send(&site).await;
    assert_eq!(reply.status, StatusCode::OK);
    assert_eq!(reply.header("content-type"), "application/json");
    assert_eq!(reply.header("preference-applied"), "wait=20");
    assert_eq!(reply.header("cache-control"), "no-store");
    assert_eq!(reply.header("vary"), "accept, prefer");
    assert_eq!(reply.json()["trajectory"]["fields"]["x"], serde_json::json!([1.0, 0.5]));
    let link = reply.header("link");
    let path = link.strip_prefix('<').and_then(|link| link.strip_suffix(">; rel=\"monitor\"")).expect(link);
    assert_eq!(site.get(path).await.json()["status"], "successful");
    assert_eq!(site.get(&format!("{path}/results")).await.body, reply.body);
}

async fn what_is_transient_leaves_no_job_behind_its_results() {
    let site = Site::new(one_worker(), instant());
    let reply = Call::solve(DECAY).header("prefer", "wait=20, transient").send(&site).await;
    assert_eq!(reply.status, StatusCode::OK);
    assert_eq!(reply.header("preference-applied"), "wait=20, transient");
    assert_eq!(reply.json()["trajectory"]["fields"]["x"], serde_json::json!([1.0, 0.5]));
    assert_eq!(reply.headers.get("link"), None);
    // A transient job is deleted as soon as its request has been answered.
    for _ in 0..1000 {
        if site.get("/jobs").await.json()["jobs"] == serde_json::json!([]) {
            return;
        }
        tokio::task::yield_now().await;
    }
    panic!("the job is still there");
}

async fn server_timing_tells_waiting_and_solving_apart() {
    let site = Site::new(one_worker(), instant());
    let reply = Call::solve(DECAY).send(&site).await;
    let timing = reply.header("server-timing");
    let durations: Vec<f64> =
        timing.split(", ").map(|part| part.split_once(";dur=").expect(timing).1.parse().expect(timing)).collect();
    assert!(timing.starts_with("queue;dur=") && timing.contains(", solve;dur="), "{timing}");
    assert!(durations.len() == 2 && durations.iter().all(|ms| (0.0..10_000.0).contains(ms)), "{timing}");
}

#[tokio::test(start_paused = true)]
async fn a_wait_that_elapses_gives_a_monitor_and_the_job_lives_on() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let reply = Call::solve(DECAY).header("prefer", "wait=3").send(&site).await;
    assert_eq!(reply.status, StatusCode::ACCEPTED);
    assert_eq!(reply.header("preference-applied"), "wait=3");
    assert!((1..=600).contains(&reply.header("retry-after").parse::<u64>().unwrap()));
    let path = reply.header("location");
    assert_eq!(format!("/jobs/{}", reply.json()["id"].as_str().unwrap()), path);
    gate.let_through(1);
    assert_eq!(site.ended(path).await["status"], "successful");
    let results = site.get(&format!("{path}/results")).await;
    assert_eq!(results.json()["trajectory"]["t"], serde_json::json!([0.0, 1.0]));
}

async fn a_wait_of_zero_answers_before_the_solve_ends() {
    for prefer in ["wait=0", "respond-async"] {
        let gate = Gate::new();
        let site = Site::new(one_worker(), gate.solver());
        let reply = Call::solve(DECAY).header("prefer", prefer).send(&site).await;
        assert_eq!(reply.status, StatusCode::ACCEPTED);
        assert_eq!(reply.header("preference-applied"), prefer);
        gate.let_through(1);
        assert_eq!(site.ended(reply.header("location")).await["progress"], 100);
    }
}

async fn a_request_that_is_dropped_takes_its_job_with_it() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let running = tokio::spawn(Call::solve(DECAY).send_to(site.router.clone()));
    gate.entered(1).await;
    running.abort();
    gate.cancelled(1).await;
}

async fn a_request_that_is_dropped_while_its_job_waits_leaves_the_queue() {
    let gate = Gate::new();
    let site = Site::new(Options { queue: count(1), ..one_worker() }, gate.solver());
    let running = tokio::spawn(Call::solve(DECAY).send_to(site.router.clone()));
    gate.entered(1).await;
    let waiting = tokio::spawn(Call::solve(DECAY).send_to(site.router.clone()));
    let another = || Call::solve(DECAY).header("prefer", "wait=0").send(&site);
    tokio::task::yield_now().await;
    assert_eq!(another().await.status, StatusCode::TOO_MANY_REQUESTS, "the place is taken");
    waiting.abort();
    assert!(waiting.await.unwrap_err().is_cancelled());
    // The job that was waiting leaves the queue shortly after its request has been dropped.
    let start = Instant::now();
    while another().await.status != StatusCode::ACCEPTED {
        assert!(start.elapsed() < Duration::from_secs(20), "the place stays taken");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    gate.let_through(2);
    assert_eq!(running.await.unwrap().status, StatusCode::OK);
}

async fn failed_numerics_are_an_answer_with_the_trajectory_so_far() {
    let site = Site::new(one_worker(), Arc::new(|_: &Specification, _: &Control| halving(Status::Failed)));
    let reply = Call::solve(DECAY).send(&site).await;
    assert_eq!(reply.status, StatusCode::OK);
    assert_eq!(reply.json()["status"], "failed");
    assert_eq!(reply.json()["trajectory"]["t"], serde_json::json!([0.0, 1.0]));
    let path = reply.header("link").trim_matches(['<', '>']).split('>').next().unwrap().to_owned();
    assert_eq!(site.get(&path).await.json()["status"], "failed");
}

async fn a_solve_that_the_wall_time_stops_is_a_failed_job_with_its_trajectory() {
    let options = Options { wall_seconds: std::num::NonZeroU64::MIN, ..one_worker() };
    let site = Site::new(options, Gate::new().solver());
    let path = site.accept(1).await;
    let status = site.ended(&path).await;
    assert_eq!(status["status"], "failed", "{status}");
    let results = site.get(&format!("{path}/results")).await;
    assert_eq!((results.status, results.json()["status"].as_str()), (StatusCode::OK, Some("stopped")));
}

#[tokio::test]
async fn what_curl_sends_by_default_is_taken_for_json() {
    let site = Site::new(one_worker(), instant());
    let reply = Call::solve(DECAY).header("content-type", "application/x-www-form-urlencoded").send(&site).await;
    assert_eq!(reply.status, StatusCode::OK);
}

#[tokio::test]
async fn the_table_is_given_to_who_asks_for_csv() {
    let site = Site::new(one_worker(), instant());
    let reply = Call::solve(DECAY).header("accept", "text/csv").send(&site).await;
    assert_eq!(reply.header("content-type"), "text/csv; charset=utf-8; header=present");
    assert_eq!(reply.text(), "t,x\n0.0,1.0\n1.0,0.5\n");
}

#[tokio::test]
async fn the_picture_is_given_to_who_asks_for_svg() {
    let site = Site::new(one_worker(), instant());
    let labelled = DECAY.replacen('{', r#"{"label":"A decay","#, 1);
    let reply = Call::solve(labelled).header("accept", "image/svg+xml").send(&site).await;
    assert_eq!(reply.header("content-type"), "image/svg+xml");
    let picture = roxmltree::Document::parse(reply.text()).unwrap();
    let lines = picture.descendants().filter(|node| node.has_tag_name("polyline")).count();
    assert!(lines == 1 && reply.text().contains("A decay"), "{}", reply.text());
    let path = reply.header("link").trim_matches('<').split('>').next().unwrap().to_owned() + "/results";
    let again = Call::new("GET", &path).header("accept", "image/*").send(&site).await;
    assert_eq!((again.header("vary"), &again.body), ("accept", &reply.body));
}

#[tokio::test]
async fn a_large_picture_is_drawn_all_the_same() {
    let solver = |_: &Specification, _: &Control| {
        let mut solution = halving(Status::Completed);
        solution.trajectory.t = (0..100_000).map(f64::from).collect();
        solution.trajectory.fields[0].values = solution.trajectory.t.iter().map(|t| t.sin()).collect();
        solution
    };
    let site = Site::new(one_worker(), Arc::new(solver));
    let reply = Call::solve(DECAY).header("accept", "image/svg+xml").send(&site).await;
    assert!(roxmltree::Document::parse(reply.text()).is_ok());
    assert!((10_000..100_000).contains(&reply.body.len()), "{} bytes", reply.body.len());
}

async fn a_long_table_is_whole() {
    let times: Vec<f64> = (0..50_000).map(f64::from).collect();
    let column = times.clone();
    let solver = move |_: &Specification, _: &Control| {
        let mut solution = halving(Status::Completed);
        solution.trajectory.t = column.clone();
        solution.trajectory.fields[0].values = column.iter().map(|t| 0.5 * t).collect();
        solution
    };
    let site = Site::new(one_worker(), Arc::new(solver));
    let reply = Call::solve(DECAY).header("accept", "text/csv").send(&site).await;
    let rows: Vec<(f64, f64)> = reply
        .text()
        .lines()
        .skip(1)
        .map(|row| row.split_once(',').unwrap())
        .map(|(t, x)| (t.parse().unwrap(), x.parse().unwrap()))
        .collect();
    assert!(rows.iter().copied().eq(times.iter().map(|t| (*t, 0.5 * t))), "{} rows", rows.len());
}

#[tokio::test]
async fn the_id_of_a_request_is_given_back_or_made() {
    let site = Site::new(one_worker(), instant());
    let given = Call::new("GET", "/healthz").header("x-request-id", "mine-42").send(&site).await;
    assert_eq!(given.header("x-request-id"), "mine-42");
    let long = Call::new("GET", "/nowhere").header("x-request-id", &"a".repeat(129)).send(&site).await;
    assert_eq!(long.header("x-request-id").len(), 36);
    assert_ne!(site.get("/healthz").await.header("x-request-id"), site.get("/healthz").await.header("x-request-id"));
}
