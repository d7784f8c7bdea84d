//! Workers: threads that each take a job, solve it to its end and take the next. The threads that serve connections
//! solve only what is over at a glance, so a long solve delays no answer; and the number of workers bounds
//! the work in hand.
//!
//! Each worker is a runtime of one thread. Workers that share one wake each other in search of work whenever one of
//! them is woken, which takes more time than a small solve.

use super::Jobs;
use std::io;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::thread;
use tokio::runtime::Builder;

/// Room for the deepest expression that a specification may hold.
const STACK_BYTES: usize = 8 << 20;

/// The workers; they stop when it is dropped, each at the end of the job in hand.
pub struct Pool {
    jobs: Arc<Jobs>,
}

impl Pool {
    /// Starts `workers` on the queue of `jobs`.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn start(jobs: &Arc<Jobs>, workers: NonZeroUsize) -> io::Result<Self> {
        let pool = Self { jobs: Arc::clone(jobs) };
        for worker in 0..workers.get() {
            let (jobs, runtime) = (Arc::clone(jobs), Builder::new_current_thread().build()?);
            let work = move || runtime.block_on(async { while jobs.solve_next(worker).await {} });
            thread::Builder::new().name("dvi-worker".to_owned()).stack_size(STACK_BYTES).spawn(work)?;
        }
        Ok(pool)
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        self.jobs.dismiss_workers();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Options;
    use std::time::{Duration, Instant};

    #[test]
    fn workers_leave_when_the_pool_is_dropped() {
        let jobs =
            Arc::new(Jobs::open(Options::default().bounds(), Arc::new(study::solve), None, Arc::default()).unwrap());
        let pool = Pool::start(&jobs, NonZeroUsize::MIN).unwrap();
        let held = Arc::downgrade(&jobs);
        drop((pool, jobs));
        let start = Instant::now();
        while held.strong_count() > 0 {
            assert!(start.elapsed() < Duration::from_secs(20), "a worker still holds the jobs");
            thread::sleep(Duration::from_millis(1));
        }
    }
}
