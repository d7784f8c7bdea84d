//! Clients that send only hostile jobs, while another client solves the friction belt: `cargo bench --bench siege`
//! for ten minutes; `SECONDS=60` sets another time. The output has the number of failed solves of the belt, their
//! latencies before and during the siege, the peak memory of the front process, and the responses to the hostile
//! clients. The front must not end, and no solve of the belt may fail.

#[path = "../service/process.rs"]
mod process;

use process::{DVI, Folder, Server};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

const CLIENTS: usize = 8;

/// Specification of the friction belt from the examples.
const BELT: &str = include_str!("../../api/examples/friction_belt.json");

/// Time during which the friction belt is solved without other load.
const QUIET: Duration = Duration::from_secs(10);

/// Returns short requests that ask for much work (memory, time, nodes, contact pairs, nesting depth, long results),
/// and invalid documents.
fn hostile() -> Vec<(&'static str, String)> {
    let spheres = |count: usize| {
        json!({
            "problem": {"rigid_bodies": {
                "bodies": vec![json!({"shape": {"sphere": {"radius": 1}}, "density": 1}); count],
                "interpenetration": "resolve"
            }},
            "time": {"end": 1},
            "method": {"step": 0.01},
        })
    };
    let nodes = |elements: u32| {
        json!({
            "problem": {"obstacle": {"domain": {"x": [0, 1], "y": [0, 1], "z": [0, 1]}, "elements": elements, "diffusion": 1,
                "initial": 0}},
            "time": {"end": 1},
        })
    };
    let rate = |rate: &str, end: f64, times: u32| {
        json!({
            "problem": {"dvi": {"states": {"x": {"initial": 1, "rate": rate}}}},
            "time": {"end": end},
            "output": {"times": {"count": times}},
        })
    };
    let of = |document: Value| document.to_string();
    let deep = format!("{}x{}", "sin(".repeat(200), ")".repeat(200));
    let wide = vec!["cos(1000*t)*x"; 2000].join(" + ");
    vec![
        ("/solve", of(spheres(200))),
        ("/solve", of(spheres(1000))),
        ("/check", of(spheres(5000))),
        ("/check", of(nodes(60))),
        ("/solve", of(nodes(60))),
        ("/solve", of(nodes(200))),
        ("/solve", of(rate("cos(1000*t)", 1e9, 2))),
        ("/solve", of(rate("-x", 1.0, 2_000_000))),
        ("/solve", of(rate(&deep, 1e6, 2))),
        ("/check", of(rate(&wide, 1.0, 2))),
        ("/solve", "[".repeat(100_000)),
        ("/solve", "{\"problem\":".repeat(50_000)),
        ("/solve", "no JSON".to_owned()),
    ]
}

fn main() {
    let seconds = std::env::var("SECONDS").ok().and_then(|text| text.parse().ok()).unwrap_or(600);
    let folder = Folder::new();
    let tokens: Vec<String> = (0..=CLIENTS).map(|k| token(&folder, &format!("client {k}"))).collect();
    let bounds = ["--ask-tokens", "--workers", "2", "--wall-seconds", "10", "--memory-mib", "512"];
    let server = Server::start(&folder, &bounds);
    let alone = solve_belts(&server, &tokens[CLIENTS], QUIET);
    let (end, documents) = (AtomicBool::new(false), hostile());
    let (beside, answers, most_kib) = thread::scope(|scope| {
        let (documents, end, server) = (&documents, &end, &server);
        let besiege = |k: usize| {
            let token = &tokens[k];
            scope.spawn(move || besiege(server, token, documents, end, k))
        };
        let besieging: Vec<_> = (0..CLIENTS).map(besiege).collect();
        let watching = scope.spawn(move || {
            let mut most = 0;
            while !end.load(Relaxed) {
                most = server.resident_kib().max(most);
                thread::sleep(Duration::from_millis(20));
            }
            most
        });
        let beside = solve_belts(server, &tokens[CLIENTS], Duration::from_secs(seconds));
        end.store(true, Relaxed);
        let mut answers = BTreeMap::new();
        for (answer, count) in besieging.into_iter().flat_map(|client| client.join().expect("a client")) {
            *answers.entry(answer).or_insert(0) += count;
        }
        (beside, answers, watching.join().expect("a watch"))
    });
    println!("{answers:?}");
    println!("alone: {alone}; beside them: {beside}; front at most {} MiB", most_kib >> 10);
    for (time, told) in &beside.slowest {
        println!("{time:.1} ms, of which the service says: {told}");
    }
    println!("p99 {:.1} times that of a quiet service", beside.quantile(0.99) / alone.quantile(0.99));
    assert_eq!(server.get("/healthz").status, 200);
    assert_eq!(beside.failed, 0);
}

/// Measurements of the repeated solves of the friction belt.
struct Belts {
    /// Latencies in milliseconds, in ascending order.
    times: Vec<f64>,
    /// The slowest latencies in milliseconds, each with the `Server-Timing` header of its response.
    slowest: Vec<(f64, String)>,
    failed: usize,
}

/// Number of slowest solves whose timing header is printed.
const SLOWEST: usize = 20;

impl Belts {
    fn quantile(&self, part: f64) -> f64 {
        self.times[((self.times.len() - 1) as f64 * part).round() as usize]
    }
}

impl std::fmt::Display for Belts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (count, failed) = (self.times.len(), self.failed);
        let [half, most, worst] = [0.5, 0.99, 1.0].map(|part| self.quantile(part));
        write!(f, "{count} belts, {failed} failed, {half:.1} ms, p99 {most:.1} ms, at most {worst:.1} ms")
    }
}

/// Returns an authorization header with a new token.
fn token(folder: &Folder, name: &str) -> String {
    let made = Command::new(DVI).args(["token", "create", "--name", name, "--data"]).arg(folder.path()).output();
    format!("authorization: Bearer {}\r\n", String::from_utf8_lossy(&made.expect("a token").stdout).trim())
}

/// Solves the friction belt repeatedly for the given time.
fn solve_belts(server: &Server, token: &str, time: Duration) -> Belts {
    let (start, mut belts) = (Instant::now(), Belts { times: Vec::new(), slowest: Vec::new(), failed: 0 });
    let headers = format!("{token}cache-control: no-cache\r\nprefer: wait=60\r\n");
    while start.elapsed() < time {
        let sent = Instant::now();
        let answer = server.try_send("POST", "/solve", &headers, BELT);
        let time = 1e3 * sent.elapsed().as_secs_f64();
        belts.times.push(time);
        let told = answer.as_ref().and_then(|answer| answer.field("server-timing")).unwrap_or_default();
        belts.slowest.push((time, told.to_owned()));
        belts.slowest.sort_by(|(one, _), (other, _)| other.total_cmp(one));
        belts.slowest.truncate(SLOWEST);
        let is_well = answer.is_some_and(|answer| answer.status == 200 && answer.json()["status"] == "completed");
        belts.failed += usize::from(!is_well);
        thread::sleep(Duration::from_millis(20));
    }
    belts.times.sort_by(f64::total_cmp);
    belts
}

/// Sends hostile requests, and cancels some of the accepted jobs; returns the count of each kind of response.
fn besiege(
    server: &Server,
    token: &str,
    documents: &[(&str, String)],
    end: &AtomicBool,
    first: usize,
) -> BTreeMap<String, usize> {
    let mut answers = BTreeMap::new();
    for k in first.. {
        if end.load(Relaxed) {
            break;
        }
        let (path, document) = &documents[(k * 5) % documents.len()];
        let headers = format!("{token}{}", ["prefer: respond-async\r\n", "prefer: wait=1\r\n", ""][k % 3]);
        let answer = server.try_send("POST", path, &headers, document);
        let word = answer.as_ref().map_or("none".to_owned(), |answer| answer.status.to_string());
        *answers.entry(word).or_insert(0) += 1;
        let location = answer.and_then(|answer| answer.field("location").map(str::to_owned));
        if let Some(job) = location.filter(|_| k.is_multiple_of(2)) {
            let _ = server.try_send("POST", &format!("{job}/cancel"), token, "");
        }
    }
    answers
}
