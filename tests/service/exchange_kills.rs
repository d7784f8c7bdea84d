//! Gateways, workers and a NATS server as processes that are killed at any moment: no job is lost, and all jobs have
//! the results that they have without kills.

use crate::nats::{NatsServer, is_installed};
use crate::nats_server::Worker;
use crate::process::{DVI, Folder, Server, send};
use dvi::specification::Specification;
use serde_json::Value;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

/// Number of jobs; the environment variable `DVI_EXCHANGE_JOBS` sets a larger one.
const JOBS: usize = 2000;
const WORKERS: usize = 2;

/// Number of clients that post jobs concurrently.
const POSTING: usize = 4;

/// Least number of kills of workers, and the number of kills of workers between two kills of the NATS server.
const KILLS: usize = 12;
const BETWEEN: usize = 6;

/// Time limit for `JOBS` jobs, longer than these take on a busy machine; it grows in proportion to the number of
/// jobs.
const SETTLED: Duration = Duration::from_secs(240);

fn gateway(url: &str) -> Server {
    let many = "1000000";
    let mut command = Command::new(DVI);
    command.args([
        "serve",
        "--listen",
        "127.0.0.1:0",
        "--log-format",
        "json",
        "--nats",
        url,
        "--nats-lost-seconds",
        "2",
    ]);
    command.args(["--queue", many, "--client-share", many, "--kept-jobs", many]);
    Server::of(&mut command).unwrap()
}

/// Returns the specification of job `k`, a decay with a rate of its own. The output of every fourth job is so long
/// that a worker reserves (claims) the job on the exchange before it solves it; the others are solved without a
/// claim.
fn document(k: usize) -> String {
    let output = if k.is_multiple_of(4) { r#","output":{"times":{"count":1000}}"# } else { "" };
    format!(
        r#"{{"problem":{{"dvi":{{"states":{{"x":{{"initial":1,"rate":"-{k}*x/1000"}}}}}}}},"time":{{"end":1}}{output}}}"#
    )
}

/// Posts job `k`, with its number as idempotency key, until it is accepted, and returns its path.
fn post(address: &str, k: usize) -> String {
    let headers = format!("prefer: respond-async\r\nidempotency-key: {k}\r\ncontent-type: application/json\r\n");
    let start = Instant::now();
    loop {
        if let Some(answer) = send(address, "POST", "/solve", &headers, &document(k)) {
            match answer.status {
                202 => {
                    let status: Value = serde_json::from_str(&answer.body).unwrap();
                    return format!("/jobs/{}", status["id"].as_str().unwrap());
                }
                409 | 503 => {}
                other => panic!("{other}: {}", answer.body),
            }
        }
        assert!(start.elapsed() < SETTLED, "job {k} is not accepted");
        thread::sleep(Duration::from_millis(20));
    }
}

/// Posts all jobs from several clients of each gateway, each of which waits for a response before it posts its next
/// job; returns the paths of the jobs.
fn post_all(gateways: &[Server; 2], jobs: usize) -> Vec<String> {
    let from = |first: usize| -> Vec<(usize, String)> {
        (first..jobs).step_by(POSTING).map(|k| (k, post(&gateways[k % 2].address, k))).collect()
    };
    let from = &from;
    let mut paths: Vec<(usize, String)> = thread::scope(|scope| {
        let posting: Vec<_> = (0..POSTING).map(|first| scope.spawn(move || from(first))).collect();
        posting.into_iter().flat_map(|posting| posting.join().unwrap()).collect()
    });
    paths.sort_unstable();
    paths.into_iter().map(|(_, path)| path).collect()
}

#[test]
fn no_kill_of_workers_or_of_the_server_loses_or_spoils_a_job() {
    if !is_installed() {
        return;
    }
    let jobs = std::env::var("DVI_EXCHANGE_JOBS").map_or(JOBS, |text| text.parse().unwrap());
    let settled = SETTLED * u32::try_from(jobs.div_ceil(JOBS)).unwrap();
    let (folder, start) = (Folder::new(), Instant::now());
    let mut nats = NatsServer::start(folder.path());
    let url = nats.url();
    let gateways = [gateway(&url), gateway(&url)];
    let mut workers: Vec<Worker> = (0..WORKERS).map(|_| Worker::start(&url, &[])).collect();
    let is_posted = AtomicBool::new(false);
    let paths = thread::scope(|scope| {
        let posting = scope.spawn(|| {
            let paths = post_all(&gateways, jobs);
            is_posted.store(true, Relaxed);
            paths
        });
        let mut random = fastrand::Rng::with_seed(std::process::id().into());
        for kill in 1.. {
            if kill > KILLS && is_posted.load(Relaxed) {
                break;
            }
            thread::sleep(Duration::from_millis(random.u64(100..600)));
            let victim = random.usize(..WORKERS);
            workers[victim] = Worker::start(&url, &[]);
            if kill % BETWEEN == 0 {
                nats.kill();
                thread::sleep(Duration::from_millis(random.u64(..500)));
                nats.restart();
            }
        }
        posting.join().unwrap()
    });
    let posted = start.elapsed();
    // The status of each job is requested from the gateway to which the job was not posted.
    let mut again = 0;
    for (k, path) in paths.iter().enumerate() {
        let gateway = &gateways[(k + 1) % 2];
        // Requests are repeated until they succeed, since the NATS server may just have been killed.
        let found = |path: &str| -> Value {
            loop {
                let answer = gateway.get(path);
                match answer.status {
                    200 => return serde_json::from_str(&answer.body).unwrap(),
                    503 => assert!(start.elapsed() < settled, "{path}: {}", answer.body),
                    other => panic!("{path}: {other} {}", answer.body),
                }
                thread::sleep(Duration::from_millis(20));
            }
        };
        let status = loop {
            let status = found(path);
            if !["accepted", "running"].contains(&status["status"].as_str().unwrap()) {
                break status;
            }
            assert!(start.elapsed() < settled, "{path}: {status}");
            thread::sleep(Duration::from_millis(5));
        };
        assert_eq!(status["status"], "successful", "{status}");
        again += usize::from(status["attempt"] != 1);
        let results = found(&format!("{path}/results"));
        let alone = dvi::solve(&Specification::from_json(document(k).as_bytes()).unwrap(), &Default::default());
        let alone: Value = serde_json::to_value(&alone.trajectory).unwrap();
        assert_eq!(results["trajectory"], alone, "{path}");
    }
    println!("{jobs} jobs, {again} of them again, posted in {posted:?} and done in {:?}", start.elapsed());
    let leaves = Worker::start(&url, &["--until-idle", "1s"]).0.wait().unwrap();
    assert_eq!(leaves.code(), Some(0));
}
