//! Metrics of the service for Prometheus: counts and durations of solves, their endings, and responses.
//!
//! Durations of solves are measured by the supervisors of the worker processes. Values that change by themselves,
//! such as the length of the queue, are read when the metrics are requested.

use super::jobs::Jobs;
use super::log::Log;
use super::process::Process;
use super::worker::{Event, Solved};
use axum::http::{Method, StatusCode};
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::metrics::info::Info;
use prometheus_client::registry::{Registry, Unit};
use solution::Status;
use std::borrow::Cow;
use std::sync::OnceLock;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

/// The name and the value of a metric's label.
type Label = (&'static str, Cow<'static, str>);

/// All metrics of the service, and the registry that encodes them.
#[derive(Debug)]
pub struct Metrics {
    registry: Registry,
    solve_seconds: Family<[Label; 1], Histogram, fn() -> Histogram>,
    wait_seconds: Histogram,
    ended: Family<[Label; 2], Counter>,
    steps: Family<[Label; 1], Counter>,
    vi_solves: Family<[Label; 1], Counter>,
    answers: Family<[Label; 1], Counter>,
    request_seconds: Family<[Label; 2], Histogram, fn() -> Histogram>,
    refusals: Family<[Label; 1], Counter>,
    lost: Family<[Label; 1], Counter>,
    workers: Gauge,
    busy: Gauge,
    waiting: Gauge,
    waiting_bytes: Gauge,
    running: Gauge,
    connections: Gauge,
    panics: Counter,
    store_seconds: Histogram,
    unreadable: Gauge,
    damaged: Gauge,
    writable: Gauge,
    unsaved: Gauge,
    rebuilds: Counter,
    repeated: Counter,
    yielded: Counter,
    long: Gauge,
    orphaned: Gauge,
    kept: Gauge,
    kept_bytes: Gauge,
    lost_lines: Counter,
    log: OnceLock<Log>,
    process: Process,
}

/// Returns a histogram of durations, with buckets from a tenth of a millisecond to seven minutes, each twice the
/// previous.
fn durations() -> Histogram {
    Histogram::new(exponential_buckets(1e-4, 2.0, 23))
}

impl Default for Metrics {
    fn default() -> Self {
        let mut metrics = Self {
            registry: Registry::default(),
            solve_seconds: Family::new_with_constructor(durations),
            wait_seconds: durations(),
            ended: Family::default(),
            steps: Family::default(),
            vi_solves: Family::default(),
            answers: Family::default(),
            request_seconds: Family::new_with_constructor(durations),
            refusals: Family::default(),
            lost: Family::default(),
            workers: Gauge::default(),
            busy: Gauge::default(),
            waiting: Gauge::default(),
            waiting_bytes: Gauge::default(),
            running: Gauge::default(),
            connections: Gauge::default(),
            panics: Counter::default(),
            store_seconds: durations(),
            unreadable: Gauge::default(),
            damaged: Gauge::default(),
            writable: Gauge::default(),
            unsaved: Gauge::default(),
            rebuilds: Counter::default(),
            repeated: Counter::default(),
            yielded: Counter::default(),
            long: Gauge::default(),
            orphaned: Gauge::default(),
            kept: Gauge::default(),
            kept_bytes: Gauge::default(),
            lost_lines: Counter::default(),
            log: OnceLock::new(),
            process: Process::default(),
        };
        metrics.process.register(&mut metrics.registry);
        let registry = metrics.registry.sub_registry_with_prefix("dvi");
        registry.register_with_unit(
            "solve",
            "Duration of solves, by problem type",
            Unit::Seconds,
            metrics.solve_seconds.clone(),
        );
        registry.register_with_unit(
            "wait",
            "Waiting time in the queue of jobs that have started",
            Unit::Seconds,
            metrics.wait_seconds.clone(),
        );
        registry.register("solves", "Solves, by problem type and ending", metrics.ended.clone());
        registry.register(
            "answers_repeated",
            "Solves answered with the stored result of the same specification",
            metrics.repeated.clone(),
        );
        registry.register("steps", "Accepted steps, by problem type", metrics.steps.clone());
        registry.register("vi_solves", "Variational inequalities solved at stages", metrics.vi_solves.clone());
        registry.register("answers", "Responses, by status", metrics.answers.clone());
        registry.register_with_unit(
            "request",
            "Time from a request to the start of its response, by route and method",
            Unit::Seconds,
            metrics.request_seconds.clone(),
        );
        registry.register("refusals", "Refused requests, by problem", metrics.refusals.clone());
        registry.register(
            "jobs_waiting",
            "Jobs in the queue, and chunks of sweeps that machines share",
            metrics.waiting.clone(),
        );
        registry.register_with_unit(
            "waiting",
            "Size of the specifications of the jobs in the queue",
            Unit::Bytes,
            metrics.waiting_bytes.clone(),
        );
        registry.register("jobs_running", "Jobs that run on workers", metrics.running.clone());
        registry.register("jobs_long", "Running jobs that need not yield to others", metrics.long.clone());
        registry.register(
            "jobs_yielded",
            "Jobs that yielded to others after their first slice, to start again",
            metrics.yielded.clone(),
        );
        registry.register("workers", "Worker processes", metrics.workers.clone());
        registry.register("workers_busy", "Worker processes that are solving or checking", metrics.busy.clone());
        registry.register("workers_lost", "Replaced workers, by reason", metrics.lost.clone());
        registry.register("connections", "Open connections", metrics.connections.clone());
        registry.register(
            "unreadable_jobs",
            "Jobs on the disk that could not be read at the start",
            metrics.unreadable.clone(),
        );
        registry.register("damaged_jobs", "Jobs whose bytes on the disk are damaged", metrics.damaged.clone());
        registry.register(
            "store_writable",
            "1 if the store can be written or is in memory, otherwise 0",
            metrics.writable.clone(),
        );
        registry.register(
            "unsaved_results",
            "Ended jobs kept in memory until they can be written to the disk",
            metrics.unsaved.clone(),
        );
        registry.register_with_unit(
            "store_write",
            "Duration of the durable writes of the store, each of a group of changes",
            Unit::Seconds,
            metrics.store_seconds.clone(),
        );
        registry.register("store_rebuilds", "Rebuilds of a damaged database since the start", metrics.rebuilds.clone());
        registry.register(
            "orphaned_results",
            "Results without a job that were set aside at the start",
            metrics.orphaned.clone(),
        );
        registry.register("panics", "Solves that failed with a defect since the start", metrics.panics.clone());
        registry.register("jobs_kept", "Ended jobs that are kept", metrics.kept.clone());
        registry.register_with_unit(
            "kept",
            "Size of the specifications and results of ended jobs that are kept",
            Unit::Bytes,
            metrics.kept_bytes.clone(),
        );
        registry.register(
            "log_lines_lost",
            "Log lines lost because they were not read fast enough",
            metrics.lost_lines.clone(),
        );
        let version = [("version", env!("CARGO_PKG_VERSION"))];
        registry.register("build", "The version of the program", Info::new(version));
        metrics
    }
}

impl Metrics {
    /// Counts a solve that returned after `time`, with its number of steps and the way in which it ended.
    pub fn solved(&self, solved: &Solved, time: Duration) {
        let code = match (&solved.failed, solved.status) {
            (_, Status::Completed) => "completed".into(),
            (Some(failed), _) => failed.code.clone().into(),
            (None, Status::Stopped) => "stopped".into(),
            (None, Status::Failed) => "failed".into(),
        };
        let label = [("problem", solved.problem.clone())];
        self.steps.get_or_create(&label).inc_by(solved.steps);
        if let Some(vi_solves) = solved.vi_solves {
            self.vi_solves.get_or_create(&label).inc_by(vi_solves);
        }
        self.ended(solved.problem.clone(), code, time);
    }

    /// Counts a request that was answered with the stored solution of an earlier request.
    pub fn repeated(&self) {
        self.repeated.inc();
    }

    /// Counts a job that has yielded its worker to others and goes back to the queue.
    pub fn yielded(&self) {
        self.yielded.inc();
    }

    /// Counts a job whose solve ended after `time`, by problem type, with the code of its ending.
    pub fn ended(&self, problem: Cow<'static, str>, code: Cow<'static, str>, time: Duration) {
        self.ended.get_or_create(&[("problem", problem.clone()), ("code", code)]).inc();
        self.solve_seconds.get_or_create(&[("problem", problem)]).observe(time.as_secs_f64());
    }

    /// Counts and logs an event of a worker process, such as its start or death.
    pub fn notice(&self, event: Event<'_>) {
        match event {
            Event::Started(pid, _) => {
                self.workers.inc();
                tracing::debug!(pid, "worker {pid} has started");
            }
            Event::Grown(bytes) => {
                self.lost("grown");
                tracing::debug!(bytes, "a worker that held {} MiB is replaced", bytes >> 20);
            }
            Event::Lowered(pid) => {
                self.lost("lowered");
                tracing::debug!(pid, "worker {pid} is replaced after a long task");
            }
            Event::Unwanted(pid) => {
                self.lost("unwanted");
                tracing::debug!(pid, "worker {pid} is replaced because it did not stop a cancelled task");
            }
            Event::Died(pid, death) => {
                self.lost(death.code());
                tracing::error!(pid, ?death, "worker {pid} died: {}", death.code());
            }
            Event::NotStarted(error) => tracing::error!(%error, "no worker could be started"),
        }
    }

    fn lost(&self, reason: &'static str) {
        self.workers.dec();
        self.lost.get_or_create(&[("reason", reason.into())]).inc();
    }

    /// Counts the time that a job waited in the queue before it started.
    pub fn waited(&self, time: Duration) {
        self.wait_seconds.observe(time.as_secs_f64());
    }

    /// Records the numbers of jobs and results that were found unreadable, damaged or orphaned when the store was
    /// opened.
    pub fn found(&self, unreadable: usize, damaged: usize, orphaned: usize) {
        self.damaged.set(i64::try_from(damaged).unwrap_or(i64::MAX));
        self.unreadable.set(i64::try_from(unreadable).unwrap_or(i64::MAX));
        self.orphaned.set(i64::try_from(orphaned).unwrap_or(i64::MAX));
    }

    /// Counts a job whose stored bytes were found damaged.
    pub fn found_damaged(&self) {
        self.damaged.inc();
    }

    /// Returns the histogram of the durations of durable writes, for the thread that writes the job store.
    pub fn store_seconds(&self) -> Histogram {
        self.store_seconds.clone()
    }

    /// Sets the log whose number of lost lines the metrics report.
    pub fn count_lost_lines(&self, log: &Log) {
        // `set` fails if the log is set already, which is harmless: there is one log per process.
        let _ = self.log.set(log.clone());
    }

    /// Counts a response to a request of `route`, begun after `time`, and its problem code if it is an error
    /// response.
    pub fn answered(
        &self,
        method: &Method,
        route: &str,
        status: StatusCode,
        refusal: Option<&'static str>,
        time: Duration,
    ) {
        self.answers.get_or_create(&[("status", status.as_str().to_owned().into())]).inc();
        // HTTP methods invented by clients must not become values of the label `method`, whose values would then be
        // unbounded in number.
        let known = [Method::GET, Method::HEAD, Method::POST, Method::DELETE, Method::OPTIONS];
        let method = known.iter().find(|known| *known == method).map_or("other", Method::as_str).to_owned();
        let label = [("method", method.into()), ("route", route.to_owned().into())];
        self.request_seconds.get_or_create(&label).observe(time.as_secs_f64());
        if let Some(reason) = refusal {
            self.refusals.get_or_create(&[("reason", reason.into())]).inc();
        }
    }

    /// Returns all metrics as `OpenMetrics` text, with the current numbers of open connections and running checks.
    pub fn text(&self, jobs: &Jobs, connections: usize, checks: usize) -> String {
        let (waiting, running) = jobs.load();
        let (kept, kept_bytes) = jobs.kept();
        self.kept.set(i64::try_from(kept).unwrap_or(i64::MAX));
        self.kept_bytes.set(i64::try_from(kept_bytes).unwrap_or(i64::MAX));
        self.busy.set(i64::try_from(running + checks).unwrap_or(i64::MAX));
        self.process.look();
        // Counts of jobs saturate at `i64::MAX`, which no queue reaches.
        self.waiting.set(i64::try_from(waiting).unwrap_or(i64::MAX));
        self.waiting_bytes.set(i64::try_from(jobs.waiting_bytes()).unwrap_or(i64::MAX));
        self.long.set(i64::try_from(jobs.long()).unwrap_or(i64::MAX));
        self.running.set(i64::try_from(running).unwrap_or(i64::MAX));
        self.connections.set(i64::try_from(connections).unwrap_or(i64::MAX));
        self.writable.set(i64::from(jobs.is_writable()));
        self.unsaved.set(i64::try_from(jobs.unsaved()).unwrap_or(i64::MAX));
        self.rebuilds.inner().fetch_max(jobs.rebuilds(), Relaxed);
        self.panics.inner().fetch_max(jobs.panics(), Relaxed);
        self.lost_lines.inner().fetch_max(self.log.get().map_or(0, Log::lost), Relaxed);
        let mut text = String::new();
        // Encoding the metrics into a string cannot fail.
        let _ = encode(&mut text, &self.registry);
        text
    }
}
