//! What a worker does with a job: marks it, solves it, and brings its end to the store.

use super::Jobs;
use super::ended::{Ended, Ending, Fault, Held};
use super::job::{Halt, Job, State};
use super::results::{Results, TooLarge};
use problem::Control;
use solution::{Solution, Status};
use specification::Specification;
use std::any::Any;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

/// What has become of a job that a worker took.
enum Outcome {
    Ended(Ended),
    /// It is to be left to the next process.
    Stopped,
    /// It was cancelled or parked before it started.
    Gone,
}

impl Jobs {
    /// Waits for a job and solves it on this thread, as that worker. False if workers have been dismissed.
    pub(super) async fn solve_next(&self, worker: usize) -> bool {
        match self.waiting.acquire().await {
            Ok(permit) => permit.forget(),
            Err(_) => return false,
        }
        let Some(job) = self.take_next() else { return true };
        let outcome = if job.crashes > 0 {
            let _alone = self.suspects.write().await;
            self.attempt(worker, &job)
        } else {
            let _beside_others = self.suspects.read().await;
            self.attempt(worker, &job)
        };
        match outcome {
            Outcome::Ended(ended) => self.store.conclude(&job, ended).await,
            Outcome::Stopped => self.store.park(&job).await,
            Outcome::Gone => {}
        }
        let mut intake = self.lock();
        intake.running -= 1;
        intake.drain_rate.departed(Instant::now());
        self.announce_if_idle(&intake);
        true
    }

    fn take_next(&self) -> Option<Arc<Job>> {
        let mut intake = self.lock();
        let job = intake.queue.pop()?;
        intake.running += 1;
        Some(job)
    }

    /// Sends workers home, each at the end of the job in hand.
    pub(super) fn dismiss_workers(&self) {
        self.waiting.close();
    }

    fn attempt(&self, worker: usize, job: &Job) -> Outcome {
        let _span = tracing::info_span!("job", job.id = %job.id).entered();
        self.store.mark(worker, job);
        let outcome = catch_unwind(AssertUnwindSafe(|| self.solve(job))).unwrap_or_else(|panic| {
            self.panics.fetch_add(1, Relaxed);
            let message = message(&*panic);
            tracing::error!(job.id = %job.id, panic.message = message, "the solver panicked in job {}", job.id);
            Outcome::Ended(job.ended(Ending::Broken(Fault::Panicked)))
        });
        self.store.unmark(worker, job);
        tracing::debug!("the solver is done with the job");
        outcome
    }

    fn solve(&self, job: &Job) -> Outcome {
        let specification = match self.specification(job) {
            Ok(specification) => specification,
            Err(error) => {
                tracing::error!(%error, "the specification of job {} cannot be read", job.id);
                return Outcome::Ended(Ended::unsolved(Ending::Broken(Fault::Unreadable)));
            }
        };
        let asked = specification.wall_seconds().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        let wall = asked.map_or(self.bounds.wall, |asked| asked.min(self.bounds.wall));
        let Some(control) = job.start(wall) else { return Outcome::Gone };
        self.metrics.waited(job.created.clock.elapsed());
        let solution = self.metrics.measure(specification.problem(), || (self.solver)(&specification, &control));
        let halted = job.halted();
        if halted == Some(Halt::Park) && solution.status == Status::Stopped {
            return Outcome::Stopped;
        }
        Outcome::Ended(self.ended(job, solution, halted.is_some()))
    }

    pub(super) fn ended(&self, job: &Job, solution: Solution, cancelled: bool) -> Ended {
        let ending = Ending::of(&solution, cancelled);
        let verdict = Some(solution.verdict.clone());
        let limit = self.bounds.result_bytes;
        match Results::of(solution, limit) {
            Ok(results) => Ended { verdict, held: Some(Held::Memory(Arc::new(results))), ..job.ended(ending) },
            Err(TooLarge) => job.ended(Ending::Broken(Fault::TooLarge { limit })),
        }
    }

    fn specification(&self, job: &Job) -> io::Result<Arc<Specification>> {
        if let State::Accepted(Some(specification)) = job.state() {
            return Ok(specification);
        }
        let document = self.store.document(job)?;
        let read = self.read(&document, &Control::new());
        read.map(Arc::new).map_err(|errors| io::Error::other(format!("{errors:?}")))
    }
}

/// What a panic said.
fn message(panic: &(dyn Any + Send)) -> &str {
    match (panic.downcast_ref::<&str>(), panic.downcast_ref::<String>()) {
        (Some(text), _) => text,
        (None, Some(text)) => text,
        (None, None) => "no message",
    }
}
