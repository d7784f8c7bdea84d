//! Gateways and workers that share their jobs over NATS: behaviour that a service on one machine does not have.

use crate::harness::{Call, DECAY, Gate, Reply, Site, count, halving, instant, one_worker};
use crate::nats::{NatsServer, anew, is_installed, worker};
use axum::http::StatusCode;
use dvi::problem::Control;
use dvi::service::Options;
use dvi::service::jobs::{Nats, Solver};
use dvi::solution::{Field, Solution, Status};
use dvi::specification::Specification;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::num::NonZeroU64;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::time::sleep;

/// Longest time for which a test waits for another process.
const LONGEST: Duration = Duration::from_secs(30);

fn shared() -> Options {
    Options { nats: anew(), ..one_worker() }
}

/// Posts a document as an asynchronous job of client 1 under an idempotency key.
async fn post(site: &Site, key: &str, document: &str) -> Reply {
    let call = Call::solve(document.to_owned()).client(1).header("prefer", "respond-async");
    call.header("idempotency-key", key).send(site).await
}

async fn get(site: &Site, path: &str) -> Reply {
    Call::new("GET", path).client(1).send(site).await
}

/// Waits until the job of client 1 at `path` has the given status.
async fn comes_to(site: &Site, path: &str, status: &str) {
    let start = Instant::now();
    loop {
        let told = get(site, path).await.json();
        if told["status"] == status {
            return;
        }
        assert!(start.elapsed() < LONGEST, "{path} is not {status}: {told}");
        sleep(Duration::from_millis(5)).await;
    }
}

#[tokio::test]
async fn every_gateway_answers_for_the_jobs_of_the_others() {
    if !is_installed() {
        return;
    }
    let (options, gate) = (shared(), Gate::new());
    let [one, two] = [0; 2].map(|_| Site::gateway(options.clone(), gate.solver()));
    let _worker = worker(&options, gate.solver());
    let first = post(&one, "k", DECAY).await;
    assert_eq!(first.status, StatusCode::ACCEPTED, "{first:?}");
    let path = first.header("location");
    // The second gateway knows the job at once, although it was posted to the first one.
    assert_eq!(get(&two, path).await.json()["label"], get(&one, path).await.json()["label"]);
    assert_eq!(post(&two, "k", DECAY).await.header("location"), path);
    post(&two, "k", &format!("{DECAY} ")).await.problem(422, "key-reused");
    assert_eq!(get(&two, &format!("{path}/specification")).await.text(), DECAY);
    gate.entered(1).await;
    comes_to(&two, path, "running").await;
    let second = post(&two, "another", DECAY).await;
    let second = second.header("location");
    // A gateway that joins later knows the earlier jobs.
    let three = Site::gateway(options.clone(), gate.solver());
    comes_to(&three, path, "running").await;
    comes_to(&three, second, "accepted").await;
    gate.let_through(1);
    for site in [&one, &two, &three] {
        comes_to(site, path, "successful").await;
    }
    let results = format!("{path}/results");
    assert_eq!(get(&one, &results).await.body, get(&three, &results).await.body);
    // A job that one gateway cancels or deletes is cancelled or deleted for all.
    gate.entered(2).await;
    let cancelled = Call::new("POST", &format!("{second}/cancel")).client(1).send(&three).await;
    assert_eq!(cancelled.status, StatusCode::OK, "{cancelled:?}");
    comes_to(&one, second, "dismissed").await;
    assert_eq!(get(&one, &format!("{second}/results")).await.status, StatusCode::OK);
    let deleted = Call::new("DELETE", path).client(1).send(&one).await;
    assert_eq!(deleted.status, StatusCode::NO_CONTENT, "{deleted:?}");
    let start = Instant::now();
    while get(&two, path).await.status != StatusCode::NOT_FOUND {
        assert!(start.elapsed() < LONGEST, "{path} is still there");
        sleep(Duration::from_millis(5)).await;
    }
    // The idempotency key of a deleted job can be used again.
    gate.let_through(1);
    assert_ne!(post(&two, "k", DECAY).await.header("location"), path);
}

#[tokio::test]
async fn a_client_with_many_jobs_delays_another_by_one_at_most() {
    if !is_installed() {
        return;
    }
    let (options, gate) = (shared(), Gate::new());
    let site = Site::gateway(options.clone(), gate.solver());
    let mut busy = Vec::new();
    for _ in 0..40 {
        busy.push(site.accept(1).await);
    }
    let _worker = worker(&options, gate.solver());
    gate.entered(1).await;
    let late = site.accept(2).await;
    let status = async |client: u8, path: &str| Call::new("GET", path).client(client).send(&site).await.json();
    for done in 1.. {
        assert!(done <= 3, "the other client's job has not come after {done} jobs");
        gate.let_through(1);
        gate.entered(done + 1).await;
        if status(2, &late).await["status"] == "running" || status(2, &late).await["status"] == "successful" {
            break;
        }
        sleep(Duration::from_millis(50)).await;
    }
    gate.let_through(100);
    for path in &busy {
        comes_to(&site, path, "successful").await;
    }
}

#[tokio::test]
async fn a_worker_that_stops_gives_its_job_back_as_if_it_had_not_begun() {
    if !is_installed() {
        return;
    }
    let (options, gate) = (shared(), Gate::new());
    let site = Site::gateway(options.clone(), gate.solver());
    let first = worker(&options, gate.solver());
    let path = site.accept(1).await;
    gate.entered(1).await;
    drop(first);
    let _second = worker(&options, gate.solver());
    gate.entered(2).await;
    gate.let_through(1);
    comes_to(&site, &path, "successful").await;
    assert_eq!(get(&site, &path).await.json()["attempt"], 1);
}

#[tokio::test]
async fn a_worker_gives_back_at_once_what_comes_beside_its_job() {
    if !is_installed() {
        return;
    }
    let (options, gate) = (shared(), Gate::new());
    // With this setting the service would notice the loss of a worker only after 300 s, longer than the test waits.
    let nats = Nats { lost_seconds: NonZeroU64::new(300).unwrap(), ..options.nats.clone() };
    let options = Options { nats, ..options };
    let site = Site::gateway(options.clone(), gate.solver());
    let _workers = [0; 2].map(|_| worker(&options, gate.solver()));
    for round in 1..=20 {
        // Both workers are free when two jobs are posted at the same time, so that one worker may receive both.
        let (one, two) = tokio::join!(site.accept(1), site.accept(2));
        gate.entered(2 * round).await;
        gate.let_through(2);
        for (client, path) in [(1, one), (2, two)] {
            let start = Instant::now();
            while Call::new("GET", &path).client(client).send(&site).await.json()["status"] != "successful" {
                assert!(start.elapsed() < LONGEST, "{path}");
                sleep(Duration::from_millis(1)).await;
            }
        }
    }
}

/// Subscribes to a subject of the NATS server, as a member of a queue group if `group` is not empty. The returned
/// reader gives two lines for each message: its header, and its text.
fn listen(url: &str, subject: &str, group: &str) -> BufReader<TcpStream> {
    let mut connection = TcpStream::connect(url.strip_prefix("nats://").unwrap()).unwrap();
    write!(connection, "CONNECT {{\"verbose\":false}}\r\nSUB {subject} {group} 1\r\nPING\r\n").unwrap();
    connection.set_read_timeout(Some(LONGEST)).unwrap();
    let mut lines = BufReader::new(connection);
    let mut line = String::new();
    while !line.starts_with("PONG") {
        line.clear();
        assert!(lines.read_line(&mut line).unwrap() > 0);
    }
    lines
}

#[tokio::test]
async fn a_job_is_told_to_one_of_many_workers() {
    const WORKERS: usize = 8;
    const JOBS: usize = 20;
    if !is_installed() {
        return;
    }
    let options = shared();
    let (url, name) = (options.nats.servers[0].clone(), options.nats.name.clone());
    let site = Site::gateway(options.clone(), instant());
    let _workers = [0; WORKERS].map(|_| worker(&options, instant()));
    let mut pulls = None;
    for round in 0..=JOBS {
        let path = site.accept(1).await;
        comes_to(&site, &path, "successful").await;
        // The pull requests of the first round are not counted, since workers that have just started try to take jobs
        // of all clients.
        sleep(Duration::from_millis(if round == 0 { 500 } else { 10 })).await;
        pulls.get_or_insert_with(|| listen(&url, &format!("$JS.API.CONSUMER.MSG.NEXT.{name}_jobs.*"), ""));
    }
    let mut pulls = pulls.unwrap();
    write!(pulls.get_mut(), "PING\r\n").unwrap();
    let mut lines = pulls.lines().map(Result::unwrap).take_while(|line| !line.starts_with("PONG"));
    let count = lines.by_ref().filter(|line| line.starts_with("MSG ")).count();
    // Each job needs one pull request of a worker; a few more requests are in vain.
    assert!((JOBS..4 * JOBS).contains(&count), "{count} pulls");
}

#[tokio::test]
async fn a_job_whose_announcement_nobody_answers_is_announced_again() {
    if !is_installed() {
        return;
    }
    let options = shared();
    let (url, name) = (options.nats.servers[0].clone(), options.nats.name.clone());
    let site = Site::gateway(options.clone(), instant());
    // The subscription receives announcements of jobs and ignores them, like a worker whose machine has just lost its
    // power.
    let lost = listen(&url, &format!("{name}.arrival.*"), "workers");
    let path = site.accept(1).await;
    let heard = tokio::task::spawn_blocking(move || {
        let texts = lost.lines().map(Result::unwrap).filter(|line| !line.starts_with("MSG ") && line != "PING");
        texts.take(4).collect::<Vec<String>>()
    });
    // The job is announced before it is stored (unless storing is faster), when it is stored, and repeatedly while it
    // waits.
    let heard = heard.await.unwrap();
    assert!(matches!(heard[0].as_str(), "" | "there"), "{heard:?}");
    assert_eq!(heard[1..], ["there", "there", "there"]);
    let _worker = worker(&options, instant());
    comes_to(&site, &path, "successful").await;
}

/// Returns a solver whose results have about 3 MiB.
fn long() -> Solver {
    Arc::new(|_: &Specification, _: &Control| {
        let Solution { mut trajectory, .. } = halving(Status::Completed);
        trajectory.t = (0..100_000).map(f64::from).collect();
        let x = (0..100_000).map(|k| f64::from(k) * 0.1).collect();
        trajectory.fields = vec![Field { name: "x".to_owned(), values: x }];
        Solution { trajectory, ..halving(Status::Completed) }
    })
}

#[tokio::test]
async fn what_is_longer_than_a_message_goes_the_same_way() {
    if !is_installed() {
        return;
    }
    let options = shared();
    let site = Site::gateway(options.clone(), long());
    let _worker = worker(&options, long());
    let document = format!("{DECAY}{}", " ".repeat(3 << 20));
    let reply = post(&site, "k", &document).await;
    let path = reply.header("location");
    comes_to(&site, path, "successful").await;
    assert_eq!(get(&site, &format!("{path}/specification")).await.text(), document);
    let results = get(&site, &format!("{path}/results")).await.json();
    assert_eq!(results["trajectory"]["fields"]["x"][99_999], 9999.900000000001);
    let deleted = Call::new("DELETE", path).client(1).send(&site).await;
    assert_eq!(deleted.status, StatusCode::NO_CONTENT, "{deleted:?}");
}

#[tokio::test]
async fn a_full_queue_is_that_of_all_gateways() {
    if !is_installed() {
        return;
    }
    let options = Options { queue: count(3), ..shared() };
    let [one, two] = [0; 2].map(|_| Site::gateway(options.clone(), instant()));
    for key in ["a", "b", "c"] {
        let path = post(&one, key, DECAY).await.header("location").to_owned();
        comes_to(&two, &path, "accepted").await;
    }
    post(&two, "d", DECAY).await.problem(429, "queue-full");
    let metrics = get(&two, "/metrics").await;
    assert!(metrics.text().contains("dvi_jobs_waiting 3\n"), "{}", metrics.text());
}

#[tokio::test]
async fn without_its_servers_a_gateway_refuses_and_loses_nothing() {
    if !is_installed() {
        return;
    }
    let folder = std::env::temp_dir().join(format!("dvi-nats-away-{}", std::process::id()));
    let mut server = NatsServer::start(&folder);
    let nats = Nats { servers: vec![server.url()], ..anew() };
    let options = Options { nats, ..one_worker() };
    let gate = Gate::new();
    let site = Site::gateway(options.clone(), gate.solver());
    let _worker = worker(&options, gate.solver());
    let [running, waiting] = ["a", "b"].map(|key| post(&site, key, DECAY));
    let (running, waiting) = (running.await.header("location").to_owned(), waiting.await.header("location").to_owned());
    gate.entered(1).await;
    server.kill();
    let start = Instant::now();
    while get(&site, "/readyz").await.status == StatusCode::OK {
        assert!(start.elapsed() < LONGEST, "the gateway does not notice");
        sleep(Duration::from_millis(5)).await;
    }
    get(&site, "/readyz").await.problem(503, "store-away");
    let refused = post(&site, "c", DECAY).await;
    refused.problem(503, "store-away");
    assert!(refused.header("retry-after").parse::<u64>().unwrap() >= 1);
    get(&site, "/jobs/0190a1b2-0000-7000-8000-000000000000").await.problem(503, "store-away");
    // The solve ends while the NATS server is down, so that its result cannot be reported.
    gate.let_through(1);
    server.restart();
    comes_to(&site, &running, "successful").await;
    gate.let_through(1);
    comes_to(&site, &waiting, "successful").await;
    gate.let_through(1);
    let start = Instant::now();
    while post(&site, "c", DECAY).await.status != StatusCode::ACCEPTED {
        assert!(start.elapsed() < LONGEST, "the gateway does not come back");
        sleep(Duration::from_millis(50)).await;
    }
}
