//! A NATS server for tests, and worker processes that solve its jobs.

use std::io::ErrorKind;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use std::{fs, thread};

/// Whether a NATS server is installed; prints a message if it is not.
pub fn is_installed() -> bool {
    match Command::new("nats-server").arg("--version").stdout(Stdio::null()).status() {
        Ok(_) => true,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            eprintln!("skipped: nats-server is not installed (Debian: apt-get install nats-server)");
            false
        }
        Err(error) => panic!("nats-server: {error}"),
    }
}

/// A NATS server that ends with its test. It keeps its port when the test starts it again.
pub struct NatsServer {
    folder: PathBuf,
    /// A shell that ends the server when its own standard input is closed, which happens when the test process ends
    /// in any way.
    keeper: Option<Child>,
    port: u16,
    /// Further command-line arguments of the server, which make it a member of a cluster.
    more: Vec<String>,
}

impl NatsServer {
    /// Starts a NATS server that keeps its data in `folder`.
    pub fn start(folder: &Path) -> Self {
        let mut server = Self::begun(folder, Vec::new());
        server.await_port();
        server
    }

    /// Starts a cluster of `servers` servers, each of which keeps its data in its own subfolder of `folder`.
    pub fn start_cluster(folder: &Path, servers: usize) -> Vec<Self> {
        // Ports are tried below the range from which systems assign ports to clients.
        let first = std::process::id() % 10_000;
        let ports = (0..10_000).map(|k| 20_000 + ((first + k) % 10_000) as u16);
        let free = ports.filter(|port| TcpListener::bind(("127.0.0.1", *port)).is_ok());
        let routes: Vec<String> = free.take(servers).map(|port| format!("nats://127.0.0.1:{port}")).collect();
        let one = |(k, route): (usize, &String)| {
            let name = format!("server{k}");
            let folder = folder.join(&name);
            let joined = routes.join(",");
            let more = ["-n", &name, "--cluster_name", "dvi", "--cluster", route, "--routes", &joined];
            Self::begun(&folder, more.map(str::to_owned).to_vec())
        };
        // A server of a cluster is ready only when it is connected to the others: start all before waiting for any.
        let mut begun: Vec<Self> = routes.iter().enumerate().map(one).collect();
        begun.iter_mut().for_each(Self::await_port);
        begun
    }

    fn begun(folder: &Path, more: Vec<String>) -> Self {
        let _ = fs::remove_dir_all(folder);
        fs::create_dir_all(folder).unwrap();
        let mut server = Self { folder: folder.to_owned(), keeper: None, port: 0, more };
        server.run("-1");
        server
    }

    fn await_port(&mut self) {
        let start = Instant::now();
        self.port = loop {
            if let Some(port) = self.told_port() {
                break port;
            }
            assert!(start.elapsed() < Duration::from_secs(30), "the NATS server does not tell its port");
            thread::sleep(Duration::from_millis(5));
        };
    }

    fn run(&mut self, port: &str) {
        let script = "port=$1; data=$2; shift 2; \
                      nats-server -a 127.0.0.1 -p \"$port\" -js -sd \"$data\" --ports_file_dir \"$data\" -l \"$data/log\" \"$@\" & \
                      read line; kill -9 $!";
        let keeper = Command::new("sh")
            .args(["-c", script, "sh", port])
            .arg(&self.folder)
            .args(&self.more)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn();
        self.keeper = Some(keeper.unwrap());
    }

    fn told_port(&self) -> Option<u16> {
        let mut files = fs::read_dir(&self.folder).ok()?.filter_map(Result::ok);
        let file = files.find(|file| file.file_name().to_string_lossy().ends_with(".ports"))?;
        let told: serde_json::Value = serde_json::from_slice(&fs::read(file.path()).ok()?).ok()?;
        told["nats"][0].as_str()?.rsplit(':').next()?.parse().ok()
    }

    /// Kills the NATS server, as `kill -9` does.
    pub fn kill(&mut self) {
        if let Some(mut keeper) = self.keeper.take() {
            drop(keeper.stdin.take());
            keeper.wait().unwrap();
        }
    }

    /// Starts the NATS server again, with its data and its port.
    pub fn restart(&mut self) {
        self.run(&self.port.to_string());
    }

    /// Returns the URL of the NATS server.
    pub fn url(&self) -> String {
        format!("nats://127.0.0.1:{}", self.port)
    }
}

impl Drop for NatsServer {
    fn drop(&mut self) {
        self.kill();
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// A running `dvi worker` over NATS with one solver process, killed when it is dropped.
pub struct Worker(pub Child);

impl Worker {
    /// Starts a worker process with further command-line arguments.
    pub fn start(url: &str, arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_dvi"));
        command.args(["worker", "--nats", url, "--workers", "1"]).args(arguments);
        Self(command.stdin(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
