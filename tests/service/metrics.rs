//! The figures of the service.

use crate::harness::{Call, DECAY, Gate, Site, halving, one_worker};
use dvi::solution::{Failure, Status, ViCounts};
use std::sync::Arc;

/// The value of the one line that begins so.
#[track_caller]
fn value(text: &str, name: &str) -> f64 {
    let lines: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix(name)?.strip_prefix(' ')).collect();
    assert_eq!(lines.len(), 1, "{name} in {text}");
    lines[0].parse().unwrap()
}

#[tokio::test]
async fn solves_are_counted_by_problem_and_ending() {
    let solver: dvi::service::jobs::Solver = Arc::new(|specification, _| {
        let mut solution = halving(Status::Completed);
        solution.diagnostics.steps.accepted = 40;
        solution.diagnostics.vi = Some(ViCounts { solves: 120, ..ViCounts::default() });
        match specification.label() {
            Some("panics") => panic!("on purpose"),
            Some("fails") => {
                let error = Failure { code: "step_too_small".into(), message: String::new(), time: 0.5, state: vec![] };
                dvi::solution::Solution { status: Status::Failed, error: Some(error), ..solution }
            }
            _ => solution,
        }
    });
    let site = Site::new(one_worker(), solver);
    for label in ["runs", "runs", "fails", "panics"] {
        Call::solve(DECAY.replacen('{', &format!("{{\"label\":\"{label}\","), 1)).send(&site).await;
    }
    let metrics = site.get("/metrics").await;
    assert!(metrics.header("content-type").starts_with("application/openmetrics-text"));
    let text = metrics.text();
    for (code, count) in [("completed", 2.0), ("step_too_small", 1.0), ("defect", 1.0)] {
        assert_eq!(value(text, &format!("dvi_solves_total{{problem=\"dvi\",code=\"{code}\"}}")), count);
    }
    assert_eq!(value(text, "dvi_steps_total{problem=\"dvi\"}"), 120.0);
    assert_eq!(value(text, "dvi_vi_solves_total{problem=\"dvi\"}"), 360.0);
    assert_eq!(value(text, "dvi_solve_seconds_count{problem=\"dvi\"}"), 4.0);
    assert_eq!(value(text, "dvi_wait_seconds_count"), 4.0);
    assert_eq!(value(text, "dvi_panics"), 1.0);
    assert_eq!(value(text, "dvi_answers_total{status=\"200\"}"), 3.0);
    assert_eq!(value(text, "dvi_answers_total{status=\"500\"}"), 1.0);
    assert!(text.ends_with("# EOF\n"), "{text}");
}

#[tokio::test]
async fn the_load_is_that_of_the_moment() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    for _ in 0..3 {
        site.accept(1).await;
    }
    gate.entered(1).await;
    let text = site.get("/metrics").await;
    assert_eq!((value(text.text(), "dvi_jobs_running"), value(text.text(), "dvi_jobs_waiting")), (1.0, 2.0));
    gate.let_through(3);
    site.service.jobs().idle().await;
    let text = site.get("/metrics").await;
    assert_eq!((value(text.text(), "dvi_jobs_running"), value(text.text(), "dvi_jobs_waiting")), (0.0, 0.0));
}

#[tokio::test]
async fn the_figures_of_one_service_are_not_those_of_another() {
    let (one, other) =
        (Site::new(one_worker(), crate::harness::instant()), Site::new(one_worker(), crate::harness::instant()));
    Call::solve(DECAY).send(&one).await;
    assert!(!other.get("/metrics").await.text().contains("dvi_solves_total{"));
}

/// A service with a solve behind it, so that every figure has been counted once, and what it tells.
async fn told() -> String {
    let solver: dvi::service::jobs::Solver = Arc::new(|specification, _| {
        let mut solution = halving(Status::Completed);
        solution.diagnostics.vi = Some(ViCounts { solves: 1, ..ViCounts::default() });
        assert!(specification.label().is_none(), "on purpose");
        solution
    });
    let site = Site::new(one_worker(), solver);
    Call::solve(DECAY).send(&site).await;
    // Its worker is lost.
    Call::solve(DECAY.replacen('{', "{\"label\":\"panics\",", 1)).send(&site).await.problem(500, "defect");
    site.get("/metrics").await.text().to_owned()
}

#[tokio::test]
async fn every_figure_is_explained_to_who_runs_the_service() {
    let text = told().await;
    let mut told: Vec<(&str, &str)> =
        text.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split_once(' ')).collect();
    let explained = include_str!("../../deploy/README.md").lines().filter_map(|line| {
        let mut cells = line.strip_prefix("| `dvi_")?.split('|').map(str::trim);
        Some((cells.next()?.strip_suffix('`')?, cells.next()?))
    });
    let mut explained: Vec<(String, &str)> = explained.map(|(name, kind)| (format!("dvi_{name}"), kind)).collect();
    told.sort_unstable();
    explained.sort_unstable();
    assert_eq!(told, explained.iter().map(|(name, kind)| (name.as_str(), *kind)).collect::<Vec<_>>());
}

#[tokio::test]
async fn the_dashboard_asks_for_figures_and_labels_that_there_are() {
    let text = told().await;
    let dashboard = include_str!("../../deploy/grafana.json");
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let names: Vec<&str> = dashboard.split(|c| !is_word(c)).filter(|word| word.starts_with("dvi_")).collect();
    assert!(names.len() > 10, "{names:?}");
    for name in names {
        let is_sample = |line: &str| line.strip_prefix(name).is_some_and(|rest| rest.starts_with(['{', ' ']));
        assert!(text.lines().any(is_sample), "no {name} in {text}");
    }
    for list in dashboard.split(" by (").skip(1).map(|rest| rest.split(')').next().unwrap()) {
        for label in list.split(',').map(str::trim) {
            assert!(text.contains(&format!("{label}=\"")), "no label {label} in {text}");
        }
    }
}
