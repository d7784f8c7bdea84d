//! Inline solves: small problems are solved in the front process, without a worker, if no job waits.

use crate::harness::{Call, DECAY, Gate, Site, halving, one_worker};
use axum::http::StatusCode;
use dvi::problem::Control;
use dvi::service::jobs::Solver;
use dvi::solution::Status;
use dvi::specification::Specification;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Returns a solver that is blocked until `gate` lets it through, except for specifications with the label `light`,
/// which it solves at once.
fn light_or_held(gate: &Arc<Gate>) -> Solver {
    let held = gate.solver();
    Arc::new(move |specification, control| match specification.label() {
        Some("light") => halving(Status::Completed),
        _ => held(specification, control),
    })
}

fn light() -> Call {
    Call::solve(DECAY.replacen('{', "{\"label\":\"light\",", 1))
}

#[tokio::test]
async fn a_small_solve_is_answered_though_every_worker_is_busy() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), light_or_held(&gate));
    site.accept(1).await;
    gate.entered(1).await;
    let reply = light().send(&site).await;
    assert_eq!(reply.status, StatusCode::OK, "{reply:?}");
    let job = reply.header("link").trim_start_matches('<').split('>').next().unwrap();
    let status = Call::new("GET", job).send(&site).await.json();
    assert_eq!(
        (&status["status"], &status["progress"], &status["label"]),
        (&"successful".into(), &100.into(), &"light".into())
    );
    assert!(status["created"].as_str() <= status["finished"].as_str(), "{status}");
    let results = Call::new("GET", &format!("{job}/results")).send(&site).await;
    assert_eq!(results.body, reply.body);
    gate.let_through(1);
}

#[tokio::test]
async fn a_small_solve_does_not_pass_jobs_that_wait() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), light_or_held(&gate));
    site.accept(1).await;
    gate.entered(1).await;
    site.accept(2).await;
    let reply = light().header("prefer", "wait=1").send(&site).await;
    assert_eq!((reply.status, &reply.json()["queue_position"]), (StatusCode::ACCEPTED, &1.into()));
    gate.let_through(2);
}

/// Tests that the deadline of an inline solve also interrupts the checks after a run that has reached its end: a
/// result without complete checks is neither returned nor stored for the next request.
#[tokio::test]
async fn a_solve_whose_checks_are_cut_short_is_left_to_a_worker() {
    let by_worker = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&by_worker);
    let solver: Solver = Arc::new(move |_, control| {
        if control.deadline().is_some_and(|deadline| deadline < Instant::now() + Duration::from_millis(10)) {
            while control.poll().is_none() {}
        } else {
            counted.fetch_add(1, Relaxed);
        }
        halving(Status::Completed)
    });
    let site = Site::new(one_worker(), solver);
    for k in 1..=2 {
        let reply = light().client(1).send(&site).await;
        assert_eq!((reply.status, reply.headers.get("dvi-repeated")), (StatusCode::OK, None), "{reply:?}");
        assert_eq!(by_worker.load(Relaxed), k);
    }
}

#[tokio::test]
async fn the_same_text_of_the_same_client_is_answered_with_the_same_bytes_unless_a_solve_is_asked_for() {
    let solves = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&solves);
    let solver: Solver = Arc::new(move |_, _| {
        counted.fetch_add(1, Relaxed);
        halving(Status::Completed)
    });
    let site = Site::new(one_worker(), solver);
    let first = light().client(1).send(&site).await;
    let again = light().client(1).send(&site).await;
    assert_eq!((first.headers.get("dvi-repeated"), again.header("dvi-repeated")), (None, "true"));
    assert_eq!((&again.body, again.header("dvi-trusted")), (&first.body, first.header("dvi-trusted")));
    assert_eq!(solves.load(Relaxed), 1);
    // Each of the two responses belongs to a job of its own.
    assert_ne!(first.header("link"), again.header("link"));
    let job = again.header("link").trim_start_matches('<').split('>').next().unwrap().to_owned();
    let state = Call::new("GET", &job).client(1).send(&site).await.json();
    assert_eq!(
        (&state["status"], &state["progress"], &state["trusted"]),
        (&"successful".into(), &100.into(), &true.into())
    );
    // Another client does not get the stored solution, and `no-cache` makes the service solve anew.
    let other = light().client(2).send(&site).await;
    let anew = light().client(1).header("cache-control", "max-age=0, no-cache").send(&site).await;
    for reply in [&other, &anew] {
        assert_eq!((reply.headers.get("dvi-repeated"), &reply.body), (None, &first.body));
    }
    let csv = light().client(1).header("accept", "text/csv").send(&site).await;
    assert_eq!((csv.header("dvi-repeated"), csv.text().lines().next()), ("true", Some("t,x")));
    assert_eq!(solves.load(Relaxed), 3);
    let figures = site.get("/metrics").await;
    assert!(figures.text().contains("dvi_answers_repeated_total 2\n"), "{}", figures.text());
}

#[tokio::test]
async fn answers_to_other_numbers_are_those_of_a_specification_that_is_read_anew() {
    let site = Site::new(one_worker(), Arc::new(dvi::solve));
    let belt = |m: f64, f: f64| {
        format!(
            r#"{{"problem": {{"dvi": {{"parameters": {{"m": {m}, "f": {f}, "k": "2*m"}},
                "states": {{"x": {{"initial": "m", "rate": "v"}}, "v": {{"initial": 0, "rate": "(-k*x - F)/m"}}}},
                "variables": {{"F": {{"inequality": "-(v - 0.5)"}}}},
                "set": [{{"box": {{"of": ["F"], "lower": "-f", "upper": "f"}}}}]}}}}, "time": {{"end": 3}}}}"#
        )
    };
    for (m, f) in [(1.0, 1.0), (1.5, 1.0), (1.5, 1.0), (0.25, 3.0), (4.0, 0.1)] {
        let text = belt(m, f);
        let specification = Specification::from_json(text.as_bytes()).unwrap();
        let anew = serde_json::to_value(dvi::solve(&specification, &Control::new())).unwrap();
        let found = Call::solve(text).send(&site).await.json();
        for part in ["status", "verdict", "trajectory"] {
            assert_eq!(found[part], anew[part], "{part} of {m}, {f}");
        }
    }
    // Errors in new parameter values are reported as for a specification that is read for the first time.
    let problem = Call::solve(belt(0.0, 1.0)).send(&site).await.problem(400, "invalid-specification");
    assert!(problem["errors"].as_array().is_some_and(|errors| !errors.is_empty()), "{problem}");
}
