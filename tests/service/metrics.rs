//! Tests of the metrics of the service.

use crate::harness::{Call, DECAY, Gate, Site, halving, one_worker};
use crate::process::{Folder, Server};
use dvi::solution::{Failure, Status, ViCounts};
use std::sync::Arc;

/// Returns the value on the only line of the metrics that begins with `name`, as a number.
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
        let call = Call::solve(DECAY.replacen('{', &format!("{{\"label\":\"{label}\","), 1));
        call.header("cache-control", "no-cache").send(&site).await;
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
    assert_eq!(value(text, "dvi_panics_total"), 1.0);
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
    site.idle().await;
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

/// Returns the metrics of a service after a few solves, so that every metric has been counted at least once.
async fn told() -> String {
    let solver: dvi::service::jobs::Solver = Arc::new(|specification, _| {
        let mut solution = halving(Status::Completed);
        solution.diagnostics.vi = Some(ViCounts { solves: 1, ..ViCounts::default() });
        assert!(specification.label().is_none(), "on purpose");
        solution
    });
    let site = Site::new(one_worker(), solver);
    Call::solve(DECAY).send(&site).await;
    // The solver panics in this solve, so that its worker is lost.
    Call::solve(DECAY.replacen('{', "{\"label\":\"panics\",", 1)).send(&site).await.problem(500, "defect");
    site.get("/metrics").await.text().to_owned()
}

#[tokio::test]
async fn every_figure_is_explained_to_who_runs_the_service() {
    let text = told().await;
    let mut told: Vec<(&str, &str)> =
        text.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split_once(' ')).collect();
    let explained = include_str!("../../deploy/README.md").lines().filter_map(|line| {
        let is_figure = line.starts_with("| `dvi_") || line.starts_with("| `process_");
        let mut cells = line.strip_prefix("| `").filter(|_| is_figure)?.split('|').map(str::trim);
        Some((cells.next()?.strip_suffix('`')?, cells.next()?))
    });
    let mut explained: Vec<(&str, &str)> = explained.collect();
    told.sort_unstable();
    explained.sort_unstable();
    assert_eq!(told, explained);
}

#[tokio::test]
async fn the_dashboard_and_the_alerts_ask_for_figures_and_labels_that_there_are() {
    let text = told().await;
    for asking in [include_str!("../../deploy/grafana.json"), include_str!("../../deploy/alerts.yaml")] {
        assert_asks_for_what_there_is(asking, &text);
    }
}

#[tokio::test]
async fn every_figure_has_a_panel() {
    let (text, dashboard) = (told().await, include_str!("../../deploy/grafana.json"));
    for figure in text.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split(' ').next()) {
        assert!(dashboard.contains(figure), "no panel shows {figure}");
    }
}

fn assert_asks_for_what_there_is(dashboard: &str, text: &str) {
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let names: Vec<&str> = dashboard
        .split(|c| !is_word(c))
        .filter(|word| word.starts_with("dvi_") || word.starts_with("process_"))
        .collect();
    assert!(names.len() > 8, "{names:?}");
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

#[tokio::test]
async fn requests_are_timed_by_route_and_refusals_counted_by_reason() {
    let site = Site::new(one_worker(), crate::harness::instant());
    let path = site.accept(1).await;
    site.ended(&path).await;
    site.get("/jobs/00000000-0000-7000-8000-000000000000").await.problem(404, "no-such-job");
    site.get("/nowhere/at/all").await.problem(404, "not-found");
    let text = site.get("/metrics").await.text().to_owned();
    assert_eq!(value(&text, "dvi_request_seconds_count{method=\"POST\",route=\"/solve\"}"), 1.0);
    assert_eq!(value(&text, "dvi_request_seconds_count{method=\"GET\",route=\"/jobs/{id}\"}"), 2.0);
    assert_eq!(value(&text, "dvi_request_seconds_count{method=\"GET\",route=\"none\"}"), 1.0);
    assert_eq!(value(&text, "dvi_refusals_total{reason=\"no-such-job\"}"), 1.0);
    assert_eq!(value(&text, "dvi_jobs_kept"), 1.0);
    assert!(value(&text, "dvi_kept_bytes") > DECAY.len() as f64);
    assert_eq!(value(&text, "dvi_store_writable"), 1.0);
    assert!(text.contains(&format!("dvi_build_info{{version=\"{}\"}} 1", env!("CARGO_PKG_VERSION"))), "{text}");
}

#[test]
fn durable_writes_are_timed() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1"]);
    let count = || value(&server.get("/metrics").body, "dvi_store_write_seconds_count");
    let before = count();
    for _ in 0..3 {
        server.reaches(&server.accept(DECAY), &["successful"]);
    }
    // Each job was written to the disk before the service confirmed its admission, and the metrics count these
    // writes.
    assert!(count() >= before + 3.0, "{before} and {}", count());
    assert!(value(&server.get("/metrics").body, "dvi_store_write_seconds_sum") > 0.0);
}

#[tokio::test]
async fn the_process_is_measured_as_the_kernel_measures_it() {
    let site = Site::new(one_worker(), crate::harness::instant());
    let text = site.get("/metrics").await.text().to_owned();
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    let resident = line.trim_end_matches("kB").trim().parse::<f64>().unwrap() * 1024.0;
    let told = value(&text, "process_resident_memory_bytes");
    assert!((0.5..2.0).contains(&(told / resident)), "{told} where the kernel says {resident}");
    assert!(value(&text, "process_open_fds") >= 3.0 && value(&text, "process_max_fds") >= 64.0);
    assert!(value(&text, "process_cpu_seconds_total") >= 0.0);
}
