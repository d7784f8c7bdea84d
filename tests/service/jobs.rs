//! The states of a job, from admission to deletion.

use crate::harness::{Call, DECAY, Gate, Site, count, halving, instant, one_worker};
use crate::nats::on_both;
use axum::http::StatusCode;
use dvi::problem::Control;
use dvi::service::Options;
use dvi::solution::Status;
use dvi::specification::Specification;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

on_both! {
    the_status_follows_the_job,
    results_that_are_not_ready_say_when_to_ask_again,
    a_waiting_job_that_is_cancelled_never_runs,
    a_running_job_that_is_cancelled_keeps_its_trajectory_so_far,
    cancelling_an_ended_job_changes_nothing,
    a_deleted_job_is_stopped_and_forgotten,
    the_oldest_ending_is_forgotten_first,
    results_are_forgotten_by_their_size_but_never_the_latest,
    a_result_over_the_bound_is_not_kept,
}

async fn cancel(site: &Site, path: &str) -> serde_json::Value {
    let reply = Call::new("POST", &format!("{path}/cancel")).send(site).await;
    assert_eq!(reply.status, StatusCode::OK);
    reply.json()
}

async fn the_status_follows_the_job() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let (first, second) = (site.accept(1).await, site.accept(1).await);
    gate.entered(1).await;
    site.reported(&first).await;
    let running = site.get(&first).await;
    assert_eq!(running.header("cache-control"), "no-store");
    let running = running.json();
    assert_eq!(
        (&running["status"], &running["progress"], &running["steps"]),
        (&"running".into(), &50.into(), &7.into())
    );
    assert_eq!(running["time"], 0.5);
    assert!(running["started"].is_string() && running.get("finished").is_none(), "{running}");
    let waiting = site.get(&second).await.json();
    assert_eq!((&waiting["status"], &waiting["queue_position"]), (&"accepted".into(), &0.into()));
    gate.let_through(2);
    let ended = site.ended(&second).await;
    assert_eq!((&ended["status"], &ended["progress"]), (&"successful".into(), &100.into()));
    let date = |name: &str| ended[name].as_str().unwrap().parse::<jiff::Timestamp>().unwrap();
    assert!(date("created") <= date("started") && date("started") <= date("finished"));
    assert!(ended["links"].as_array().unwrap().iter().any(|link| link["href"] == format!("{second}/results")));
}

async fn results_that_are_not_ready_say_when_to_ask_again() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let path = site.accept(1).await;
    let reply = site.get(&format!("{path}/results")).await;
    let problem = reply.problem(404, "results-not-ready");
    assert_eq!(problem["instance"], path);
    assert!(reply.header("retry-after").parse::<u64>().unwrap() >= 1);
    gate.let_through(1);
    site.ended(&path).await;
    assert_eq!(site.get(&format!("{path}/results")).await.status, StatusCode::OK);
}

async fn a_waiting_job_that_is_cancelled_never_runs() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let (first, second, third) = (site.accept(1).await, site.accept(1).await, site.accept(1).await);
    gate.entered(1).await;
    assert_eq!(cancel(&site, &second).await["status"], "dismissed");
    assert_eq!(cancel(&site, &second).await["status"], "dismissed");
    site.get(&format!("{second}/results")).await.problem(410, "dismissed");
    assert_eq!(site.get(&third).await.json()["queue_position"], 0);
    gate.let_through(2);
    assert_eq!(site.ended(&first).await["status"], "successful");
    assert_eq!(site.ended(&third).await["status"], "successful");
    assert!(site.get(&second).await.json().get("started").is_none());
}

async fn a_running_job_that_is_cancelled_keeps_its_trajectory_so_far() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let path = site.accept(1).await;
    gate.entered(1).await;
    cancel(&site, &path).await;
    cancel(&site, &path).await;
    let ended = site.ended(&path).await;
    assert_eq!((&ended["status"], &ended["progress"]), (&"dismissed".into(), &50.into()));
    let results = site.get(&format!("{path}/results")).await.json();
    assert_eq!((&results["status"], &results["trajectory"]["t"][1]), (&"stopped".into(), &1.0.into()));
}

async fn cancelling_an_ended_job_changes_nothing() {
    let site = Site::new(one_worker(), instant());
    let path = site.accept(1).await;
    let ended = site.ended(&path).await;
    assert_eq!(cancel(&site, &path).await, ended);
}

async fn a_deleted_job_is_stopped_and_forgotten() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let (running, waiting) = (site.accept(1).await, site.accept(1).await);
    gate.entered(1).await;
    for path in [&waiting, &running] {
        let deleted = Call::new("DELETE", path).send(&site).await;
        assert_eq!((deleted.status, deleted.body.len()), (StatusCode::NO_CONTENT, 0));
        site.get(path).await.problem(404, "no-such-job");
        Call::new("DELETE", path).send(&site).await.problem(404, "no-such-job");
    }
    gate.cancelled(1).await;
    let next = site.accept(1).await;
    gate.let_through(1);
    assert_eq!(site.ended(&next).await["status"], "successful");
}

#[tokio::test]
async fn a_panic_fails_its_job_and_the_worker_lives_on() {
    // The solver panics in its first two calls: in the inline solve and in the worker.
    let calls = AtomicUsize::new(0);
    let solver = move |_: &Specification, _: &Control| {
        assert!(calls.fetch_add(1, Ordering::SeqCst) > 1, "on purpose");
        halving(Status::Completed)
    };
    let site = Site::new(one_worker(), Arc::new(solver));
    let path = site.accept(1).await;
    let ended = site.ended(&path).await;
    assert_eq!(ended["status"], "failed");
    assert!(ended["message"].as_str().unwrap().starts_with("defect"), "{ended}");
    let problem = site.get(&format!("{path}/results")).await.problem(500, "defect");
    assert_eq!(problem["instance"], path);
    assert!(!problem.to_string().contains("on purpose"), "the inside of the service is not shown: {problem}");
    assert_eq!(site.service.jobs().panics(), 1);
    assert_eq!(Call::solve(DECAY).send(&site).await.status, StatusCode::OK);
}

async fn the_oldest_ending_is_forgotten_first() {
    let site = Site::new(Options { kept_jobs: count(2), ..one_worker() }, instant());
    let mut paths = Vec::new();
    for _ in 0..3 {
        let path = site.accept(1).await;
        site.ended(&path).await;
        paths.push(path);
    }
    site.get(&paths[0]).await.problem(404, "no-such-job");
    assert_eq!(site.get(&paths[1]).await.status, StatusCode::OK);
    assert_eq!(site.get(&paths[2]).await.status, StatusCode::OK);
}

async fn results_are_forgotten_by_their_size_but_never_the_latest() {
    let site = Site::new(Options { kept_mib: count(1), ..one_worker() }, long(30_000));
    let first = site.accept(1).await;
    site.ended(&first).await;
    let second = site.accept(1).await;
    site.ended(&second).await;
    site.get(&first).await.problem(404, "no-such-job");
    assert_eq!(site.get(&format!("{second}/results")).await.status, StatusCode::OK);
}

async fn a_result_over_the_bound_is_not_kept() {
    let site = Site::new(Options { result_mib: count(1), ..one_worker() }, long(100_000));
    let reply = Call::solve(DECAY).send(&site).await;
    assert!(reply.problem(422, "result-too-large")["detail"].as_str().unwrap().contains("fewer output times"));
}

/// Returns a solver whose solution has `n` output times and `n` values, of about 20 bytes of JSON each.
fn long(n: usize) -> dvi::service::jobs::Solver {
    Arc::new(move |_, _| {
        let mut solution = halving(Status::Completed);
        solution.trajectory.t = (0..n).map(|k| k as f64 / 3.0).collect();
        solution.trajectory.fields[0].values = solution.trajectory.t.clone();
        solution
    })
}
