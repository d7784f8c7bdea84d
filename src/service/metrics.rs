//! Figures of a service for Prometheus: what was solved, how long it took, how it ended, what was answered.
//!
//! A solve is measured where it is called, on the worker's thread. What changes by itself, such as the length of the
//! queue, is looked up when the figures are asked for.

use super::jobs::Jobs;
use axum::http::StatusCode;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::{Registry, Unit};
use solution::{Solution, Status};
use std::borrow::Cow;
use std::thread::panicking;
use std::time::{Duration, Instant};

/// A label and its value.
type Label = (&'static str, Cow<'static, str>);

/// The figures.
#[derive(Debug)]
pub struct Metrics {
    registry: Registry,
    solve_seconds: Family<[Label; 1], Histogram, fn() -> Histogram>,
    wait_seconds: Histogram,
    ended: Family<[Label; 2], Counter>,
    steps: Family<[Label; 1], Counter>,
    vi_solves: Family<[Label; 1], Counter>,
    answers: Family<[Label; 1], Counter>,
    waiting: Gauge,
    waiting_bytes: Gauge,
    running: Gauge,
    connections: Gauge,
    panics: Gauge,
    unreadable: Gauge,
    orphaned: Gauge,
}

/// From a tenth of a millisecond to seven minutes, each twice the one before.
fn durations() -> Histogram {
    Histogram::new(exponential_buckets(1e-4, 2.0, 23))
}

impl Default for Metrics {
    fn default() -> Self {
        let mut metrics = Self {
            registry: Registry::with_prefix("dvi"),
            solve_seconds: Family::new_with_constructor(durations),
            wait_seconds: durations(),
            ended: Family::default(),
            steps: Family::default(),
            vi_solves: Family::default(),
            answers: Family::default(),
            waiting: Gauge::default(),
            waiting_bytes: Gauge::default(),
            running: Gauge::default(),
            connections: Gauge::default(),
            panics: Gauge::default(),
            unreadable: Gauge::default(),
            orphaned: Gauge::default(),
        };
        let registry = &mut metrics.registry;
        registry.register_with_unit(
            "solve",
            "Time of solves, by the type of the problem",
            Unit::Seconds,
            metrics.solve_seconds.clone(),
        );
        registry.register_with_unit(
            "wait",
            "Time of jobs in the queue, of those that were taken up",
            Unit::Seconds,
            metrics.wait_seconds.clone(),
        );
        registry.register("solves", "Solves by the type of the problem and how they ended", metrics.ended.clone());
        registry.register("steps", "Accepted steps, by the type of the problem", metrics.steps.clone());
        registry.register("vi_solves", "Variational inequalities solved at stages", metrics.vi_solves.clone());
        registry.register("answers", "Answers by their status", metrics.answers.clone());
        registry.register("jobs_waiting", "Jobs in the queue", metrics.waiting.clone());
        registry.register_with_unit(
            "waiting",
            "Specifications of the jobs in the queue",
            Unit::Bytes,
            metrics.waiting_bytes.clone(),
        );
        registry.register("jobs_running", "Jobs that workers have in hand", metrics.running.clone());
        registry.register("connections", "Connections that are open", metrics.connections.clone());
        registry.register(
            "unreadable_jobs",
            "Jobs on the disk that the start could not read",
            metrics.unreadable.clone(),
        );
        registry.register("orphaned_results", "Results that the start set aside", metrics.orphaned.clone());
        registry.register("panics", "Solves that broke down since the start", metrics.panics.clone());
        metrics
    }
}

impl Metrics {
    /// Runs a solve and measures it; one that panics counts as well.
    pub fn measure(&self, problem: &'static str, solve: impl FnOnce() -> Solution) -> Solution {
        let in_hand = InHand { metrics: self, problem, start: Instant::now() };
        let solution = solve();
        self.solved(problem, in_hand.start.elapsed(), &solution);
        solution
    }

    /// Counts a solve that took this time.
    pub fn solved(&self, problem: &'static str, time: Duration, solution: &Solution) {
        let code = match (&solution.error, solution.status) {
            (_, Status::Completed) => "completed".into(),
            (Some(error), _) => error.code.clone(),
            (None, Status::Stopped) => "stopped".into(),
            (None, Status::Failed) => "failed".into(),
        };
        let label = [("problem", problem.into())];
        self.steps.get_or_create(&label).inc_by(solution.diagnostics.steps.accepted);
        if let Some(vi) = &solution.diagnostics.vi {
            self.vi_solves.get_or_create(&label).inc_by(vi.solves);
        }
        self.ended(problem, code, time);
    }

    fn ended(&self, problem: &'static str, code: Cow<'static, str>, time: Duration) {
        self.ended.get_or_create(&[("problem", problem.into()), ("code", code)]).inc();
        self.solve_seconds.get_or_create(&[("problem", problem.into())]).observe(time.as_secs_f64());
    }

    /// Counts the time that a job has waited for its worker.
    pub fn waited(&self, time: Duration) {
        self.wait_seconds.observe(time.as_secs_f64());
    }

    /// Notes what the start found on the disk.
    pub fn found(&self, unreadable: usize, orphaned: usize) {
        self.unreadable.set(i64::try_from(unreadable).unwrap_or(i64::MAX));
        self.orphaned.set(i64::try_from(orphaned).unwrap_or(i64::MAX));
    }

    /// Counts an answer.
    pub fn answered(&self, status: StatusCode) {
        self.answers.get_or_create(&[("status", status.as_str().to_owned().into())]).inc();
    }

    /// All figures as `OpenMetrics` text, with so many connections open.
    pub fn text(&self, jobs: &Jobs, connections: usize) -> String {
        let (waiting, running) = jobs.load();
        // No queue is longer than the greatest of these.
        self.waiting.set(i64::try_from(waiting).unwrap_or(i64::MAX));
        self.waiting_bytes.set(i64::try_from(jobs.waiting_bytes()).unwrap_or(i64::MAX));
        self.running.set(i64::try_from(running).unwrap_or(i64::MAX));
        self.connections.set(i64::try_from(connections).unwrap_or(i64::MAX));
        self.panics.set(i64::try_from(jobs.panics()).unwrap_or(i64::MAX));
        let mut text = String::new();
        // Writing to a string does not fail.
        let _ = encode(&mut text, &self.registry);
        text
    }
}

/// A solve in hand; where it panics, dropping it says so.
struct InHand<'a> {
    metrics: &'a Metrics,
    problem: &'static str,
    start: Instant,
}

impl Drop for InHand<'_> {
    fn drop(&mut self) {
        if panicking() {
            self.metrics.ended(self.problem, "panicked".into(), self.start.elapsed());
        }
    }
}
