//! The pool of workers: threads that each supervise a worker process, give it a job, wait for the end and take the
//! next job. A long solve delays no request, and the number of workers bounds the concurrent work. Some additional
//! workers serve the first time slices of jobs. While other clients' long jobs occupy all workers, relief workers run
//! long jobs of clients that have none running, one at a time per client.
//!
//! Each thread has an async runtime of its own. The threads of a shared runtime wake each other in search of work
//! whenever one of them is woken, which takes more time than a small solve.

use super::Jobs;
use crate::worker::{Confinement, Event, Launcher, Supervisor};
use std::io;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::thread;
use tokio::runtime::Builder;

/// The pool of worker processes and their supervisors; dropping it stops each worker at the end of its current job.
pub struct Pool {
    jobs: Arc<Jobs>,
    /// The resource limits that the worker processes could impose on themselves.
    confinement: Confinement,
}

impl Pool {
    /// Starts `workers` workers on the queue of `jobs`, including the express workers. The `relief` relief workers
    /// get their threads at once, and a process when it is first needed.
    ///
    /// # Errors
    /// The system provides no thread, or a worker cannot be started.
    pub fn start(jobs: &Arc<Jobs>, workers: NonZeroUsize, relief: usize, launcher: &Launcher) -> io::Result<Self> {
        let mut pool = Self { jobs: Arc::clone(jobs), confinement: Confinement::default() };
        let (starting, started) = channel();
        let workers = workers.get();
        for place in 0..workers + relief {
            let (jobs, runtime) = (Arc::clone(jobs), Builder::new_current_thread().enable_all().build()?);
            let told = Arc::clone(&jobs);
            let notice = Arc::new(move |event: Event<'_>| told.notice(event));
            let mut supervisor = Supervisor::new(Arc::clone(launcher), jobs.bounds.kept_by_worker(), notice);
            let starting = starting.clone();
            let work = move || {
                runtime.block_on(async {
                    if place >= workers {
                        drop(starting);
                        while jobs.relieve_next(place, &mut supervisor).await {}
                        return;
                    }
                    // Sending the result of the start fails if another worker could not be started, since the receiver
                    // is dropped then.
                    let _ = starting.send(supervisor.start().await);
                    drop(starting);
                    while jobs.solve_next(place, &mut supervisor).await {}
                });
            };
            thread::Builder::new().name("dvi-supervisor".to_owned()).spawn(work)?;
        }
        drop(starting);
        for confinement in started {
            pool.confinement = confinement?;
        }
        Ok(pool)
    }

    /// The resource limits that the worker processes could impose on themselves.
    pub fn confinement(&self) -> &Confinement {
        &self.confinement
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
    use crate::worker::{Start, serve};
    use std::time::{Duration, Instant};

    /// Starts a worker on a thread of this process, in place of a worker process.
    fn start() -> io::Result<Start> {
        let ((input, orders), (reports, output)) = (io::pipe()?, io::pipe()?);
        thread::spawn(move || serve(input, output, Arc::new(study::solve), Confinement::default()));
        Ok(Start { orders: orders.into(), reports: reports.into(), process: None })
    }

    #[test]
    fn workers_leave_when_the_pool_is_dropped() {
        let bounds = Options::default().bounds();
        let jobs = Arc::new(Jobs::open(bounds, Arc::new(study::solve), None, None, Arc::default()).unwrap());
        let launcher: Launcher = Arc::new(start);
        let pool = Pool::start(&jobs, NonZeroUsize::MIN, 1, &launcher).unwrap();
        let held = Arc::downgrade(&jobs);
        drop((pool, jobs));
        let start = Instant::now();
        while held.strong_count() > 0 {
            assert!(start.elapsed() < Duration::from_secs(20), "a worker still holds the jobs");
            thread::sleep(Duration::from_millis(1));
        }
    }
}
