//! Throughput of the service, compared with an HTTP echo of the same body: `cargo bench --bench overhead`, which
//! measures both alternately with `wrk`, so that both see the same load of the machine. A *repeated* text gets its
//! stored solution; a *solve* of the text is computed inline, as `Cache-Control: no-cache` asks; *other* texts have
//! other parameter values in a structure seen before; *new* texts have to be compiled; *queued* texts have an
//! idempotency key, so that they go through the queue; *stored* jobs are asynchronous, and on the disk before the
//! response. *Flush* is the upper bound set by one disk flush per group of stored jobs, one job of each connection:
//! their bytes are repeatedly appended to a file and synced.
//!
//! *Unlogged* is a solve without its log lines. Words after `--` select among these, and numbers select the numbers
//! of connections.

use axum::Router;
use axum::body::Bytes;
use axum::routing::post;
use dvi::service::worker::program;
use dvi::service::{Log, Options, PlainFields, Service};
use hyper::body::Incoming;
use hyper::service::service_fn;
use hyper_util::rt::TokioIo;
use mimalloc::MiMalloc;
use std::io::Write;
use std::net::SocketAddr;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Instant;
use tokio::net::TcpListener;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::mpsc::channel;
use tower_service::Service as _;
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::reload;
use tracing_subscriber::util::SubscriberInitExt;

/// The memory allocator that the `dvi` program uses.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

const BODY: &str =
    r#"{"problem":{"dvi":{"parameters":{"k":1},"states":{"x":{"initial":1,"rate":"-k*x"}}}},"time":{"end":1}}"#;
const SECONDS: u32 = 3;
const ROUNDS: usize = 3;

/// A script for `wrk` that asks for a new solve with every request.
const ANEW: &str = "wrk.headers[\"cache-control\"] = \"no-cache\"\n";

/// A script for `wrk` with another parameter value in every request.
const OTHER: &str = r#"
local n = 0
request = function()
  n = n + 1
  return wrk.format(nil, nil, nil, (wrk.body:gsub('"k":1', '"k":1.' .. n)))
end"#;

/// A script for `wrk` with another rate expression in every request.
const NEW: &str = r#"
local n = 0
request = function()
  n = n + 1
  return wrk.format(nil, nil, nil, (wrk.body:gsub('k%*x', 'k*x*1.' .. n)))
end"#;

/// A script for `wrk` with a new idempotency key in every request.
const KEYS: &str = r#"
local run, n = os.time(), 0
request = function()
  n = n + 1
  wrk.headers["idempotency-key"] = run .. "-" .. n
  return wrk.format()
end"#;

fn main() {
    // Logs as the program does, so that the measurement includes the cost of logging.
    let log = Log::start(std::io::stderr()).expect("a thread");
    let (filter, logged) = reload::Layer::new(LevelFilter::INFO);
    let lines = tracing_subscriber::fmt::layer().with_writer(move || log.line()).with_ansi(false);
    let lines = lines.fmt_fields(PlainFields);
    tracing_subscriber::registry().with(filter).with(lines).init();
    let folder = std::env::temp_dir().join(format!("dvi-overhead-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let waits = script(&folder, "waits", "", "");
    let (solves, leaves) = (script(&folder, "solves", "", ANEW), script(&folder, "leaves", "respond-async", ANEW));
    let queues = script(&folder, "queues", "", &format!("{ANEW}{KEYS}"));
    let (others, news) = (script(&folder, "others", "", OTHER), script(&folder, "news", "", NEW));
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let (numbers, chosen): (Vec<_>, Vec<_>) = words.into_iter().partition(|word| word.parse::<u32>().is_ok());
    let runtime = Builder::new_multi_thread().enable_all().build().expect("a runtime");
    let (echo, (service, _)) = (start_echo(&runtime), start_service(&runtime, Options::default()));
    let many = NonZeroUsize::new(10_000_000).expect("more than one");
    let stored = Options { data: Some(folder.clone()), queue: many, client_share: many, ..Options::default() };
    let (store, jobs) = start_service(&runtime, stored);
    println!("{:>12} {:>8} {:>10} {:>12} {:>16}", "connections", "", "p50", "requests/s", "CPU us a request");
    let is_asked = |count: &u32| numbers.is_empty() || numbers.contains(&count.to_string());
    for connections in [1, 16, 64, 512].into_iter().filter(is_asked) {
        let turns = [
            ("echo", echo, &waits),
            ("repeated", service, &waits),
            ("solve", service, &solves),
            ("unlogged", service, &solves),
            ("other", service, &others),
            ("new", service, &news),
            ("queued", service, &queues),
            ("stored", store, &leaves),
        ];
        if chosen.is_empty() || chosen.iter().any(|word| word == "flush") {
            let (seconds, rate) = flushes(&folder, connections as usize);
            let p50 = format!("{:.2}ms", 1e3 * seconds);
            println!("{connections:>12} {:>8} {p50:>10} {rate:>12.0}", "flush");
        }
        let turns = turns.iter().filter(|(name, ..)| chosen.is_empty() || chosen.iter().any(|word| word == name));
        for (name, address, script) in (0..ROUNDS).flat_map(|_| turns.clone()) {
            let level = if *name == "unlogged" { LevelFilter::OFF } else { LevelFilter::INFO };
            logged.reload(level).expect("the log");
            let (before, start) = (cpu_seconds(), Instant::now());
            let report = Command::new("wrk")
                .args(["--latency", "-t1", &format!("-c{connections}"), &format!("-d{SECONDS}s")])
                .arg("-s")
                .arg(script)
                .arg(format!("http://{address}/solve"))
                .output()
                .expect("wrk, which is a Debian package");
            let report = String::from_utf8_lossy(&report.stdout).into_owned();
            let after = |label: &str| report.split_once(label)?.1.split_whitespace().next();
            let requests = report.split_once(" requests in").and_then(|(before, _)| before.split_whitespace().last());
            assert!(!report.contains("Non-2xx"), "{report}");
            let requests: f64 = requests.and_then(|count| count.parse().ok()).expect("a count of requests");
            let p50 = after("50%").unwrap_or("?");
            // Wait until all stored jobs have ended, so that the rate counts completed jobs.
            runtime.block_on(async {
                jobs.jobs().idle().await;
                jobs.jobs().flush().await;
            });
            let rate = requests / start.elapsed().as_secs_f64();
            let cpu = (cpu_seconds() - before) * 1e6 / requests;
            println!("{connections:>12} {name:>8} {p50:>10} {rate:>12.0} {cpu:>16.1}");
        }
    }
    // If the data folder cannot be removed, it is left among the temporary files.
    let _ = std::fs::remove_dir_all(folder);
    runtime.shutdown_background();
}

/// Writes a script for `wrk`, and returns its path.
fn script(folder: &Path, name: &str, prefer: &str, more: &str) -> PathBuf {
    let path = folder.join(name).with_extension("lua");
    let headers =
        format!("wrk.headers[\"content-type\"] = \"application/json\"\nwrk.headers[\"prefer\"] = \"{prefer}\"");
    std::fs::write(&path, format!("wrk.method = \"POST\"\nwrk.body = '{BODY}'\n{headers}\n{more}\n"))
        .expect("a script");
    path
}

/// Returns the seconds that a disk flush of `group` jobs takes, and the number of jobs per second that such flushes
/// permit.
fn flushes(folder: &Path, group: usize) -> (f64, f64) {
    let mut file = std::fs::File::create(folder.join("flushes")).expect("a file");
    // About as many bytes as the database rows and specifications of the jobs take.
    let bytes = vec![7; group * 1024];
    let (start, mut count) = (Instant::now(), 0_u32);
    while start.elapsed().as_secs() < u64::from(SECONDS) {
        file.write_all(&bytes).and_then(|()| file.sync_data()).expect("room on the disk");
        count += 1;
    }
    let seconds = start.elapsed().as_secs_f64() / f64::from(count);
    (seconds, group as f64 / seconds)
}

/// Returns the CPU time of this process and of its workers, which other load on the machine disturbs less than
/// elapsed time.
fn cpu_seconds() -> f64 {
    let own = std::process::id();
    let processes = std::fs::read_dir("/proc").expect("Linux").filter_map(Result::ok);
    let ticks = processes.filter_map(|process| {
        let stat = std::fs::read_to_string(process.path().join("stat")).ok()?;
        let fields: Vec<&str> = stat.rsplit(") ").next()?.split(' ').collect();
        let (name, parent) = (process.file_name(), fields.get(1)?.parse::<u32>().ok()?);
        let counts = parent == own || name.to_str()?.parse() == Ok(own);
        let ticks = || fields[11..13].iter().filter_map(|field| field.parse::<f64>().ok()).sum::<f64>();
        counts.then(ticks)
    });
    ticks.sum::<f64>() / 100.0
}

fn start_service(runtime: &Runtime, options: Options) -> (SocketAddr, Arc<Service>) {
    let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0")).expect("a port");
    let address = listener.local_addr().expect("its address");
    let launcher = program(Some(env!("CARGO_BIN_EXE_dvi").into()), options.memory_mib.get());
    let service = Arc::new(Service::start(options, Arc::new(dvi::solve), &launcher).expect("workers"));
    let serving = Arc::clone(&service);
    runtime.spawn(async move {
        let (_stop, stopped) = channel(1);
        serving.serve(listener, stopped).await;
    });
    (address, service)
}

fn start_echo(runtime: &Runtime) -> SocketAddr {
    let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0")).expect("a port");
    let address = listener.local_addr().expect("its address");
    let router = Router::new().route("/solve", post(async |body: Bytes| body));
    runtime.spawn(async move {
        while let Ok((stream, _)) = listener.accept().await {
            // A failure to set TCP_NODELAY would show when the connection is used.
            let _ = stream.set_nodelay(true);
            let router = router.clone();
            let service = service_fn(move |request: hyper::Request<Incoming>| router.clone().call(request));
            tokio::spawn(hyper::server::conn::http1::Builder::new().serve_connection(TokioIo::new(stream), service));
        }
    });
    address
}
