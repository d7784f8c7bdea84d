//! Small solves are tried on the thread that serves their connection: to wake a worker, and to be woken by it, takes longer
//! than they do.
//!
//! What is not over after a fraction of a millisecond goes to the queue as if nothing had been tried, so that a connection
//! waits for the solve of another no longer than for the reading of its specification. Nothing is tried while jobs of others
//! wait, which came first; nor what is to be on the disk or to be found under a key before it is solved, nor what may take long over one step.
//!
//! What was solved so before, to the letter, is answered as it was then.

use super::ended::{Ended, Ending, Held};
use super::job::Job;
use super::{Client, Jobs, Order, Results};
use crate::compiled::Repeated;
use crate::worker::Solved;
use problem::Control;
use rustix::time::{ClockId, Timespec, clock_gettime};
use solution::Status;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Some times what waking a worker takes, of a thread that runs: where others have the processor in between, waking takes longer too.
const GLANCE: Duration = Duration::from_micros(200);

impl Jobs {
    /// A job that has been solved, if that is done at once.
    pub(super) async fn solve_at_a_glance(&self, order: &Order) -> Option<Arc<Job>> {
        let known = order.known.as_deref().filter(|_| order.key.is_none())?;
        if let Some(answer) = known.answer(order.client).filter(|_| !order.anew && !self.is_draining()) {
            return Some(self.answer_again(order, answer).await);
        }
        if !known.is_small() || !self.is_free(order.client) {
            return None;
        }
        let specification = &known.specification;
        let job = Arc::new(Job::new(order.clone(), false));
        let control = job.start_within(time_to_run(GLANCE))?;
        // A worker meets the panic again, and reports it.
        let solution = catch_unwind(AssertUnwindSafe(|| (self.solver)(specification, &control))).ok()?;
        if solution.status != Status::Completed {
            return None;
        }
        self.metrics.waited(Duration::ZERO);
        self.metrics.solved(&Solved::of(specification.problem(), &solution), job.created.clock.elapsed());
        let (ending, verdict) = (Ending::Successful, Some(solution.verdict.clone()));
        let ended = self.ended(&job, ending, verdict, Results::of(&solution, self.bounds.result_bytes));
        known.keep(order.client, &ended);
        self.end_at_once(&job, ended).await;
        Some(job)
    }

    /// A job that is answered as the same specification was before.
    async fn answer_again(&self, order: &Order, answer: &Repeated) -> Arc<Job> {
        let job = Arc::new(Job::new(order.clone(), false));
        job.start_within(Control::new());
        let Repeated { steps, verdict, results, .. } = answer.clone();
        let held = Some(Held::Memory(results));
        let ended = Ended { fraction: 1.0, steps, verdict, held, repeated: true, ..job.ended(Ending::Successful) };
        self.metrics.repeated();
        self.end_at_once(&job, ended).await;
        job
    }

    async fn end_at_once(&self, job: &Arc<Job>, ended: Ended) {
        // Without a key there is none that came before.
        let _ = self.store.index().insert(job);
        job.log_end(&ended);
        self.store.conclude(job, ended).await;
    }

    /// Whether a solve would keep no job of another client from its turn: the requests that one client has open at a time are in
    /// no order.
    fn is_free(&self, client: Client) -> bool {
        let intake = self.lock();
        !intake.draining && !intake.queue.any(|waiting| waiting != client)
    }
}

/// A control that stops this thread when it has run for so long, whatever others had of the processor meanwhile.
fn time_to_run(time: Duration) -> Control {
    let end = running() + time;
    Control::with_deadline(Instant::now() + time).with_reprieve(move || running() < end)
}

/// The time that this thread has run.
fn running() -> Duration {
    let Timespec { tv_sec, tv_nsec } = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(tv_sec.unsigned_abs(), u32::try_from(tv_nsec).unwrap_or_default())
}
