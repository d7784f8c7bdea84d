//! Sites that share their jobs over a NATS server.

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
    worker_on(runtime(), options, solver)
}

/// A worker on a runtime of its own, with which it is lost at once.
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
