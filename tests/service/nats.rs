//! Gateways and workers for tests that share their jobs over a NATS server.

use crate::harness::threads;
pub use crate::nats_server::{NatsServer, is_installed};
use dvi::service::jobs::{Nats, Solver, WorkOptions, work};
use dvi::service::{Options, Service};
use std::cell::Cell;
use std::num::NonZeroU64;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, OnceLock};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::mpsc::{Sender, channel};

thread_local! {
    /// Whether the services under test (`Site`) that this thread creates share their jobs over NATS.
    static SHARED: Cell<bool> = const { Cell::new(false) };
}

/// Defines each of the given tests twice: with a service on one machine, and with a gateway and a worker over NATS.
/// Each test has its own runtime and thread.
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

/// Lets the services under test (`Site`) that this thread creates from now on share their jobs over NATS.
pub fn share() {
    SHARED.set(true);
}

/// Whether the services under test (`Site`) that this thread creates share their jobs over NATS.
pub fn is_shared() -> bool {
    SHARED.get()
}

/// Returns the runtime for connections to NATS. The runtime of a test cannot be used: it has a single thread, which
/// blocks while a service under test is created.
pub fn runtime() -> &'static Runtime {
    static RUNTIME: OnceLock<Runtime> = OnceLock::new();
    RUNTIME.get_or_init(|| Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap())
}

/// Returns the address of the NATS server that the tests of this process share; each test uses its own name for
/// streams.
fn url() -> String {
    static SERVER: OnceLock<NatsServer> = OnceLock::new();
    let folder = std::env::temp_dir().join(format!("dvi-nats-{}", std::process::id()));
    SERVER.get_or_init(|| NatsServer::start(&folder)).url()
}

/// Returns options for the shared NATS server with a name for streams that no other test uses.
pub fn anew() -> Nats {
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    let name = format!("t{}", COUNT.fetch_add(1, Relaxed));
    Nats { servers: vec![url()], name, lost_seconds: NonZeroU64::new(2).unwrap(), ..Nats::default() }
}

/// Runs `future` on the runtime for connections to NATS, and waits for its result.
pub fn wait_for<T: Send + 'static>(future: impl Future<Output = T> + Send + 'static) -> T {
    let (done, is_done) = std::sync::mpsc::channel();
    runtime().spawn(async move {
        let _ = done.send(future.await);
    });
    is_done.recv().unwrap()
}

/// Returns a gateway on the NATS servers of `options`.
pub fn gateway(options: Options, solver: Solver) -> Service {
    let launcher = threads(Arc::clone(&solver));
    wait_for(async move { Service::join(options, solver, &launcher).await.unwrap() })
}

/// A worker over NATS, which stops regularly when it is dropped.
pub struct Worker {
    _stop: Sender<()>,
}

/// Starts a worker on the NATS servers of `options`, with the number of workers in `options`.
pub fn worker(options: &Options, solver: Solver) -> Worker {
    worker_on(runtime(), options, solver)
}

/// Starts a worker on the given runtime; if the runtime is shut down, the worker is lost at once.
pub fn worker_on(runtime: &Runtime, options: &Options, solver: Solver) -> Worker {
    let Options { nats, workers, wall_seconds, steps, result_mib, memory_mib, .. } = options.clone();
    let options =
        WorkOptions { nats, workers, wall_seconds, steps, result_mib, grace_seconds: 0, ..WorkOptions::default() };
    let (stop, stopped) = channel(2);
    runtime.spawn(async move {
        let launcher = threads(Arc::clone(&solver));
        work(options, memory_mib, solver, &launcher, stopped).await.unwrap();
    });
    Worker { _stop: stop }
}
