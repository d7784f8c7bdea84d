//! Ten times more load than the service can handle, for a minute: `cargo bench --bench overload`; `SECONDS=5` sets
//! another time.
//!
//! `wrk` sends jobs of some milliseconds as fast as they are answered, and now and then a synchronous one. The
//! requirements: every response is a result, an acceptance, or a refusal with a time to retry; every accepted job is
//! solved; and the memory of the program does not grow. All but the last are asserted; the memory is printed during
//! the run.

use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

/// A script for `wrk` that prints the number of responses of each kind at its end.
const SCRIPT: &str = r#"
local turn, results, acceptances, refusals, others = 0, 0, 0, 0, 0
local body = '{"problem":{"dvi":{"states":{"x":{"initial":1,"rate":"-x + cos(300*t)"}}}},"time":{"end":10},"output":{"times":{"count":11}}}'
local function asking(prefer)
  return wrk.format("POST", "/solve", {["content-type"] = "application/json", ["prefer"] = prefer}, body)
end
function request()
  turn = turn + 1
  return asking(turn % 128 == 0 and "wait=1" or "respond-async")
end
function response(status, headers)
  if status == 200 then results = results + 1
  elseif status == 202 then acceptances = acceptances + 1
  elseif (status == 429 or status == 503) and tonumber(headers["retry-after"]) then refusals = refusals + 1
  else others = others + 1 end
  told = string.format("%d %d %d %d", results, acceptances, refusals, others)
end
local threads = {}
function setup(thread) table.insert(threads, thread) end
function done()
  for _, thread in ipairs(threads) do print("answers " .. thread:get("told")) end
end
"#;

fn main() {
    let seconds: u32 = std::env::var("SECONDS").ok().and_then(|text| text.parse().ok()).unwrap_or(60);
    let folder = std::env::temp_dir().join(format!("dvi-overload-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let script = folder.join("overload.lua");
    std::fs::write(&script, SCRIPT).expect("a script");
    let (server, address) = serve(&folder);
    let load = Command::new("wrk")
        .args(["-t1", "-c128", &format!("-d{seconds}s"), "-s"])
        .arg(&script)
        .arg(format!("http://{address}"))
        .stdout(Stdio::piped())
        .spawn()
        .expect("wrk, which is a Debian package");
    println!("{:>8} {:>10} {:>10}", "seconds", "MiB", "waiting");
    for second in 1..=seconds {
        thread::sleep(Duration::from_secs(1));
        if second % (seconds / 6).max(1) == 0 {
            println!("{second:>8} {:>10.1} {:>10}", resident(&server), figure(&address, "dvi_jobs_waiting"));
        }
    }
    let report = String::from_utf8(load.wait_with_output().expect("its end").stdout).expect("text");
    let (_, counts) = report.split_once("answers ").expect("a line of answers");
    let counts: Vec<f64> = counts.split_whitespace().take(4).map(|count| count.parse().expect("a count")).collect();
    let [results, acceptances, refusals, others] = counts[..] else { panic!("{report}") };
    println!("{results} results, {acceptances} acceptances, {refusals} refusals, {others} other answers");
    assert_eq!(others, 0.0, "{report}");
    assert!(refusals >= 9.0 * (results + acceptances), "the service could do more than a tenth of it");

    while figure(&address, "dvi_jobs_waiting") + figure(&address, "dvi_jobs_running") > 0.0 {
        thread::sleep(Duration::from_millis(100));
    }
    let solved = figure(&address, "dvi_solves_total{problem=\"dvi\",code=\"completed\"}");
    println!("{solved} solves; {:.1} MiB at the end", resident(&server));
    assert!(solved >= results + acceptances, "an accepted job was not solved");
    assert_ended(&address);
    stop(server);
    // If the data folder cannot be removed, it is left among the temporary files.
    let _ = std::fs::remove_dir_all(folder);
}

/// Asserts that every known job has been solved, or was dismissed because `wrk` disconnected at its end.
fn assert_ended(address: &str) {
    let mut path = "/jobs?limit=1000".to_owned();
    loop {
        let (head, body) = get(address, &path);
        let jobs: Value = serde_json::from_str(&body).expect("a list");
        for job in jobs["jobs"].as_array().expect("jobs") {
            assert!(matches!(job["status"].as_str(), Some("successful" | "dismissed")), "{job}");
        }
        let next = head.lines().find_map(|line| line.strip_prefix("link: <")?.split_once('>'));
        let Some((next, _)) = next else { return };
        path = next.to_owned();
    }
}

/// The service process, which is killed when it is dropped.
struct Server(Child);

impl Drop for Server {
    fn drop(&mut self) {
        // Killing fails if the program has ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn serve(folder: &Path) -> (Server, String) {
    let mut server = Command::new(env!("CARGO_BIN_EXE_dvi"))
        .args(["serve", "--listen", "127.0.0.1:0", "--log-format", "json", "--kept-jobs", "1000", "--data"])
        .arg(folder)
        .env("RUST_LOG", "info,dvi::request=off,dvi::job=off")
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program");
    let mut line = String::new();
    let mut log = BufReader::new(server.stderr.take().expect("its log"));
    log.read_line(&mut line).expect("a line");
    thread::spawn(move || log.lines().map_while(Result::ok).for_each(|line| eprintln!("{line}")));
    let entry: Value = serde_json::from_str(&line).expect("an entry");
    (Server(server), entry["fields"]["address"].as_str().expect("an address").to_owned())
}

fn stop(mut server: Server) {
    let asked = Command::new("kill").args(["-s", "TERM", &server.0.id().to_string()]).status().expect("kill");
    assert!(asked.success() && server.0.wait().expect("its end").success());
}

/// Returns the resident memory of the program, in MiB.
fn resident(server: &Server) -> f64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", server.0.id())).expect("Linux");
    let kib = status.lines().find_map(|line| line.strip_prefix("VmRSS:")?.split_whitespace().next()?.parse().ok());
    kib.map_or(f64::NAN, |kib: f64| kib / 1024.0)
}

/// Returns the value of a metric from `GET /metrics`, zero if it has not been counted yet.
fn figure(address: &str, name: &str) -> f64 {
    let (_, text) = get(address, "/metrics");
    let value = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' ')?.parse().ok());
    value.unwrap_or(0.0)
}

fn get(address: &str, path: &str) -> (String, String) {
    let mut stream = TcpStream::connect(address).expect("a connection");
    write!(stream, "GET {path} HTTP/1.0\r\nhost: {address}\r\n\r\n").expect("a request");
    let mut text = String::new();
    stream.read_to_string(&mut text).expect("an answer");
    let (head, body) = text.split_once("\r\n\r\n").expect("an answer");
    (head.to_owned(), body.to_owned())
}
