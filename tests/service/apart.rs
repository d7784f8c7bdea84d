//! Workers as separate processes with a solver that the test controls: child processes of this test program, which
//! talk to the front process of the service as `dvi worker` does.

use crate::harness::{Call, DECAY, Site, one_worker};
use crate::process::Folder;
use dvi::problem::Control;
use dvi::service::jobs::Solver;
use dvi::service::worker::{
    Confinement, Death, Event, Launcher, Limits, Origin, Start, Supervisor, Task, Watch, serve,
};
use dvi::service::{Options, Service};
use std::fs::{self, File, OpenOptions};
use std::hint::black_box;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::{env, io};
use tokio::sync::Notify;

/// Name of the environment variable that holds the path of the pipe into which a worker process writes its reports;
/// its standard output is used by the test runner.
const REPORTS: &str = "DVI_TEST_REPORTS";

/// Returns a launcher of worker processes that run this test program, each with a named pipe in `folder`.
fn launcher(folder: &Folder) -> Launcher {
    fs::create_dir_all(folder.path()).unwrap();
    let (folder, number) = (folder.path().to_owned(), AtomicU64::new(0));
    Arc::new(move || {
        let pipe = folder.join(format!("reports-{}", number.fetch_add(1, Relaxed)));
        if !Command::new("mkfifo").arg(&pipe).status()?.success() {
            return Err(io::ErrorKind::NotFound.into());
        }
        let mut process = Command::new(env::current_exe()?)
            .args(["apart::is_a_worker", "--exact", "--ignored", "--nocapture"])
            .env(REPORTS, &pipe)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()?;
        let orders = process.stdin.take().unwrap().into();
        Ok(Start { orders, reports: File::open(&pipe)?.into(), process: Some(process) })
    })
}

/// Recurses until the stack overflows, in a way that the compiler cannot detect.
fn descend(depth: u64) -> u64 {
    if depth == u64::MAX { 0 } else { 1 + descend(black_box(depth + 1)) }
}

#[test]
#[ignore = "it serves another test as a worker"]
fn is_a_worker() {
    tracing_subscriber::fmt().with_writer(io::stderr).with_ansi(false).init();
    let reports = OpenOptions::new().write(true).open(env::var_os(REPORTS).unwrap()).unwrap();
    let solver: Solver = Arc::new(|specification, control| {
        match specification.label() {
            Some("overflows") => assert_ne!(descend(0), 0),
            Some("panics") => {
                tracing::warn!("what the worker logs");
                panic!("on purpose");
            }
            _ => {}
        }
        dvi::solve(specification, control)
    });
    serve(io::stdin().lock(), reports, solver, Confinement::impose(256 << 20)).unwrap();
}

fn labelled(label: &str) -> String {
    DECAY.replacen('{', &format!("{{\"label\":\"{label}\","), 1)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_that_overflows_its_stack_ends_alone() {
    let folder = Folder::new();
    let options = Options { workers: crate::harness::count(2), ..one_worker() };
    // The solver of the front process gives up on purpose, so that every job is passed on to a worker.
    let nothing: Solver = Arc::new(|_, _| crate::harness::halving(dvi::solution::Status::Stopped));
    let service = Service::start(options, nothing, &launcher(&folder)).unwrap();
    let site = Site::of(service);
    let accept = async |document: String| {
        let reply = Call::solve(document).header("prefer", "respond-async").send(&site).await;
        reply.header("location").to_owned()
    };
    let mut jobs = Vec::new();
    for k in 0..12 {
        jobs.push(accept(if k % 4 == 1 { labelled("overflows") } else { DECAY.to_owned() }).await);
    }
    for (k, job) in jobs.iter().enumerate() {
        let state = site.ended(job).await;
        let (expected, results) = if k % 4 == 1 { ("failed", 500) } else { ("successful", 200) };
        assert_eq!(state["status"], expected, "{state}");
        let reply = site.get(&format!("{job}/results")).await;
        assert_eq!(reply.status, results);
        if results == 500 {
            reply.problem(500, "stack-overflow");
            assert!(state["message"].as_str().unwrap().starts_with("stack-overflow: "), "{state}");
        }
    }
    assert_eq!(site.get("/healthz").await.status, 200);
    let figures = site.get("/metrics").await;
    assert!(figures.text().contains("dvi_workers_lost_total{reason=\"stack_overflow\"} 3\n"), "{}", figures.text());
}

#[tokio::test]
async fn what_a_worker_logs_has_the_ids_of_its_job() {
    let folder = Folder::new();
    let mut supervisor = Supervisor::new(launcher(&folder), u64::MAX, Arc::new(|_: Event<'_>| {}));
    let trace = "4bf92f3577b34da6a3ce929d0e0e4736";
    let origin = Origin {
        job: Some("the-job".to_owned()),
        request: Some("the-request".to_owned()),
        traceparent: Some(format!("00-{trace}-00f067aa0ba902b7-01")),
    };
    let (control, halted) = (Control::new(), Notify::new());
    let watch = Watch { origin: &origin, control: &control, halted: &halted, is_unwanted: &|| false };
    let limits = Limits { steps: 1000, memory: 1 << 28, wall_seconds: None, result_bytes: 1 << 20 };
    let (document, long) = (labelled("panics"), &mut io::sink());
    let task = &mut Task {
        solve: true,
        members: None,
        document: document.as_bytes(),
        limits,
        watch: &watch,
        long,
        yields: false,
        slice: None,
    };
    let finished = supervisor.perform(task).await;
    let Err(Death::Defect(words)) = finished else { panic!("{finished:?}") };
    let line = words.lines().find(|line| line.contains("what the worker logs")).unwrap_or_else(|| panic!("{words}"));
    for id in ["the-job", "the-request", trace] {
        assert!(line.contains(id), "{line}");
    }
}
