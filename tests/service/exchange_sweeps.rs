//! Sweeps that several workers share over NATS: their results have the same bytes as on one machine, whichever
//! process is killed meanwhile.

use crate::harness::{Call, DECAY, Site, halving, one_worker};
use crate::nats::{NatsServer, anew, is_installed, worker, worker_on};
use crate::nats_server::Worker;
use crate::process::{DVI, Folder, Server};
use crate::sweep_kills::{oscillators, undisturbed};
use axum::http::StatusCode;
use dvi::service::Options;
use dvi::service::jobs::{Nats, Solver};
use dvi::solution::Status;
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::num::NonZeroU64;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};
use tokio::runtime::Builder;
use tokio::sync::mpsc::unbounded_channel;
use tokio::sync::watch;

fn gateway(url: &str) -> Server {
    let mut command = Command::new(DVI);
    command.args(["serve", "--listen", "127.0.0.1:0", "--log-format", "json", "--nats", url]);
    Server::of(command.args(["--nats-lost-seconds", "2"])).unwrap()
}

/// Returns the subjects under which the NATS server stores data of chunks of sweeps, for the default name of the
/// streams.
fn left_behind(url: &str) -> Vec<String> {
    let kept = |stream: &str, subjects: &str| subjects_of(url, stream, subjects);
    [kept("KV_dvi_state", "$KV.dvi_state.part.>"), kept("KV_dvi_data", "$KV.dvi_data.rows.>")].concat()
}

/// Returns the subjects of a NATS stream that match a filter.
fn subjects_of(url: &str, stream: &str, filter: &str) -> Vec<String> {
    let address = url.strip_prefix("nats://").unwrap();
    let mut connection = TcpStream::connect(address).unwrap();
    let question = format!(r#"{{"subjects_filter":"{filter}"}}"#);
    let length = question.len();
    write!(
        connection,
        "CONNECT {{\"verbose\":false}}\r\nSUB told 1\r\nPUB $JS.API.STREAM.INFO.{stream} told {length}\r\n{question}\r\n"
    )
    .unwrap();
    // Skip the greeting of the server and the header of the message.
    let mut lines = BufReader::new(connection).lines().map(Result::unwrap);
    let told = lines.find(|line| line.starts_with('{')).unwrap();
    let told: Value = serde_json::from_str(&told).unwrap();
    assert!(told["config"].is_object(), "{told}");
    let subjects = told["state"]["subjects"].as_object();
    subjects.map(|subjects| subjects.keys().cloned().collect()).unwrap_or_default()
}

#[test]
fn kills_of_workers_that_share_a_sweep_change_no_byte_and_leave_nothing_behind() {
    if !is_installed() {
        return;
    }
    let document = oscillators(3000, 150);
    let folder = Folder::new();
    let nats = NatsServer::start(folder.path());
    let url = nats.url();
    let server = gateway(&url);
    let mut workers = [0; 2].map(|_| Worker::start(&url, &[]));
    let path = server.accept(&document);
    let mut known = 0;
    // Each of the two workers is killed twice; one of them divides the sweep into chunks for both.
    for kill in 0..4 {
        known = server.rows(&path, known + 200);
        workers[kill % 2] = Worker::start(&url, &[]);
        let next = server.rows(&path, known + 1);
        assert!(next >= known, "{next} rows of {known} after kill {kill}");
    }
    let ended = server.succeeds(&path);
    assert_eq!(ended["members"]["done"], 3000);
    let (results, expected) = (server.get(&format!("{path}/results")).body.into_bytes(), undisturbed(&document));
    let differs = results.iter().zip(&expected).position(|(one, other)| one != other);
    let from = differs.unwrap_or(0).saturating_sub(100);
    let told = |text: &[u8]| {
        String::from_utf8_lossy(text.get(from..).unwrap_or_default()).chars().take(300).collect::<String>()
    };
    assert!(results == expected, "{}\n{}", told(&results), told(&expected));
    assert_eq!(left_behind(&url), Vec::<String>::new());
}

#[test]
fn a_server_that_is_killed_while_workers_share_a_sweep_changes_no_byte() {
    if !is_installed() {
        return;
    }
    let document = oscillators(3000, 150);
    let folder = Folder::new();
    let mut nats = NatsServer::start(folder.path());
    let url = nats.url();
    let server = gateway(&url);
    let _workers = [0; 2].map(|_| Worker::start(&url, &[]));
    let path = server.accept(&document);
    let mut known = 0;
    for _ in 0..2 {
        known = server.rows(&path, known + 500);
        nats.kill();
        thread::sleep(Duration::from_millis(300));
        nats.restart();
    }
    assert!(known < 3000, "the sweep was over before the server was killed");
    server.succeeds(&path);
    assert!(server.get(&format!("{path}/results")).body.into_bytes() == undisturbed(&document));
    assert_eq!(left_behind(&url), Vec::<String>::new());
}

/// Returns a solver that takes at least `time` for each chunk or job, and the counter of its calls.
fn slow(time: Duration) -> (Solver, Arc<AtomicUsize>) {
    let calls = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&calls);
    let solver: Solver = Arc::new(move |specification, control| {
        counted.fetch_add(1, Relaxed);
        thread::sleep(time);
        dvi::solve(specification, control)
    });
    (solver, calls)
}

async fn members_done(site: &Site, path: &str, least: u64) {
    let start = Instant::now();
    loop {
        let status = site.get(path).await.json();
        if status["members"]["done"].as_u64() >= Some(least) {
            return;
        }
        assert!(start.elapsed() < Duration::from_secs(30), "{status}");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

async fn post(site: &Site, client: u8, document: &str) -> String {
    let call = Call::solve(document.to_owned()).client(client).header("prefer", "respond-async");
    call.send(site).await.header("location").to_owned()
}

#[tokio::test]
async fn two_workers_share_a_sweep_and_let_others_through() {
    if !is_installed() {
        return;
    }
    let options = Options { nats: anew(), ..one_worker() };
    let ((one, by_one), (two, by_two)) = (slow(Duration::from_millis(60)), slow(Duration::from_millis(60)));
    let site = Site::gateway(options.clone(), Arc::clone(&one));
    let _workers = [worker(&options, one), worker(&options, two)];
    let document = oscillators(2000, 5);
    let path = post(&site, 1, &document).await;
    members_done(&site, &path, 1).await;
    let other = post(&site, 2, DECAY).await;
    site.ended(&other).await;
    let done = site.get(&path).await.json()["members"]["done"].as_u64().unwrap();
    assert!(done < 2000, "the job of another client has waited for the whole sweep");
    let ended = site.ended(&path).await;
    assert_eq!((&ended["status"], &ended["attempt"]), (&"successful".into(), &1.into()), "{ended}");
    assert!(site.get(&format!("{path}/results")).await.body == undisturbed(&document));
    let calls = [by_one, by_two].map(|calls| calls.load(Relaxed));
    assert!(calls.iter().all(|calls| *calls > 1), "{calls:?}");
}

#[tokio::test]
async fn a_shared_sweep_that_is_cancelled_keeps_its_rows() {
    if !is_installed() {
        return;
    }
    let options = Options { nats: anew(), ..one_worker() };
    let (solver, _) = slow(Duration::from_millis(60));
    let site = Site::gateway(options.clone(), Arc::clone(&solver));
    let _workers = [0; 2].map(|_| worker(&options, Arc::clone(&solver)));
    let path = post(&site, 1, &oscillators(100_000, 5)).await;
    // This number of members is only reached after the first worker has begun to share the sweep with the second.
    members_done(&site, &path, 1500).await;
    let cancelled = Call::post(&format!("{path}/cancel"), "").send(&site).await;
    assert_eq!(cancelled.status, StatusCode::OK, "{cancelled:?}");
    let ended = site.ended(&path).await;
    assert_eq!(ended["status"], "dismissed", "{ended}");
    let json = site.get(&format!("{path}/results")).await.json();
    let members: Vec<u64> =
        json["table"]["columns"]["member"].as_array().unwrap().iter().map(|member| member.as_u64().unwrap()).collect();
    assert_eq!(Some(members.len() as u64), ended["members"]["done"].as_u64());
    assert!(members.len() >= 1500 && members.is_sorted_by(|one, next| one < next));
}

#[tokio::test]
async fn a_worker_that_divides_all_sweeps_that_it_may_gives_the_next_back_with_its_rows() {
    /// Number of sweeps that one worker divides into chunks at the same time.
    const MOST: usize = 64;
    if !is_installed() {
        return;
    }
    let options = Options { nats: anew(), ..one_worker() };
    let site = Site::gateway(options.clone(), crate::harness::instant());
    let mut others = Vec::new();
    for _ in 0..MOST {
        others.push(post(&site, 1, &oscillators(100_000, 5)).await);
    }
    let document = oscillators(1000, 5).replacen('{', "{\"label\":\"next\",", 1);
    let path = post(&site, 1, &document).await;
    let (made, mut members) = unbounded_channel();
    let solver: Solver = Arc::new(move |specification, control| {
        thread::sleep(Duration::from_millis(20));
        let solution = dvi::solve(specification, control);
        if specification.label() == Some("next") {
            let _ = made.send(specification.sweep().unwrap().chunk().members.clone());
        }
        solution
    });
    let _worker = worker(&options, solver);
    comes_to_be(&site, &path, "running").await;
    comes_to_be(&site, &path, "accepted").await;
    for other in &others {
        assert_eq!(site.get(other).await.json()["status"], "running");
        let cancelled = Call::post(&format!("{other}/cancel"), "").send(&site).await;
        assert_eq!(cancelled.status, StatusCode::OK, "{cancelled:?}");
    }
    let ended = site.ended(&path).await;
    assert_eq!((&ended["status"], &ended["attempt"]), (&"successful".into(), &1.into()), "{ended}");
    assert!(site.get(&format!("{path}/results")).await.body == undisturbed(&document));
    // Members that were solved before the worker returned the sweep to the queue are not solved again.
    let mut count = 0;
    while let Ok(members) = members.try_recv() {
        count += members.len();
    }
    assert_eq!(count, 1000);
}

async fn comes_to_be(site: &Site, path: &str, status: &str) {
    let start = Instant::now();
    loop {
        let told = site.get(path).await.json();
        if told["status"] == status {
            return;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "{path} is not {status}: {told}");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

#[tokio::test]
async fn a_worker_that_stops_gives_a_sweep_back_with_its_rows() {
    if !is_installed() {
        return;
    }
    let options = Options { nats: anew(), ..one_worker() };
    let (solver, calls) = slow(Duration::from_millis(60));
    let site = Site::gateway(options.clone(), Arc::clone(&solver));
    let first = worker(&options, Arc::clone(&solver));
    let document = oscillators(3000, 5);
    let path = post(&site, 1, &document).await;
    members_done(&site, &path, 1200).await;
    drop(first);
    let _second = worker(&options, solver);
    let ended = site.ended(&path).await;
    assert_eq!((&ended["status"], &ended["attempt"]), (&"successful".into(), &1.into()), "{ended}");
    assert!(site.get(&format!("{path}/results")).await.body == undisturbed(&document));
    assert!(calls.load(Relaxed) < 60, "{calls:?} chunks");
}

/// Returns two metrics of the service: the number of jobs and chunks that wait, and the number of those that run.
async fn load(site: &Site) -> [u64; 2] {
    let metrics = site.get("/metrics").await;
    ["dvi_jobs_waiting ", "dvi_jobs_running "].map(|name| {
        let value = metrics.text().lines().find_map(|line| line.strip_prefix(name));
        value.unwrap().parse().unwrap()
    })
}

async fn comes_to(site: &Site, expected: impl Fn([u64; 2]) -> bool) {
    let start = Instant::now();
    loop {
        let load = load(site).await;
        if expected(load) {
            return;
        }
        assert!(start.elapsed() < Duration::from_secs(30), "{load:?}");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

#[tokio::test]
async fn chunks_count_as_jobs_that_wait_and_run() {
    if !is_installed() {
        return;
    }
    let options = Options { nats: anew(), ..one_worker() };
    let (solver, _) = slow(Duration::from_millis(60));
    let sites = [0; 2].map(|_| Site::gateway(options.clone(), Arc::clone(&solver)));
    let _worker = worker(&options, Arc::clone(&solver));
    let path = post(&sites[0], 1, &oscillators(100_000, 5)).await;
    // The sweep counts as running, and so does the chunk that its only worker solves. Chunks that further workers
    // could take count as waiting.
    for site in &sites {
        comes_to(site, |[waiting, running]| waiting >= 2 && running == 2).await;
    }
    let cancelled = Call::post(&format!("{path}/cancel"), "").send(&sites[0]).await;
    assert_eq!(cancelled.status, StatusCode::OK, "{cancelled:?}");
    for site in &sites {
        comes_to(site, |load| load == [0, 0]).await;
    }
}

#[tokio::test]
async fn rows_that_are_longer_than_a_message_go_the_same_way() {
    if !is_installed() {
        return;
    }
    let nats = anew();
    let (url, name) = (nats.servers[0].clone(), nats.name.clone());
    let options = Options { nats, ..one_worker() };
    let (solver, calls) = slow(Duration::from_millis(60));
    let site = Site::gateway(options.clone(), Arc::clone(&solver));
    let _workers = [0; 2].map(|_| worker(&options, Arc::clone(&solver)));
    // Each row of the sweep's table takes 1.6 MB.
    let document = r#"{"problem": {"dvi": {"parameters": {"k": 1}, "states": {"x": {"initial": 1, "rate": "-k*x"}}}}, "time": {"end": 1},
        "output": {"times": {"count": 200000}, "fields": ["x"]},
        "sweep": {"over": {"k": {"linspace": [0.5, 2, 8]}}, "keep": "trajectories"}}"#;
    let path = post(&site, 1, document).await;
    let ended = site.ended(&path).await;
    assert_eq!(ended["status"], "successful", "{ended}");
    assert!(site.get(&format!("{path}/results")).await.body == undisturbed(document));
    assert!(calls.load(Relaxed) > 2, "{calls:?} chunks");
    // The results are stored as a large object, as the rows were; the objects of the rows are removed.
    let start = Instant::now();
    let objects = || subjects_of(&url, &format!("OBJ_{name}_objects"), &format!("$O.{name}_objects.C.>"));
    while objects().len() > 1 {
        assert!(start.elapsed() < Duration::from_secs(30), "{:?}", objects());
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

#[tokio::test]
async fn a_chunk_that_takes_workers_down_is_halved_until_one_member_fails() {
    // With this number of members in the sweep, each of the first two chunks has two members.
    const MEMBERS: usize = 16;
    const BAD: usize = 2;
    if !is_installed() {
        return;
    }
    let nats = Nats { lost_seconds: NonZeroU64::MIN, ..anew() };
    let options = Options { nats, ..one_worker() };
    let (begun, mut has_begun) = watch::channel(0);
    let may_end = Arc::new([0; 2].map(|_| AtomicBool::new(false)));
    let wait_for = |k: usize| {
        let may_end = Arc::clone(&may_end);
        move || {
            while !may_end[k].load(Relaxed) {
                thread::sleep(Duration::from_millis(1));
            }
        }
    };
    let (first_chunk, other_job) = (wait_for(0), wait_for(1));
    // The solver of the worker that divides the sweep into chunks; the test keeps this worker busy with a job of
    // another client.
    let divider: Solver = Arc::new(move |specification, control| {
        // An inline solve, recognised by its short deadline, is not blocked by the test.
        if control.deadline().is_some_and(|deadline| deadline < Instant::now() + Duration::from_millis(10)) {
            return halving(Status::Stopped);
        }
        if specification.sweep().is_none() && specification.label().is_none() {
            return dvi::solve(specification, control);
        }
        begun.send_modify(|count| *count += 1);
        if specification.sweep().is_some() {
            first_chunk()
        } else {
            other_job()
        }
        dvi::solve(specification, control)
    });
    let (hit, mut is_hit) = unbounded_channel();
    let over = Arc::clone(&may_end);
    let doomed: Solver = Arc::new(move |specification, control| {
        let chunk = specification.sweep().unwrap().chunk();
        if chunk.lost.is_none() && chunk.members.contains(&BAD) {
            let _ = hit.send(chunk.members.clone());
            while !over[1].load(Relaxed) {
                thread::sleep(Duration::from_millis(1));
            }
        }
        dvi::solve(specification, control)
    });
    let site = Site::gateway(options.clone(), crate::harness::instant());
    let _divider = worker(&options, divider);
    // This job makes client 2 the first to be served when both clients have had a turn.
    let first = post(&site, 2, DECAY).await;
    site.ended(&first).await;
    let document = oscillators(MEMBERS, 5);
    let path = post(&site, 1, &document).await;
    has_begun.wait_for(|count| *count == 1).await.unwrap();
    let other = post(&site, 2, &DECAY.replacen('{', "{\"label\":\"keeps the place\",", 1)).await;
    // Wait until the first worker has begun to share the sweep.
    tokio::time::sleep(Duration::from_millis(300)).await;
    may_end[0].store(true, Relaxed);
    has_begun.wait_for(|count| *count == 2).await.unwrap();
    let mut lost = Vec::new();
    let ended = loop {
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        let worker = worker_on(&runtime, &options, Arc::clone(&doomed));
        let ended = tokio::select! {
            members = is_hit.recv() => {
                lost.push(members.unwrap());
                None
            }
            ended = site.ended(&path) => Some(ended),
        };
        runtime.shutdown_background();
        drop(worker);
        if let Some(ended) = ended {
            break ended;
        }
        assert!(lost.len() < 20, "{lost:?}");
    };
    may_end[1].store(true, Relaxed);
    assert_eq!(ended["status"], "successful", "{ended}");
    // A member of the sweep fails after three workers were lost while they solved it, since a single loss may be
    // unrelated to the member.
    let (first, last) = (lost.first().unwrap(), lost.last().unwrap());
    assert!(first.len() == 2 && *last == (BAD..BAD + 1), "{lost:?}");
    let json = site.get(&format!("{path}/results")).await.json();
    let whole: Value = serde_json::from_slice(&undisturbed(&document)).unwrap();
    let (columns, expected) = (&json["table"]["columns"], &whole["table"]["columns"]);
    for k in (0..MEMBERS).filter(|k| *k != BAD) {
        assert_eq!(columns["x"][k], expected["x"][k], "member {k}");
    }
    assert_eq!(columns["error"][BAD], "poisoned: workers were lost while they solved the member");
    site.ended(&other).await;
}
