//! The solver as an HTTP service: jobs, the HTTP resources by which clients access them, and the server.

pub mod access;
mod compiled;
mod context;
mod digest;
pub mod guide;
pub mod http;
pub mod jobs;
mod log;
mod metrics;
mod options;
mod page;
mod process;
mod remainder;
mod server;
mod trace;
pub mod worker;
mod write_timeout;

pub use log::{Log, PlainFields};
pub use options::Options;

use access::Tokens;
use axum::Router;
use compiled::Compiled;
use http::{Common, Room, Shared};
use jobs::{Gateway, Jobs, Pool, Solver, Turns};
use metrics::Metrics;
use std::io;
use std::num::NonZeroUsize;
use std::sync::Arc;
use tokio::net::TcpListener;
use tokio::sync::mpsc::Receiver;
use tokio::sync::{Semaphore, watch};
use worker::{Checkers, Confinement, Launcher};

/// A service with running worker processes, which stop when the service is dropped.
pub struct Service {
    shared: Shared,
    workers: Workers,
}

/// The processes that solve jobs, except for short solves that the serving process makes itself.
enum Workers {
    /// Worker processes that this process starts.
    Near(Pool),
    /// Workers on other machines, reached over NATS.
    Far {
        /// The limits in force on the local worker processes that check specifications.
        confinement: Confinement,
        _gateway: Gateway,
    },
}

impl Service {
    /// Starts worker processes by `launcher`, which continue the jobs left in the data folder of `options`. Short
    /// solves call `solver` in this process.
    ///
    /// # Errors
    /// The data folder is in use or cannot be written, the system provides no threads, or workers cannot be started.
    pub fn start(options: Options, solver: Solver, launcher: &Launcher) -> io::Result<Self> {
        options.check()?;
        let metrics = Arc::new(Metrics::default());
        let (folder, program) = (options.jobs_folder(), options.program.as_deref());
        let jobs = Jobs::open(options.bounds(), solver, folder, program, Arc::clone(&metrics))?;
        let jobs = Arc::new(jobs);
        let pool = Pool::start(&jobs, options.supervised(), options.relief, launcher)?;
        Self::assemble(options, jobs, Workers::Near(pool), metrics, launcher)
    }

    /// Starts a gateway: jobs are stored on the NATS servers of `options` and solved by the workers connected to
    /// those servers. Processes started by `launcher` check specifications, and short solves call `solver` in this
    /// process.
    ///
    /// # Errors
    /// The NATS servers do not answer or refuse the connection, or processes cannot be started.
    pub async fn join(options: Options, solver: Solver, launcher: &Launcher) -> io::Result<Self> {
        options.check()?;
        let metrics = Arc::new(Metrics::default());
        let (jobs, gateway) = Gateway::open(options.bounds(), solver, &options.nats, Arc::clone(&metrics)).await?;
        let (kept, notice) = (options.bounds().kept_by_worker(), Arc::new(|_: worker::Event<'_>| {}));
        let confinement = worker::Supervisor::new(Arc::clone(launcher), kept, notice).start().await?;
        let workers = Workers::Far { confinement, _gateway: gateway };
        Self::assemble(options, jobs, workers, metrics, launcher)
    }

    fn assemble(
        options: Options,
        jobs: Arc<Jobs>,
        workers: Workers,
        metrics: Arc<Metrics>,
        launcher: &Launcher,
    ) -> io::Result<Self> {
        let tokens = if options.asks_tokens() { Some(Arc::new(tokens(&options)?)) } else { None };
        let (bounds, counted) = (options.bounds(), Arc::clone(&metrics));
        let turns = Turns::new(options.workers.get(), bounds.queue);
        let checks = Turns::new(options.checkers(), bounds.queue);
        let notice = Arc::new(move |event: worker::Event<'_>| counted.notice(event));
        let checkers = Checkers::new(Arc::clone(launcher), bounds.kept_by_worker(), notice);
        let streams = Arc::new(Semaphore::new(places(options.streams)));
        let connections = Arc::new(Semaphore::new(places(options.connections)));
        let room = Room::new(options.answers_mib.get());
        let closing = watch::Sender::new(false);
        let shared = Arc::new(Common {
            jobs,
            options,
            metrics,
            tokens,
            compiled: Compiled::default(),
            turns,
            checks,
            checkers,
            room,
            streams,
            connections,
            closing,
        });
        Ok(Self { shared, workers })
    }

    /// The router of all HTTP resources of the service.
    pub fn router(&self) -> Router {
        http::router(Arc::clone(&self.shared))
    }

    /// The resource and access limits in force on the worker processes.
    pub fn confinement(&self) -> &Confinement {
        match &self.workers {
            Workers::Near(pool) => pool.confinement(),
            Workers::Far { confinement, .. } => confinement,
        }
    }

    /// Includes the number of log lines that `log` has lost in the metrics.
    pub fn count_lost_lines(&self, log: &Log) {
        self.shared.metrics.count_lost_lines(log);
    }

    /// The jobs of the service, with their queue and their store.
    pub fn jobs(&self) -> &Jobs {
        &self.shared.jobs
    }

    /// Serves connections until a message on `stop`, then lets running jobs end within the grace time; a second
    /// message cuts the grace time short.
    pub async fn serve(&self, listener: TcpListener, stop: Receiver<()>) {
        server::serve(listener, self.router(), Arc::clone(&self.shared), stop).await;
    }
}

/// Returns `count`, a number of permits, limited to the largest number that a semaphore can have.
fn places(count: NonZeroUsize) -> usize {
    count.get().min(Semaphore::MAX_PERMITS)
}

fn tokens(options: &Options) -> io::Result<Tokens> {
    let none =
        || io::Error::new(io::ErrorKind::InvalidInput, "there is no folder for the tokens that clients must present");
    let tokens = Tokens::open(options.data.as_deref().ok_or_else(none)?)?;
    if tokens.is_empty() {
        tracing::warn!("no token exists yet: `dvi token create` creates one, and --insecure requires none");
    }
    Ok(tokens)
}
