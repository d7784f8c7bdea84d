//! The service as a process that is used over HTTP, and restarted on the same folder.

use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

/// Path of the program `dvi`.
pub const DVI: &str = env!("CARGO_BIN_EXE_dvi");

/// Time limit of a response, longer than any response takes on a busy machine.
pub const RESPONSE_TIMEOUT: Duration = Duration::from_secs(60);

/// A temporary folder, removed when it is dropped.
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

/// A running `dvi serve`, killed when it is dropped.
pub struct Server {
    pub child: Child,
    pub address: String,
    /// The limits that the operating system enforces on the workers, according to the log of the service.
    pub confined_to: String,
    /// The log of the service up to the line that reports the address.
    pub beginning: String,
    pub log: BufReader<ChildStderr>,
}

impl Server {
    /// Starts the service on `folder`, with further arguments.
    pub fn start(folder: &Folder, arguments: &[&str]) -> Self {
        Self::start_at("127.0.0.1:0", folder, arguments)
    }

    /// Starts the service on `folder`, listening on `listen`.
    pub fn start_at(listen: &str, folder: &Folder, arguments: &[&str]) -> Self {
        Self::try_start_at(listen, folder, arguments).unwrap_or_else(|told| panic!("no service: {told}"))
    }

    /// Starts the service on `folder`, or returns its log if it has ended.
    pub fn try_start_at(listen: &str, folder: &Folder, arguments: &[&str]) -> Result<Self, String> {
        let mut command = Command::new(DVI);
        command.args(["serve", "--listen", listen, "--log-format", "json", "--data"]).arg(folder.path());
        Self::of(command.args(arguments))
    }

    /// Starts the service with `command`, or returns its log if it has ended.
    pub fn of(command: &mut Command) -> Result<Self, String> {
        // The log lines of requests are switched off: they would fill the pipe of the log, which is not read.
        command.env("RUST_LOG", "info,dvi::request=off,dvi::job=off");
        let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
        let log = BufReader::new(child.stderr.take().unwrap());
        let mut server =
            Self { child, address: String::new(), confined_to: String::new(), beginning: String::new(), log };
        let mut told = String::new();
        while server.address.is_empty() {
            let before = told.len();
            if server.log.read_line(&mut told).unwrap() == 0 {
                return Err(told);
            }
            // Messages that the Rust runtime prints before an abort are not JSON, and are skipped.
            let Ok(entry) = serde_json::from_str::<Value>(&told[before..]) else { continue };
            let field = |name: &str| entry["fields"][name].as_str().unwrap_or_default().to_owned();
            (server.address, server.confined_to) = (field("address"), field("confined_to"));
        }
        server.beginning = told;
        Ok(server)
    }

    /// Returns the resident memory of the service, in KiB.
    pub fn resident_kib(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
        line.trim_end_matches("kB").trim().parse().unwrap()
    }

    /// Sends a request, and returns the response; `None` if the service disconnected.
    pub fn try_send(&self, method: &str, path: &str, headers: &str, body: &str) -> Option<Answer> {
        send(&self.address, method, path, headers, body)
    }

    pub fn send(&self, method: &str, path: &str, headers: &str, body: &str) -> Answer {
        self.try_send(method, path, headers, body).expect("an answer")
    }

    pub fn get(&self, path: &str) -> Answer {
        self.send("GET", path, "", "")
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Sends a request to the service at `address`, and returns the response; `None` if the service disconnected. The
/// request is HTTP/1.0, so that the body comes in one piece.
pub fn send(address: &str, method: &str, path: &str, headers: &str, body: &str) -> Option<Answer> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(RESPONSE_TIMEOUT)).unwrap();
    let length = body.len();
    let head = format!("{method} {path} HTTP/1.0\r\nhost: localhost\r\n{headers}");
    write!(stream, "{head}content-length: {length}\r\n\r\n{body}").ok()?;
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).ok()?;
    let text = String::from_utf8(bytes).ok()?;
    let (head, body) = text.split_once("\r\n\r\n")?;
    let status = head.split(' ').nth(1)?.parse().ok()?;
    let answer = Answer { status, head: head.to_owned(), body: body.to_owned() };
    answer.is_whole().then_some(answer)
}

/// An HTTP response, read to its end.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    head: String,
    pub body: String,
}

impl Answer {
    /// Whether the body has the length that the response header announced; true if it announced none.
    fn is_whole(&self) -> bool {
        let announced = self.field("content-length").and_then(|length| length.parse().ok());
        announced.is_none_or(|length: usize| length == self.body.len())
    }

    /// Returns the value of a header field of the response.
    pub fn field(&self, name: &str) -> Option<&str> {
        let lines = self.head.lines().filter_map(|line| line.split_once(": "));
        lines.filter(|(key, _)| key.eq_ignore_ascii_case(name)).map(|(_, value)| value).next()
    }

    pub fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error} in {self:?}"))
    }
}
