//! Workers: threads of a runtime of their own, each with one task that takes a job, solves it to its end and takes the
//! next. The threads that serve connections never solve, so a long solve delays no answer; and the number of
//! workers bounds the work in hand.

use super::Jobs;
use std::io;
use std::num::NonZeroUsize;
use std::sync::Arc;
use tokio::runtime::{Builder, Runtime};

/// Room for the deepest expression that a specification may hold.
const STACK_BYTES: usize = 8 << 20;

/// The workers; they stop when it is dropped, each at the end of the job in hand.
#[derive(Debug)]
pub struct Pool {
    runtime: Option<Runtime>,
}

impl Pool {
    /// Starts `workers` on the queue of `jobs`.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn start(jobs: &Arc<Jobs>, workers: NonZeroUsize) -> io::Result<Self> {
        let runtime = Builder::new_multi_thread()
            .worker_threads(workers.get())
            .thread_name("dvi-worker")
            .thread_stack_size(STACK_BYTES)
            .build()?;
        for _ in 0..workers.get() {
            let jobs = Arc::clone(jobs);
            runtime.spawn(async move {
                loop {
                    jobs.solve_next().await;
                }
            });
        }
        Ok(Self { runtime: Some(runtime) })
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}
