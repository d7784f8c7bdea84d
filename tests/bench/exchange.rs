//! Jobs over NATS compared with jobs on one machine: `cargo bench --bench exchange`. For both, it prints the latency
//! of a small synchronous job, and the jobs per second of several clients. For NATS, it also prints the share of each
//! client while all have waiting jobs, and the throughput of many workers whose solves only sleep, so that one
//! machine can run them. `JOBS=N` sets the number of jobs, `WORKERS=N` that of worker processes, `SLEEPERS=N` that of
//! sleeping workers.

#[expect(dead_code, reason = "tests use the rest")]
#[path = "../service/nats_server.rs"]
mod nats_server;
#[expect(dead_code, reason = "tests use the rest")]
#[path = "../service/process.rs"]
mod process;
#[path = "../service/threads.rs"]
mod threads;

use dvi::problem::Control;
use dvi::service::jobs::{Nats, Solver, WorkOptions, work};
use nats_server::{NatsServer, Worker, is_installed};
use process::{DVI, Folder, Server};
use serde_json::Value;
use std::env;
use std::num::NonZeroUsize;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};
use threads::threads;
use tokio::runtime::Builder;
use tokio::sync::mpsc::channel;

const CLIENTS: usize = 4;

/// Specification of an exponential decay.
const DECAY: &str = r#"{"problem":{"dvi":{"states":{"x":{"initial":1,"rate":"-x"}}}},"time":{"end":1}}"#;

const MANY: [&str; 6] = ["--queue", "1000000", "--client-share", "1000000", "--kept-jobs", "1000000"];

fn number(name: &str, usual: usize) -> usize {
    env::var(name).map_or(usual, |text| text.parse().unwrap())
}

fn main() {
    if !is_installed() {
        return;
    }
    let (jobs, workers) = (number("JOBS", 2000), number("WORKERS", 2));
    let (near, folder) = (Folder::new(), Folder::new());
    let tokens: Vec<String> = (0..CLIENTS).map(|k| token(&near, k)).collect();
    let count = workers.to_string();
    let server = Server::start(&near, &[&["--ask-tokens", "--workers", &count][..], &MANY].concat());
    measure("one machine", &server, &tokens, jobs);
    drop(server);
    let nats = NatsServer::start(folder.path());
    let url = nats.url();
    let server = Server::start(&near, &[&["--ask-tokens", "--nats", &url][..], &MANY].concat());
    let start = || (0..workers).map(|_| Worker::start(&url, &[])).collect::<Vec<Worker>>();
    let running = start();
    measure("over NATS", &server, &tokens, jobs);
    drop(running);
    shares(&server, &tokens, jobs / CLIENTS, start);
    drop((server, nats));
    sleepers(&near, folder.path(), &tokens, number("SLEEPERS", 200));
}

fn token(folder: &Folder, k: usize) -> String {
    let mut command = Command::new(DVI);
    let made = command.args(["token", "create", "--name", &format!("client{k}"), "--data"]).arg(folder.path()).output();
    String::from_utf8(made.unwrap().stdout).unwrap().split_whitespace().next_back().unwrap().to_owned()
}

fn headers(token: &str, more: &str) -> String {
    format!("authorization: Bearer {token}\r\ncontent-type: application/json\r\n{more}")
}

fn measure(name: &str, server: &Server, tokens: &[String], jobs: usize) {
    // A job with an idempotency key is not solved inline, but goes through the queue.
    let wait = |k: usize| {
        let begun = Instant::now();
        let key = format!("idempotency-key: w{k}\r\ncache-control: no-cache\r\n");
        let answer = server.send("POST", "/solve", &headers(&tokens[0], &key), DECAY);
        assert_eq!(answer.status, 200, "{}", answer.body);
        begun.elapsed()
    };
    for k in 0..20 {
        wait(k);
    }
    let mut latencies: Vec<Duration> = (20..520).map(wait).collect();
    latencies.sort_unstable();
    println!("{name}: a job that is waited for: p50 {:?}, p99 {:?}", latencies[250], latencies[495]);
    let begun = Instant::now();
    thread::scope(|scope| {
        for token in tokens {
            scope.spawn(|| (0..jobs / CLIENTS).for_each(|_| post(server, token)));
        }
    });
    let posted = begun.elapsed();
    while waiting(server, &tokens[0]) > 0 {
        thread::sleep(Duration::from_millis(5));
    }
    let rate = |time: Duration| jobs as f64 / time.as_secs_f64();
    println!("{name}: {jobs} jobs: {:.0} a second accepted, {:.0} solved", rate(posted), rate(begun.elapsed()));
}

fn post(server: &Server, token: &str) {
    let answer = server.send("POST", "/solve", &headers(token, "prefer: respond-async\r\n"), DECAY);
    assert_eq!(answer.status, 202, "{}", answer.body);
}

/// Returns the number of jobs that wait or run on the service.
fn waiting(server: &Server, token: &str) -> u64 {
    let metrics = server.send("GET", "/metrics", &headers(token, ""), "").body;
    let figure = |name: &str| -> u64 {
        let line = metrics.lines().find_map(|line| line.strip_prefix(name));
        line.and_then(|value| value.trim().parse().ok()).unwrap()
    };
    figure("dvi_jobs_waiting ") + figure("dvi_jobs_running ")
}

/// Measures the share of the workers that each client gets. The first client has posted ten times as many jobs as the
/// others, and before them. The workers, which are faster than one client posts, start only when all jobs are posted.
fn shares(server: &Server, tokens: &[String], jobs: usize, start: impl Fn() -> Vec<Worker>) {
    (0..10 * jobs).for_each(|_| post(server, &tokens[0]));
    thread::scope(|scope| {
        for token in &tokens[1..] {
            scope.spawn(|| (0..jobs).for_each(|_| post(server, token)));
        }
    });
    let _workers = start();
    let done = |token: &str| {
        let mut cursor = String::new();
        let mut ended = Vec::new();
        loop {
            let answer = server.send("GET", &format!("/jobs?limit=1000{cursor}"), &headers(token, ""), "");
            let page: Value = serde_json::from_str(&answer.body).unwrap();
            let page = page["jobs"].as_array().unwrap().clone();
            let last = page.last().map(|job| job["id"].as_str().unwrap().to_owned());
            let count = page.len();
            ended.extend(page);
            match last {
                Some(last) if count == 1000 => cursor = format!("&cursor={last}"),
                _ => return ended,
            }
        }
    };
    while waiting(server, &tokens[0]) > 0 {
        thread::sleep(Duration::from_millis(20));
    }
    // Only jobs that ended while all clients had waiting jobs are counted: after a first job of every client but the
    // first has ended, and before one of these clients has no job left.
    let times: Vec<Vec<String>> = tokens
        .iter()
        .map(|token| done(token).iter().map(|job| job["finished"].as_str().unwrap().to_owned()).collect())
        .collect();
    let mut late: Vec<Vec<String>> = times.iter().skip(1).cloned().collect();
    late.iter_mut().for_each(|times| times.sort_unstable());
    let recent = |times: &Vec<String>| times[times.len() - jobs].clone();
    let from = late.iter().map(recent).max().unwrap();
    let to = late.iter().map(|times| times.last().unwrap().clone()).min().unwrap();
    let within = |times: &Vec<String>| times.iter().filter(|time| **time > from && **time <= to).count();
    let counts: Vec<usize> = times.iter().map(within).collect();
    println!("over NATS: jobs of each client that ended while all had some: {counts:?}");
}

/// Measures the throughput of `workers` workers whose solves only sleep for a second each, with ten jobs per worker.
fn sleepers(near: &Folder, folder: &Path, tokens: &[String], workers: usize) {
    const SLEEP: Duration = Duration::from_secs(1);
    let nats = NatsServer::start(folder);
    let url = nats.url();
    let server = Server::start(near, &[&["--ask-tokens", "--nats", &url][..], &MANY].concat());
    let solver: Solver = Arc::new(|specification, control| {
        // The service first tries to solve small jobs inline, with a short deadline. The attempt must fail, so that
        // the jobs are sent to the workers.
        if control.deadline().is_some_and(|deadline| deadline < Instant::now() + SLEEP / 2) {
            return dvi::solve(specification, &Control::with_deadline(Instant::now()));
        }
        thread::sleep(SLEEP);
        dvi::solve(specification, control)
    });
    let runtime = Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let mut stops = Vec::new();
    for _ in 0..workers {
        let (stop, stopped) = channel(1);
        let options = WorkOptions {
            nats: Nats { servers: vec![url.clone()], ..Nats::default() },
            workers: NonZeroUsize::MIN,
            ..WorkOptions::default()
        };
        let solver = Arc::clone(&solver);
        let launcher = threads(Arc::clone(&solver));
        let memory = NonZeroUsize::new(1024).unwrap();
        runtime.spawn(async move { work(options, memory, solver, &launcher, stopped).await.unwrap() });
        stops.push(stop);
    }
    let post_all = |jobs: usize| {
        thread::scope(|scope| {
            for token in tokens {
                scope.spawn(|| (0..jobs / CLIENTS).for_each(|_| post(&server, token)));
            }
        });
    };
    let wait_for_all = || {
        while waiting(&server, &tokens[0]) > 0 {
            thread::sleep(Duration::from_millis(20));
        }
    };
    // Post one job per worker first, to wait until all workers have started.
    post_all(workers);
    wait_for_all();
    let jobs = 10 * workers;
    let begun = Instant::now();
    post_all(jobs);
    let posted = begun.elapsed();
    wait_for_all();
    let time = begun.elapsed();
    let most = (workers as f64) / SLEEP.as_secs_f64();
    let rate = jobs as f64 / time.as_secs_f64();
    println!(
        "{workers} workers that sleep: {jobs} jobs posted in {posted:?}, done in {time:?}: {rate:.0} a second of {most:.0}"
    );
    runtime.shutdown_background();
}
