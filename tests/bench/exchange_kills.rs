//! Small jobs of several clients over one gateway and four workers, while workers, and later the NATS server as well,
//! are killed at random: `cargo bench --bench exchange_kills`. No job may be lost or have results other than it has
//! without kills, and while all clients have waiting jobs, equally many jobs of each must end. `JOBS=N` sets the
//! number of jobs, `SECONDS=N` the time after which there are no further kills. `SERVERS=3` starts a cluster of
//! servers, of which one at a time is killed, with each job on all of them. Requests may fail with status 503 only,
//! and the number of those is printed.

#[path = "../service/nats_server.rs"]
mod nats_server;
#[expect(dead_code, reason = "tests use the rest")]
#[path = "../service/process.rs"]
mod process;

use dvi::problem::Control;
use dvi::specification::Specification;
use nats_server::{NatsServer, Worker, is_installed};
use process::{Answer, DVI, Folder, Server, send};
use serde_json::Value;
use std::collections::HashMap;
use std::env;
use std::ops::Range;
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

const CLIENTS: usize = 4;
const WORKERS: usize = 4;

/// Number of concurrent requests of each client that posts jobs.
const POSTING: usize = 4;

/// Fraction of the jobs, in tenths, that are posted before the workers start: workers are as fast as clients post, so
/// that otherwise no job would wait.
const BEFORE: usize = 8;

/// Time that a restarted server of a cluster has for catching up until the next server is killed.
const CAUGHT_UP: Duration = Duration::from_secs(5);

/// Number of responses with status 503 to all clients so far.
static REFUSED: AtomicUsize = AtomicUsize::new(0);

fn number(name: &str, usual: usize) -> usize {
    env::var(name).map_or(usual, |text| text.parse().unwrap())
}

/// A client with its token and the ids of its jobs, each with the number from which its specification is made.
struct Client {
    authorization: String,
    jobs: Vec<(usize, String)>,
}

/// Returns the specification of job `k`, a decay with a rate of its own. The output of every fourth job is so long
/// that a worker reserves (claims) the job on the exchange before it solves it; the others are solved without a
/// claim.
fn document(k: usize) -> String {
    let output = if k.is_multiple_of(4) { r#","output":{"times":{"count":300}}"# } else { "" };
    format!(
        r#"{{"problem":{{"dvi":{{"states":{{"x":{{"initial":1,"rate":"-{k}*x/100000"}}}}}}}},"time":{{"end":1}}{output}}}"#
    )
}

fn main() {
    if !is_installed() {
        return;
    }
    let (jobs, seconds) = (number("JOBS", 100_000), number("SECONDS", 600));
    let (folder, store) = (Folder::new(), Folder::new());
    let mut clients: Vec<Client> = (0..CLIENTS).map(|k| client(&folder, k)).collect();
    let servers = number("SERVERS", 1);
    let mut nats = match servers {
        1 => vec![NatsServer::start(store.path())],
        servers => NatsServer::start_cluster(store.path(), servers),
    };
    let urls: Vec<String> = nats.iter().map(NatsServer::url).collect();
    let (url, replicas) = (urls.join(","), servers.to_string());
    let many = "10000000";
    let bounds = ["--queue", many, "--client-share", many, "--kept-jobs", many, "--kept-mib", "16384"];
    let sharing = ["--ask-tokens", "--nats", &url, "--nats-lost-seconds", "2", "--nats-replicas", &replicas];
    let gateway = Server::start(&folder, &[&sharing[..], &bounds].concat());
    let address = &gateway.address;
    let begun = Instant::now();
    post_all(address, &mut clients, 0..jobs * BEFORE / 10);
    println!("{} jobs posted in {:?}", jobs * BEFORE / 10, begun.elapsed());
    let mut workers: Vec<Worker> = (0..WORKERS).map(|_| Worker::start(&url, &[])).collect();
    let (started, is_over) = (Instant::now(), AtomicBool::new(false));
    let (mut worker_kills, mut server_kills) = (0, 0);
    thread::scope(|scope| {
        scope.spawn(|| {
            post_all(address, &mut clients, jobs * BEFORE / 10..jobs);
            while waiting(address, &clients[0]) != Some(0) {
                thread::sleep(Duration::from_millis(50));
            }
            is_over.store(true, Relaxed);
        });
        let mut random = fastrand::Rng::with_seed(std::process::id().into());
        let most = Duration::from_secs(seconds as u64);
        while !is_over.load(Relaxed) {
            thread::sleep(Duration::from_millis(random.u64(200..2000)));
            if started.elapsed() > most {
                continue;
            }
            workers[random.usize(..WORKERS)] = Worker::start(&url, &[]);
            worker_kills += 1;
            // During the first part of the time only workers are killed, and no NATS server.
            if started.elapsed() > most / 20 && random.usize(..8) == 0 {
                let server = random.usize(..servers);
                nats[server].kill();
                thread::sleep(Duration::from_millis(random.u64(..1000)));
                nats[server].restart();
                server_kills += 1;
                if servers > 1 {
                    // A server that has not yet caught up with the cluster counts as one that is down.
                    thread::sleep(CAUGHT_UP);
                }
            }
        }
    });
    let time = started.elapsed();
    println!("{jobs} jobs done in {time:?}, {worker_kills} kills of workers, {server_kills} of the server");
    let listed: Vec<Vec<Value>> = clients.iter().map(|client| list(address, client)).collect();
    println!("jobs of each client that ended while all had some: {:?}", shares(&listed));
    let (lost, again) = count(&clients, &listed);
    let differing = differing(address, &clients);
    println!("{} requests were refused with 503", REFUSED.load(Relaxed));
    println!("{lost} lost, {differing} with other results, {again} in a later attempt; {:?} in all", begun.elapsed());
    assert_eq!((lost, differing), (0, 0));
}

fn client(folder: &Folder, k: usize) -> Client {
    let mut command = Command::new(DVI);
    let made = command.args(["token", "create", "--name", &format!("client{k}"), "--data"]).arg(folder.path()).output();
    let token = String::from_utf8(made.unwrap().stdout).unwrap().split_whitespace().next_back().unwrap().to_owned();
    Client { authorization: format!("authorization: Bearer {token}\r\n"), jobs: Vec::new() }
}

/// Posts the jobs with the given numbers, every fourth for each client: first all jobs of one client, then those of
/// the next. A queue that does not alternate between clients would thus show.
fn post_all(address: &str, clients: &mut [Client], numbers: Range<usize>) {
    for (first, client) in clients.iter_mut().enumerate() {
        let authorization = &client.authorization;
        let from = |thread: usize| {
            let numbers = numbers.clone().skip(first).step_by(CLIENTS).skip(thread).step_by(POSTING);
            numbers.map(|k| (k, post(address, authorization, k))).collect()
        };
        let from = &from;
        let posted: Vec<Vec<(usize, String)>> = thread::scope(|scope| {
            let posting: Vec<_> = (0..POSTING).map(|thread| scope.spawn(move || from(thread))).collect();
            posting.into_iter().map(|posting| posting.join().unwrap()).collect()
        });
        client.jobs.extend(posted.into_iter().flatten());
    }
}

/// Posts job `k`, with its number as idempotency key, until it is accepted, and returns its id.
fn post(address: &str, authorization: &str, k: usize) -> String {
    let headers =
        format!("{authorization}prefer: respond-async\r\nidempotency-key: {k}\r\ncontent-type: application/json\r\n");
    loop {
        let answer = send(address, "POST", "/solve", &headers, &document(k)).expect("the gateway is not killed");
        match answer.status {
            202 => return answer.json()["id"].as_str().unwrap().to_owned(),
            409 | 503 => {
                REFUSED.fetch_add(usize::from(answer.status == 503), Relaxed);
                thread::sleep(Duration::from_millis(20));
            }
            other => panic!("{other}: {}", answer.body),
        }
    }
}

/// Returns the response to a GET request for `path`, repeated until its status is not 503.
fn get(address: &str, client: &Client, path: &str) -> Answer {
    loop {
        let answer = send(address, "GET", path, &client.authorization, "").expect("the gateway is not killed");
        if answer.status != 503 {
            return answer;
        }
        REFUSED.fetch_add(1, Relaxed);
        thread::sleep(Duration::from_millis(20));
    }
}

/// Returns the number of jobs that wait or run on the service.
fn waiting(address: &str, client: &Client) -> Option<u64> {
    let metrics = get(address, client, "/metrics").body;
    let figure =
        |name: &str| -> Option<u64> { metrics.lines().find_map(|line| line.strip_prefix(name))?.trim().parse().ok() };
    Some(figure("dvi_jobs_waiting ")? + figure("dvi_jobs_running ")?)
}

/// Returns the statuses of all jobs of a client.
fn list(address: &str, client: &Client) -> Vec<Value> {
    let mut all: Vec<Value> = Vec::new();
    loop {
        let cursor = all.last().map(|job| format!("&cursor={}", job["id"].as_str().unwrap())).unwrap_or_default();
        let answer = get(address, client, &format!("/jobs?limit=1000{cursor}"));
        let page = answer.json()["jobs"].as_array().unwrap().clone();
        let is_last = page.len() < 1000;
        all.extend(page);
        if is_last {
            return all;
        }
    }
}

/// Returns the number of jobs of each client that ended in the middle half of the time in which all clients had jobs
/// in the queue.
fn shares(listed: &[Vec<Value>]) -> Vec<usize> {
    let ended = |jobs: &Vec<Value>| {
        let mut times: Vec<String> =
            jobs.iter().filter_map(|job| job["finished"].as_str().map(str::to_owned)).collect();
        times.sort_unstable();
        times
    };
    let times: Vec<Vec<String>> = listed.iter().map(ended).collect();
    let at = |quarter: usize| times.iter().map(move |times| times[times.len() * quarter / 4].clone());
    let (from, to) = (at(1).max().unwrap(), at(3).min().unwrap());
    times.iter().map(|times| times.iter().filter(|time| **time > from && **time <= to).count()).collect()
}

/// Returns the number of jobs that were not successful, and the number of those that succeeded in a later attempt.
fn count(clients: &[Client], listed: &[Vec<Value>]) -> (usize, usize) {
    let (mut lost, mut again) = (0, 0);
    for (client, listed) in clients.iter().zip(listed) {
        let by_id: HashMap<&str, &Value> = listed.iter().map(|job| (job["id"].as_str().unwrap(), job)).collect();
        for (k, id) in &client.jobs {
            match by_id.get(id.as_str()) {
                Some(job) if job["status"] == "successful" => again += usize::from(job["attempt"] != 1),
                other => {
                    lost += 1;
                    println!("job {k} {id}: {other:?}");
                }
            }
        }
    }
    (lost, again)
}

/// Returns the number of jobs whose results differ from those of a direct solve.
fn differing(address: &str, clients: &[Client]) -> usize {
    let differing = AtomicUsize::new(0);
    thread::scope(|scope| {
        for client in clients {
            scope.spawn(|| {
                for (k, id) in &client.jobs {
                    let answer = get(address, client, &format!("/jobs/{id}/results"));
                    let results = answer.json();
                    let specification = Specification::from_json(document(*k).as_bytes()).unwrap();
                    let alone = dvi::solve(&specification, &Control::default()).trajectory;
                    if results["trajectory"] != serde_json::to_value(&alone).unwrap() {
                        let told: String = answer.body.chars().take(200).collect();
                        println!("job {k} {id} differs: {} {told}", answer.status);
                        differing.fetch_add(1, Relaxed);
                    }
                }
            });
        }
    });
    differing.into_inner()
}
