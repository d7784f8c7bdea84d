//! A NATS server for tests, and sites that share their jobs over it.

use crate::harness::threads;
use dvi::service::jobs::{Nats, Solver, WorkOptions, work};
use dvi::service::{Options, Service};
use std::cell::Cell;
use std::io::ErrorKind;
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};
use std::{fs, thread};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::mpsc::{Sender, channel};

thread_local! {
    /// Whether sites that this thread makes share their jobs over NATS.
    static SHARED: Cell<bool> = const { Cell::new(false) };
}

/// Tests of what clients see, each of a service on one machine and of a gateway with a worker. Each test has a runtime and a
/// thread of its own.
macro_rules! on_both {
    ($($test:ident),* $(,)?) => {
        mod here {
            $(#[tokio::test]
            async fn $test() {
                super::$test().await;
            })*
        }

        mod over_nats {
            $(#[tokio::test]
            async fn $test() {
                if $crate::nats::is_installed() {
                    $crate::nats::share();
                    super::$test().await;
                }
            })*
        }
    };
}
pub(crate) use on_both;

/// Lets sites that this thread makes share their jobs over NATS.
pub fn share() {
    SHARED.set(true);
}

/// Whether sites that this thread makes share their jobs over NATS.
pub fn is_shared() -> bool {
    SHARED.get()
}

/// Whether there is a NATS server; says so if there is none.
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

/// A NATS server of a test, which ends with the test. Its port stays the same when it starts again.
pub struct NatsServer {
    folder: PathBuf,
    /// Ends its child when its standard input is closed, as it is when this process ends in whatever way.
    keeper: Option<Child>,
    port: u16,
}

impl NatsServer {
    /// Starts a server that keeps its data in `folder`.
    pub fn start(folder: &Path) -> Self {
        let _ = fs::remove_dir_all(folder);
        fs::create_dir_all(folder).unwrap();
        let mut server = Self { folder: folder.to_owned(), keeper: None, port: 0 };
        server.run("-1");
        let start = Instant::now();
        server.port = loop {
            if let Some(port) = server.told_port() {
                break port;
            }
            assert!(start.elapsed() < Duration::from_secs(30), "the NATS server does not tell its port");
            thread::sleep(Duration::from_millis(5));
        };
        server
    }

    fn run(&mut self, port: &str) {
        let script = "nats-server -a 127.0.0.1 -p \"$1\" -js -sd \"$2\" --ports_file_dir \"$2\" -l \"$2/log\" & \
                      read line; kill -9 $!";
        let keeper = Command::new("sh")
            .args(["-c", script, "sh", port])
            .arg(&self.folder)
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

    /// Kills the server, as `kill -9` does.
    pub fn kill(&mut self) {
        if let Some(mut keeper) = self.keeper.take() {
            drop(keeper.stdin.take());
            keeper.wait().unwrap();
        }
    }

    /// Starts the server again, with its data and its port.
    pub fn restart(&mut self) {
        self.run(&self.port.to_string());
    }

    /// Its address.
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

/// The runtime of the connections of sites: that of a test has one thread, which waits when a site is made.
pub fn runtime() -> &'static Runtime {
    static RUNTIME: OnceLock<Runtime> = OnceLock::new();
    RUNTIME.get_or_init(|| Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap())
}

/// The server that tests of this process share, each under a name of its own.
fn url() -> String {
    static SERVER: OnceLock<NatsServer> = OnceLock::new();
    let folder = std::env::temp_dir().join(format!("dvi-nats-{}", std::process::id()));
    SERVER.get_or_init(|| NatsServer::start(&folder)).url()
}

/// Options for a name on the shared server that nobody else has.
pub fn anew() -> Nats {
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    let name = format!("t{}", COUNT.fetch_add(1, Relaxed));
    Nats { servers: vec![url()], name, lost_seconds: NonZeroU64::new(2).unwrap(), ..Nats::default() }
}

/// Runs `future` on the runtime of connections, and waits for it.
pub fn wait_for<T: Send + 'static>(future: impl Future<Output = T> + Send + 'static) -> T {
    let (done, is_done) = std::sync::mpsc::channel();
    runtime().spawn(async move {
        let _ = done.send(future.await);
    });
    is_done.recv().unwrap()
}

/// A gateway on the servers of `options`.
pub fn gateway(options: Options, solver: Solver) -> Service {
    let launcher = threads(Arc::clone(&solver));
    wait_for(async move { Service::join(options, solver, &launcher).await.unwrap() })
}

/// A worker, which stops in order when it is dropped.
pub struct Worker {
    _stop: Sender<()>,
}

/// A worker on the servers of `options`, with as many places.
pub fn worker(options: &Options, solver: Solver) -> Worker {
    let Options { nats, workers, wall_seconds, steps, result_mib, memory_mib, .. } = options.clone();
    let options =
        WorkOptions { nats, workers, wall_seconds, steps, result_mib, grace_seconds: 0, ..WorkOptions::default() };
    let (stop, stopped) = channel(2);
    runtime().spawn(async move {
        let launcher = threads(Arc::clone(&solver));
        work(options, memory_mib, solver, &launcher, stopped).await.unwrap();
    });
    Worker { _stop: stop }
}
