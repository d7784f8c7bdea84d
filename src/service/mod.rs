//! The solver as a service over HTTP: jobs, the resources by which clients see them, and the server.

pub mod access;
pub mod http;
pub mod jobs;
mod options;
mod page;
mod server;

pub use options::Options;

use access::Tokens;
use axum::Router;
use http::Shared;
use jobs::{Jobs, Pool, Solver};
use std::io;
use std::sync::Arc;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio::sync::mpsc::Receiver;

/// A service with its workers running. They stop when it is dropped.
pub struct Service {
    shared: Shared,
    _pool: Pool,
}

impl Service {
    /// Starts the workers, which call `solver`, on the jobs that are left in the folder of the options.
    ///
    /// # Errors
    /// The folder is in use or cannot be written, or the system gives no threads.
    pub fn start(options: Options, solver: Solver) -> io::Result<Self> {
        let tokens = if options.asks_tokens() { Some(Arc::new(tokens(&options)?)) } else { None };
        let jobs = Arc::new(Jobs::open(options.bounds(), solver, options.jobs_folder())?);
        let pool = Pool::start(&jobs, options.workers)?;
        let readers = Arc::new(Semaphore::new(options.workers.get()));
        Ok(Self { shared: Shared { jobs, options: Arc::new(options), tokens, readers }, _pool: pool })
    }

    /// Its resources.
    pub fn router(&self) -> Router {
        http::router(self.shared.clone())
    }

    /// Its jobs.
    pub fn jobs(&self) -> &Jobs {
        &self.shared.jobs
    }

    /// Serves connections until something comes through `stop`, then lets jobs end within the grace time; a second
    /// one cuts that short.
    pub async fn serve(&self, listener: TcpListener, stop: Receiver<()>) {
        server::serve(listener, self.router(), self.shared.clone(), stop).await;
    }
}

fn tokens(options: &Options) -> io::Result<Tokens> {
    let none = || io::Error::new(io::ErrorKind::InvalidInput, "there is no folder for the tokens to ask for");
    let tokens = Tokens::open(options.data.as_deref().ok_or_else(none)?)?;
    if tokens.is_empty() {
        tracing::warn!("nobody has a token yet: dvi token create makes one, --insecure asks for none");
    }
    Ok(tokens)
}
