//! The program as a process that can be met over HTTP, killed, and started again on the same folder.

use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, ExitStatus, Output, Stdio};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

/// The program.
pub const DVI: &str = env!("CARGO_BIN_EXE_dvi");

/// Longer than any answer takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// A folder of its own, removed at the end.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new() -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let name = format!("dvi-test-{}-{}", std::process::id(), NEXT.fetch_add(1, Relaxed));
        Self(std::env::temp_dir().join(name))
    }

    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A running `dvi serve`, killed at the end if it still runs.
pub struct Server {
    child: Child,
    address: String,
    log: BufReader<ChildStderr>,
}

impl Server {
    /// Starts on `folder`, with more arguments.
    pub fn start(folder: &Folder, arguments: &[&str]) -> Self {
        Self::start_at("127.0.0.1:0", folder, arguments)
    }

    /// The same, to listen on `listen`.
    pub fn start_at(listen: &str, folder: &Folder, arguments: &[&str]) -> Self {
        let mut child = Command::new(DVI)
            .args(["serve", "--listen", listen, "--log-format", "json", "--data"])
            .arg(folder.path())
            .args(arguments)
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let log = BufReader::new(child.stderr.take().unwrap());
        let mut server = Self { child, address: String::new(), log };
        let mut told = String::new();
        while server.address.is_empty() {
            let before = told.len();
            assert!(server.log.read_line(&mut told).unwrap() > 0, "no service: {told}");
            let entry: Value = serde_json::from_str(&told[before..]).unwrap();
            server.address = entry["fields"]["address"].as_str().unwrap_or_default().to_owned();
        }
        server
    }

    /// Where it listens.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// The memory that it holds.
    pub fn resident_kib(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
        line.trim_end_matches("kB").trim().parse().unwrap()
    }

    /// Ends it without a word, as a crash does.
    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Asks it to stop, and gives how it did and what it said.
    pub fn stop(mut self) -> (ExitStatus, String) {
        let sent = Command::new("kill").args(["-s", "TERM", &self.child.id().to_string()]).status().unwrap();
        assert!(sent.success());
        let mut told = String::new();
        self.log.read_to_string(&mut told).unwrap();
        (self.child.wait().unwrap(), told)
    }

    /// The answer to a request, or nothing if the server went away.
    pub fn try_send(&self, method: &str, path: &str, headers: &str, body: &str) -> Option<Answer> {
        send(&self.address, method, path, headers, body)
    }

    pub fn send(&self, method: &str, path: &str, headers: &str, body: &str) -> Answer {
        self.try_send(method, path, headers, body).expect("an answer")
    }

    pub fn get(&self, path: &str) -> Answer {
        self.send("GET", path, "", "")
    }

    /// Accepts `document` as an asynchronous job and gives its path.
    pub fn accept(&self, document: &str) -> String {
        let answer = self.send("POST", "/solve", "prefer: respond-async\r\n", document);
        assert_eq!(answer.status, 202, "{}", answer.body);
        answer.header("location")
    }

    /// The state of the job at `path`, as soon as it is one of these.
    pub fn reaches(&self, path: &str, states: &[&str]) -> Value {
        let start = Instant::now();
        loop {
            let state = self.get(path).json();
            if states.iter().any(|name| state["status"] == *name) {
                return state;
            }
            assert!(start.elapsed() < PATIENCE, "{states:?} is not reached: {state}");
            thread::sleep(Duration::from_millis(2));
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What `dvi token` says of `folder`.
pub fn dvi_token(folder: &Folder, arguments: &[&str]) -> Output {
    Command::new(DVI).arg("token").args(arguments).arg("--data").arg(folder.path()).output().unwrap()
}

/// The answer of the server at `address` to a request, or nothing if it went away. In HTTP/1.0, whose bodies come in one
/// piece.
pub fn send(address: &str, method: &str, path: &str, headers: &str, body: &str) -> Option<Answer> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let length = body.len();
    let head = format!("{method} {path} HTTP/1.0\r\nhost: localhost\r\n{headers}");
    write!(stream, "{head}content-length: {length}\r\n\r\n{body}").ok()?;
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).ok()?;
    let text = String::from_utf8(bytes).ok()?;
    let (head, body) = text.split_once("\r\n\r\n")?;
    let status = head.split(' ').nth(1)?.parse().ok()?;
    let announced = header(head, "content-length").and_then(|length| length.parse().ok());
    announced.is_none_or(|length: usize| length == body.len()).then(|| Answer {
        status,
        head: head.to_owned(),
        body: body.to_owned(),
    })
}

/// An answer, read to its end.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    head: String,
    pub body: String,
}

impl Answer {
    pub fn header(&self, name: &str) -> String {
        header(&self.head, name).unwrap_or_else(|| panic!("no {name} in {self:?}")).to_owned()
    }

    pub fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error} in {self:?}"))
    }

    /// Asserts that the answer is this problem.
    #[track_caller]
    pub fn problem(&self, status: u16, slug: &str) {
        assert_eq!((self.status, &self.json()["type"]), (status, &format!("/problems/{slug}").into()), "{self:?}");
    }
}

fn header<'a>(head: &'a str, name: &str) -> Option<&'a str> {
    let lines = head.lines().filter_map(|line| line.split_once(": "));
    lines.filter(|(key, _)| key.eq_ignore_ascii_case(name)).map(|(_, value)| value).next()
}
