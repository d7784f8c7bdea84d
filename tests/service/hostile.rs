//! Hostile clients of the service as a process: each of their requests is answered or its connection closed, and the
//! service keeps serving other clients.

use crate::harness::DECAY;
use crate::process::{Folder, Server};
use std::fs;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::Duration;

/// Returns the number of connections that the test opens: as many as it needs, or as the limit of open files permits.
fn most_connections() -> usize {
    let limits = fs::read_to_string("/proc/self/limits").unwrap();
    let files = limits.lines().find_map(|line| line.strip_prefix("Max open files")).unwrap();
    let soft: usize = files.split_whitespace().next().unwrap().parse().unwrap_or(usize::MAX);
    10_000.min(soft - 256)
}

#[track_caller]
fn assert_well(server: &Server) {
    assert_eq!(server.get("/readyz").status, 200);
    let answer = server.send("POST", "/solve", "", DECAY);
    assert_eq!((answer.status, &answer.json()["status"]), (200, &"completed".into()), "{}", answer.body);
}

/// Sends bytes to the service unchanged, and returns what the service sends until it closes the connection.
fn exchange(server: &Server, bytes: &[u8]) -> String {
    let mut stream = TcpStream::connect(server.address()).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    // The service may refuse a client early and close the connection while the client still writes.
    let _ = stream.write_all(bytes);
    read(&mut stream)
}

fn read(stream: &mut TcpStream) -> String {
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

#[test]
fn ten_thousand_idle_connections_leave_the_service_to_others() {
    let server = Server::start(&Folder::new(), &["--ephemeral", "--workers", "1"]);
    assert_well(&server);
    let before = server.resident_kib();
    let idle: Vec<TcpStream> = (0..most_connections()).map(|_| TcpStream::connect(server.address()).unwrap()).collect();
    assert_well(&server);
    let each = (server.resident_kib() - before) / idle.len() as u64;
    assert!(each < 32, "a connection that says nothing takes {each} KiB");
    drop(idle);
    assert_well(&server);
}

#[test]
fn half_a_request_from_many_clients_keeps_nobody_else_waiting() {
    let server = Server::start(&Folder::new(), &["--ephemeral", "--workers", "1"]);
    let halves: [&[u8]; 3] = [
        b"POST /solve HT",
        b"GET /jobs HTTP/1.1\r\nhost: localhost\r\nx-slow: ",
        b"POST /solve HTTP/1.1\r\nhost: localhost\r\ncontent-length: 8388608\r\n\r\n{",
    ];
    let slow: Vec<TcpStream> = (0..300)
        .map(|k| {
            let mut stream = TcpStream::connect(server.address()).unwrap();
            stream.write_all(halves[k % halves.len()]).unwrap();
            stream
        })
        .collect();
    assert_well(&server);
    drop(slow);
}

#[test]
fn a_client_that_closes_its_half_has_gone_and_its_solve_with_it() {
    let server = Server::start(&Folder::new(), &["--ephemeral", "--workers", "1"]);
    let endless = DECAY.replace("\"end\":1", "\"end\":1e9").replace("-x", "cos(1000*t)");
    let head = format!("POST /solve HTTP/1.1\r\nhost: localhost\r\ncontent-length: {}\r\n\r\n", endless.len());
    let mut stream = TcpStream::connect(server.address()).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    stream.write_all(format!("{head}{endless}").as_bytes()).unwrap();
    while !server.get("/metrics").body.contains("dvi_jobs_running 1\n") {
        std::thread::sleep(Duration::from_millis(5));
    }
    // The service cannot distinguish a connection that its client has closed for writing from one that is closed
    // entirely.
    stream.shutdown(Shutdown::Write).unwrap();
    assert_eq!(read(&mut stream), "");
    assert_well(&server);
}

#[test]
fn headers_without_measure_are_refused() {
    let server = Server::start(&Folder::new(), &["--ephemeral", "--read-seconds", "1"]);
    let many: String = (0..10_000).map(|k| format!("x-{k}: 1\r\n")).collect();
    for headers in [format!("x-long: {}\r\n", "a".repeat(4 << 20)), many] {
        let answer = exchange(&server, format!("GET /healthz HTTP/1.1\r\nhost: localhost\r\n{headers}\r\n").as_bytes());
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 431"), "{answer}");
    }
    let address = format!("GET /{} HTTP/1.1\r\nhost: localhost\r\n\r\n", "a".repeat(1 << 20));
    let answer = exchange(&server, address.as_bytes());
    assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 4"), "{answer}");
    assert_well(&server);
}

#[test]
fn what_is_no_http_is_refused() {
    let server = Server::start(&Folder::new(), &["--ephemeral", "--read-seconds", "1"]);
    let requests: [&[u8]; 6] = [
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"\0\0\0\0\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"POST /solve HTTP/1.1\r\nhost: localhost\r\ncontent-length: -1\r\n\r\n",
        b"POST /solve HTTP/1.1\r\nhost: localhost\r\ncontent-length: 5\r\ncontent-length: 6\r\n\r\n{}",
        b"POST /solve HTTP/1.1\r\nhost: localhost\r\ntransfer-encoding: chunked\r\n\r\nzz\r\n",
    ];
    for request in requests {
        let answer = exchange(&server, request);
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 4"), "{answer}");
    }
    assert_well(&server);
}

#[test]
fn no_path_leads_out_of_what_is_served() {
    let server = Server::start(&Folder::new(), &["--ephemeral"]);
    for path in [
        "/../../../../etc/passwd",
        "/page/../../../../../etc/passwd",
        "/page/..%2f..%2f..%2fetc%2fpasswd",
        "/page/%2e%2e/%2e%2e/Cargo.toml",
        "/page//etc/passwd",
        "//etc/passwd",
        "/examples/..%2fspecification.schema",
        "/problems/%00",
        "/jobs/%c0%ae%c0%ae",
        "http://localhost/etc/passwd",
        "*",
    ] {
        let answer = exchange(
            &server,
            format!("GET {path} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n").as_bytes(),
        );
        assert!(answer.starts_with("HTTP/1.1 4") && !answer.contains("root:"), "{path}: {answer}");
    }
    assert_well(&server);
}

#[test]
fn depth_without_end_is_an_error_of_the_specification() {
    let server = Server::start(&Folder::new(), &["--ephemeral"]);
    let in_a_rate = |rate: &str| DECAY.replace("-x", rate);
    let n = 1 << 20;
    for document in [
        "[".repeat(n),
        "{\"a\":".repeat(n),
        in_a_rate(&"(".repeat(n)),
        in_a_rate(&format!("{}x{}", "(".repeat(n), ")".repeat(n))),
        in_a_rate(&format!("{}x", "-".repeat(n))),
        in_a_rate(&format!("{}x{}", "sin(".repeat(n), ")".repeat(n))),
        in_a_rate(&format!("x{}", "^x".repeat(n))),
    ] {
        for path in ["/check", "/solve"] {
            server.send("POST", path, "", &document).problem(400, "invalid-specification");
        }
    }
    assert_well(&server);
}

#[test]
fn a_request_names_one_host_and_that_is_this_service() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--host", "dvi.example"]);
    let ask = |path: &str, hosts: &str| {
        exchange(&server, format!("GET {path} HTTP/1.1\r\n{hosts}connection: close\r\n\r\n").as_bytes())
    };
    for hosts in ["", "host: localhost\r\nhost: localhost\r\n"] {
        let answer = ask("/healthz", hosts);
        assert!(answer.starts_with("HTTP/1.1 400 ") && answer.contains("/problems/bad-host"), "{answer}");
    }
    let foreign = "host: evil.example:8080\r\nsec-fetch-site: same-origin\r\n";
    for path in ["/jobs", "/", "/schema"] {
        let answer = ask(path, foreign);
        assert!(answer.starts_with("HTTP/1.1 421 ") && answer.contains("--host evil.example"), "{answer}");
    }
    for path in ["/healthz", "/readyz", "/metrics"] {
        assert!(ask(path, foreign).starts_with("HTTP/1.1 200 "), "{path}");
    }
    let own = format!("host: {}\r\n", server.address());
    for host in ["host: localhost:9\r\n", "host: [::1]\r\n", "host: DVI.example\r\n", &own] {
        assert!(ask("/jobs", host).starts_with("HTTP/1.1 200 "), "{host}");
    }
}
