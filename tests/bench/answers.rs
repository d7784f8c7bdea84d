//! Responses with a long result of 10^6 times and ten fields: `cargo bench --bench answers`.
//!
//! First, excerpts in every representation: the times to the first and to the last byte, the shortest and the longest
//! of several rounds, and for comparison the time to read a file of that size. Then, concurrent slow readers of the
//! whole result, and the peak memory of the front. Then, a job that continues the first one from its end.

#[path = "../service/process.rs"]
mod process;

use process::{Folder, Server};
use serde_json::json;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::thread;
use std::time::{Duration, Instant};

const TIMES: usize = 1_000_000;
const FIELDS: usize = 10;
const ROUNDS: usize = 5;
const SLOW_READERS: usize = 24;

fn main() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--answers-mib", "64"]);
    let state = |k: usize| (format!("x{k}"), json!({"initial": 1, "rate": format!("-x{k}*{}", 1.0 + 0.1 * k as f64)}));
    let states: serde_json::Map<_, _> = (0..FIELDS).map(state).collect();
    let document =
        json!({"problem": {"dvi": {"states": states}}, "time": {"end": 1}, "output": {"times": {"count": TIMES}}});
    let begun = Instant::now();
    let accepted = server.send("POST", "/solve", "prefer: respond-async\r\n", &document.to_string());
    let path = accepted.field("location").unwrap_or_else(|| panic!("{}", accepted.body)).to_owned();
    while server.get(&path).json()["status"] != "successful" {
        assert!(begun.elapsed() < Duration::from_secs(300), "{}", server.get(&path).body);
        thread::sleep(Duration::from_millis(100));
    }
    println!("solved and stored in {:.1} s; front: {} MiB", begun.elapsed().as_secs_f64(), server.resident_kib() >> 10);
    let file =
        std::fs::read_dir(folder.path().join("results")).expect("a folder").flatten().next().expect("a file").path();
    let begun = Instant::now();
    let bytes = std::fs::read(&file).expect("columns").len();
    println!("{} MiB of columns, read as they are in {:.1} ms", bytes >> 20, 1e3 * begun.elapsed().as_secs_f64());
    println!("{:<52} {:>10} {:>16} {:>16}", "excerpt", "bytes", "first byte ms", "last byte ms");
    for (accept, query) in [
        ("application/json", "?fields=x3&every=1000"),
        ("application/json", "?every=1000"),
        ("application/json", "?every=100&from=0.25&to=0.75"),
        ("application/json", "?from=0.5&to=0.501"),
        ("application/json", "?fields=x0,x9&from=0.9999"),
        ("text/csv", "?every=1000"),
        ("text/csv", "?fields=x5&from=0.5&to=0.51"),
        ("application/x-ndjson", "?every=1000"),
        ("application/vnd.apache.arrow.stream", "?fields=x2&every=10"),
        ("application/vnd.apache.arrow.stream", "?fields=x2"),
        ("application/vnd.apache.arrow.stream", ""),
        ("text/csv", "?fields=x5"),
        ("application/json", "?every=7"),
        ("application/json", ""),
    ] {
        let (mut first, mut last, mut length) = (Vec::new(), Vec::new(), 0);
        for _ in 0..ROUNDS {
            let met = get(&server.address, &format!("{path}/results{query}"), accept);
            first.push(1e3 * met.first.as_secs_f64());
            last.push(1e3 * met.last.as_secs_f64());
            length = met.bytes;
        }
        let span = |times: &[f64]| {
            let (least, most) = times.iter().fold((f64::MAX, 0.0_f64), |(a, b), t| (a.min(*t), b.max(*t)));
            format!("{least:.1} - {most:.1}")
        };
        println!("{:<52} {length:>10} {:>16} {:>16}", format!("{accept} {query}"), span(&first), span(&last));
    }
    println!("front after these: {} MiB", server.resident_kib() >> 10);

    let readers: Vec<_> = (0..SLOW_READERS).map(|_| ask(&server.address, &format!("{path}/results"), "*/*")).collect();
    let (mut most, begun) = (0, Instant::now());
    let mut readers: Vec<_> = readers.into_iter().map(|reader| (reader, vec![0; 4096])).collect();
    while begun.elapsed() < Duration::from_secs(20) {
        for (reader, piece) in &mut readers {
            // Each slow reader reads a few bytes now and then, since the service disconnects a client that reads
            // nothing.
            let _ = reader.read(piece);
        }
        most = most.max(server.resident_kib());
        thread::sleep(Duration::from_millis(50));
    }
    let begun = Instant::now();
    assert_eq!(server.get(&format!("{path}/results?every=1000")).status, 200);
    let beside = 1e3 * begun.elapsed().as_secs_f64();
    println!("{SLOW_READERS} slow readers: front at most {} MiB; an excerpt beside them in {beside:.1} ms", most >> 10);
    drop(readers);

    let begun = Instant::now();
    let further =
        server.send("POST", &format!("{path}/continue"), "content-type: application/json\r\n", r#"{"end": 1.5}"#);
    assert_eq!(further.status, 202, "{}", further.body);
    println!("continued in {:.1} ms", 1e3 * begun.elapsed().as_secs_f64());
}

/// Times to the first and to the last byte of a response, and its size in bytes.
struct Met {
    first: Duration,
    last: Duration,
    bytes: usize,
}

fn ask(address: &str, path: &str, accept: &str) -> TcpStream {
    let mut stream = TcpStream::connect(address).expect("a connection");
    write!(stream, "GET {path} HTTP/1.0\r\nhost: localhost\r\naccept: {accept}\r\n\r\n").expect("a request");
    stream
}

fn get(address: &str, path: &str, accept: &str) -> Met {
    let begun = Instant::now();
    let mut stream = ask(address, path, accept);
    let mut piece = vec![0; 1 << 20];
    let mut bytes = stream.read(&mut piece).expect("an answer");
    assert!(piece.starts_with(b"HTTP/1.0 200") || piece.starts_with(b"HTTP/1.1 200"), "{path}");
    let first = begun.elapsed();
    loop {
        match stream.read(&mut piece).expect("an answer") {
            0 => return Met { first, last: begun.elapsed(), bytes },
            count => bytes += count,
        }
    }
}
