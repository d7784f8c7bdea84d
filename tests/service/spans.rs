//! Spans of requests and jobs, as an OpenTelemetry collector receives them.

use crate::harness::DECAY;
use crate::process::{DVI, Folder, Server};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::thread;

/// A collector of spans that accepts and stores all requests.
struct Collector {
    address: String,
    /// The path and the body of every request that the collector has received.
    taken: Arc<Mutex<Vec<(String, Vec<u8>)>>>,
}

impl Collector {
    fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("http://{}", listener.local_addr().unwrap());
        let taken = Arc::new(Mutex::new(Vec::new()));
        let keeps = Arc::clone(&taken);
        thread::spawn(move || {
            for stream in listener.incoming() {
                let keeps = Arc::clone(&keeps);
                thread::spawn(move || {
                    while let Some(request) = take(stream.as_ref().unwrap()) {
                        keeps.lock().unwrap().push(request);
                    }
                });
            }
        });
        Self { address, taken }
    }

    /// Returns the number of received requests whose body contains the given bytes.
    fn with(&self, bytes: &[u8]) -> usize {
        let taken = self.taken.lock().unwrap();
        taken.iter().filter(|(_, body)| body.windows(bytes.len()).any(|part| part == bytes)).count()
    }
}

/// Reads a request, responds with success, and returns its path and body.
fn take(mut stream: &TcpStream) -> Option<(String, Vec<u8>)> {
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        let mut byte = [0];
        stream.read_exact(&mut byte).ok()?;
        head.push(byte[0]);
    }
    let head = String::from_utf8(head).unwrap().to_lowercase();
    let length = head.lines().find_map(|line| line.strip_prefix("content-length: ")).unwrap().parse().unwrap();
    let mut body = vec![0; length];
    stream.read_exact(&mut body).ok()?;
    stream.write_all(b"HTTP/1.1 200 OK\r\ncontent-type: application/x-protobuf\r\ncontent-length: 0\r\n\r\n").ok()?;
    Some((head.split(' ').nth(1).unwrap().to_owned(), body))
}

#[test]
fn a_collector_gets_the_spans_of_a_request_and_its_job_in_the_trace_of_the_client() {
    let (collector, folder) = (Collector::start(), Folder::new());
    let mut command = Command::new(DVI);
    command.args(["serve", "--listen", "127.0.0.1:0", "--log-format", "json", "--data"]).arg(folder.path());
    command.env("OTEL_EXPORTER_OTLP_ENDPOINT", &collector.address).env("OTEL_SERVICE_NAME", "our-solver");
    let server = Server::of(&mut command).unwrap();
    let (trace, parent) = (0x4bf9_2f35_77b3_4da6_a3ce_929d_0e0e_4736_u128, 0x00f0_67aa_0ba9_02b7_u64);
    let headers = format!("prefer: respond-async\r\ntraceparent: 00-{trace:032x}-{parent:016x}-01\r\n");
    let answer = server.send("POST", "/solve", &headers, DECAY);
    assert_eq!(answer.status, 202, "{answer:?}");
    server.reaches(&answer.header("location"), &["successful"]);
    // The response names the span of its request, which is the parent of the span of the job.
    let given = answer.header("traceparent");
    let span = u64::from_str_radix(given.split('-').nth(2).unwrap(), 16).unwrap();
    assert!(given.contains(&format!("{trace:032x}")) && span != parent, "{given}");
    // A request that names no trace begins a new one.
    assert_eq!(server.get("/version").header("traceparent").len(), given.len());
    let (status, told) = server.stop();
    assert!(status.success(), "{told}");
    let taken = collector.taken.lock().unwrap().clone();
    assert!(!taken.is_empty(), "{told}");
    assert!(taken.iter().all(|(path, _)| path == "/v1/traces"), "{taken:?}");
    for bytes in
        [&trace.to_be_bytes()[..], &parent.to_be_bytes(), &span.to_be_bytes(), b"our-solver", b"request", b"job.id"]
    {
        assert!(collector.with(bytes) > 0, "no {bytes:?} in {taken:?}");
    }
    assert_eq!(collector.with(b"hyper"), 0, "spans of libraries");
}
