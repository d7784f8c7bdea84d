//! Few words that declare much: what they take of the service while they are checked. `cargo bench --bench killers`.
//!
//! Beside each request, sent by four clients at once, stand the time until the last of them is answered, the slowest
//! `GET /healthz` meanwhile, and the most memory that the process held.

#[allow(dead_code)]
#[path = "../service/process.rs"]
mod process;

use process::{Folder, Server};
use serde_json::{Value, json};
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
    println!("{:<28} {:>8} {:>12} {:>12} {:>8} {:>8}", "POST", "bytes", "seconds", "healthz ms", "MiB", "status");
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
        let server = Server::start(&folder, &[]);
        let (seconds, slowest, most, status) = meet(&server, path, &text);
        let (healthz, mib) = (1e3 * slowest.as_secs_f64(), most as f64 / 1024.0);
        println!("{name:<28} {:>8} {seconds:>12.3} {healthz:>12.1} {mib:>8.0} {status:>8}", text.len());
    }
}

fn meet(server: &Server, path: &str, text: &str) -> (f64, Duration, u64, u16) {
    let answered = AtomicBool::new(false);
    thread::scope(|scope| {
        let watch = scope.spawn(|| {
            let (mut slowest, mut most) = (Duration::ZERO, 0);
            while !answered.load(Relaxed) {
                let start = Instant::now();
                assert_eq!(server.get("/healthz").status, 200);
                slowest = slowest.max(start.elapsed());
                most = most.max(server.resident_kib());
                thread::sleep(Duration::from_millis(2));
            }
            (slowest, most)
        });
        let start = Instant::now();
        let clients: Vec<_> =
            (0..CLIENTS).map(|_| scope.spawn(|| server.send("POST", path, "", text).status)).collect();
        let status = clients.into_iter().map(|client| client.join().expect("an answer")).max().unwrap_or(0);
        let seconds = start.elapsed().as_secs_f64();
        answered.store(true, Relaxed);
        let (slowest, most) = watch.join().expect("answers");
        (seconds, slowest, most, status)
    })
}
