//! Sweeps that several workers share over NATS: the same bytes as on one machine, whatever is killed on the way.

use crate::harness::{Call, DECAY, Site, one_worker};
use crate::nats::{NatsServer, anew, is_installed, worker};
use crate::nats_server::Worker;
use crate::process::{DVI, Folder, Server};
use crate::sweep_kills::{oscillators, undisturbed};
use axum::http::StatusCode;
use dvi::service::Options;
use dvi::service::jobs::Solver;
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

fn gateway(url: &str) -> Server {
    let mut command = Command::new(DVI);
    command.args(["serve", "--listen", "127.0.0.1:0", "--log-format", "json", "--nats", url]);
    Server::of(command.args(["--nats-lost-seconds", "2"])).unwrap()
}

/// What the server keeps of chunks.
fn left_behind(url: &str) -> Vec<String> {
    let address = url.strip_prefix("nats://").unwrap();
    let subjects = |bucket: &str, kind: &str| -> Vec<String> {
        let mut stream = TcpStream::connect(address).unwrap();
        let question = format!(r#"{{"subjects_filter":"$KV.{bucket}.{kind}.>"}}"#);
        let length = question.len();
        write!(
            stream,
            "CONNECT {{\"verbose\":false}}\r\nSUB told 1\r\nPUB $JS.API.STREAM.INFO.KV_{bucket} told {length}\r\n{question}\r\n"
        )
        .unwrap();
        // After the greeting and the head of the message.
        let mut lines = BufReader::new(stream).lines().map(Result::unwrap);
        let told = lines.find(|line| line.starts_with('{')).unwrap();
        let told: Value = serde_json::from_str(&told).unwrap();
        assert!(told["config"].is_object(), "{told}");
        let subjects = told["state"]["subjects"].as_object();
        subjects.map(|subjects| subjects.keys().cloned().collect()).unwrap_or_default()
    };
    [subjects("dvi_state", "part"), subjects("dvi_data", "rows")].concat()
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
    // One of them divides the sweep, whichever it is.
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

/// A solver that takes `time` for a chunk, or a job, more than it needs; and how often it was called.
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
    // More than one worker has before it shares them.
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
