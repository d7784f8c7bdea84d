//! Short requests that declare a lot of work: the resources that the service needs to check them. `cargo bench
//! --bench killers`.
//!
//! Each request is sent by four clients at the same time. The table has the time until the last of them is answered,
//! the slowest `GET /healthz` meanwhile, the peak memory of the process, and the count of each response: the status
//! 200, the name of a problem type, or none. No check and no solve may take longer than 20 seconds.

#[path = "../service/process.rs"]
mod process;

use process::{Answer, Folder, Server};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

const CLIENTS: usize = 4;

fn obstacle(elements: u32) -> Value {
    json!({
        "problem": {"obstacle": {"domain": {"x": [0, 1], "y": [0, 1], "z": [0, 1]}, "elements": elements, "diffusion": 1,
            "initial": 0}},
        "time": {"end": 1},
    })
}

fn elastic(elements: u32) -> Value {
    json!({
        "problem": {"elastic": {"body": {"box": {"x": [0, 1], "y": [0, 1], "z": [0, 1]}}, "elements": elements, "density": 1, "young": 100,
            "clamped": ["x_min"]}},
        "time": {"end": 1},
    })
}

fn spheres(count: usize) -> Value {
    let sphere = json!({"shape": {"sphere": {"radius": 1}}, "density": 1});
    json!({
        "problem": {"rigid_bodies": {"bodies": vec![sphere; count], "interpenetration": "resolve"}},
        "time": {"end": 1},
        "method": {"step": 0.01},
    })
}

fn main() {
    println!("{:<24} {:>8} {:>9} {:>12} {:>6}  answers", "POST", "bytes", "seconds", "healthz ms", "MiB");
    for (name, path, document) in [
        ("/check, 50^3 elements", "/check", obstacle(50)),
        ("/check, 100^3 elements", "/check", obstacle(100)),
        ("/check, elastic 20^3", "/check", elastic(20)),
        ("/check, elastic 31^3", "/check", elastic(31)),
        ("/check, 700 spheres", "/check", spheres(700)),
        ("/check, 20,000 spheres", "/check", spheres(20_000)),
        ("/solve, 700 spheres", "/solve", spheres(700)),
    ] {
        let text = document.to_string();
        let folder = Folder::new();
        let server = Server::start(&folder, &["--wall-seconds", "20"]);
        let Met { time, slowest, most_kib, answers } = meet(&server, path, &text);
        let (seconds, healthz, mib) = (time.as_secs_f64(), 1e3 * slowest.as_secs_f64(), most_kib as f64 / 1024.0);
        println!("{name:<24} {:>8} {seconds:>9.3} {healthz:>12.1} {mib:>6.0}  {answers}", text.len());
    }
}

/// Measurements of one request that is sent by several clients at the same time.
struct Met {
    time: Duration,
    slowest: Duration,
    most_kib: u64,
    answers: String,
}

fn meet(server: &Server, path: &str, text: &str) -> Met {
    let answered = AtomicBool::new(false);
    thread::scope(|scope| {
        let watch = scope.spawn(|| {
            let (mut slowest, mut most_kib) = (Duration::ZERO, 0);
            while !answered.load(Relaxed) {
                let start = Instant::now();
                assert_eq!(server.get("/healthz").status, 200);
                slowest = slowest.max(start.elapsed());
                most_kib = most_kib.max(server.resident_kib());
                thread::sleep(Duration::from_millis(2));
            }
            (slowest, most_kib)
        });
        let start = Instant::now();
        let send = || name(server.try_send("POST", path, "", text));
        let clients: Vec<_> = (0..CLIENTS).map(|_| scope.spawn(send)).collect();
        let mut answers = BTreeMap::new();
        for client in clients {
            *answers.entry(client.join().unwrap_or_else(|_| "unreadable".to_owned())).or_insert(0) += 1;
        }
        let time = start.elapsed();
        answered.store(true, Relaxed);
        let (slowest, most_kib) = watch.join().expect("answers");
        let answers: Vec<_> = answers.iter().map(|(answer, count)| format!("{count} x {answer}")).collect();
        Met { time, slowest, most_kib, answers: answers.join(", ") }
    })
}

/// Returns a response as one word: its status, the name of its problem type, or `none`.
fn name(answer: Option<Answer>) -> String {
    match answer {
        None => "none".to_owned(),
        Some(answer) if answer.status < 300 => answer.status.to_string(),
        Some(answer) => answer.json()["type"].as_str().unwrap_or_default().trim_start_matches("/problems/").to_owned(),
    }
}
