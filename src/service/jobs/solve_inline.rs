//! Small solves are tried on the thread that serves their connection: to wake a worker, and to be woken by it, takes longer
//! than they do.
//!
//! What is not over after a fraction of a millisecond goes to the queue as if nothing had been tried, so that a connection
//! waits for the solve of another no longer than for the reading of its specification. Nothing is tried while jobs of others
//! wait, which came first; nor what may take long over one step. What is to be on the disk or to be found under a key before it
//! is solved is tried when it has its turn, on the thread that supervises the worker which would have it.
//!
//! What was solved so before, to the letter, is answered as it was then.

use super::ended::{Ended, Ending, Held};
use super::job::{Halt, Job};
use super::work::Outcome;
use super::{Client, Jobs, Order, Results};
use crate::compiled::{Known, Repeated};
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
        let is_known = known.answer(order.client).is_some() && !order.anew;
        let may_be_tried = if is_known { !self.is_draining() } else { known.is_small() && self.is_free(order.client) };
        if !may_be_tried {
            return None;
        }
        let job = Arc::new(Job::new(Order { known: None, ..order.clone() }, false));
        let ended = self.solve_inline(&job, known, order.anew)?;
        // Without a key there is none that came before.
        let _ = self.store.index().insert(&job);
        job.log_end(&ended);
        self.store.conclude(&job, ended).await;
        Some(job)
    }

    /// The end of a job that has its turn, if it comes at once; a job that takes longer is as it was.
    pub(super) fn glance_in_turn(&self, job: &Job, document: &Arc<[u8]>) -> Option<Outcome> {
        let (known, anew) = job.solve_inline()?;
        if !known.is_small() {
            return None;
        }
        let ended = self.solve_inline(job, &known, anew).map(|ended| Outcome::Ended(ended.into()));
        ended.or_else(|| match job.go_back(document)? {
            Halt::Dismiss => Some(Outcome::Ended(job.ended(Ending::Dismissed).into())),
            Halt::Park => Some(Outcome::Stopped),
            Halt::Yield => None,
        })
    }

    /// The end of a job, which runs from here on.
    fn solve_inline(&self, job: &Job, known: &Known, anew: bool) -> Option<Ended> {
        let control = job.start_within(time_to_run(GLANCE), true)?;
        if let Some(answer) = known.answer(job.client).filter(|_| !anew) {
            self.metrics.repeated();
            let Repeated { steps, verdict, results, .. } = answer.clone();
            let held = Some(Held::Memory(results));
            return Some(Ended {
                fraction: 1.0,
                steps,
                verdict,
                held,
                repeated: true,
                ..job.ended(Ending::Successful)
            });
        }
        let begun = Instant::now();
        // A worker meets the panic again, and reports it.
        let solution = catch_unwind(AssertUnwindSafe(|| (self.solver)(&known.specification, &control))).ok()?;
        if solution.status != Status::Completed {
            return None;
        }
        self.metrics.waited(begun.saturating_duration_since(job.created.clock));
        self.metrics.solved(&Solved::of(known.specification.problem(), &solution), begun.elapsed());
        let (ending, verdict) = (Ending::Successful, Some(solution.verdict.clone()));
        let ended = self.ended(job, ending, verdict, Results::of(&solution, self.bounds.result_bytes));
        known.keep(job.client, &ended);
        Some(ended)
    }

    /// Whether a solve would keep no job of another client from its turn: the requests that one client has open at a time are in
    /// no order.
    fn is_free(&self, client: Client) -> bool {
        let intake = self.lock();
        !intake.draining && !intake.queue.any(|waiting, _| waiting != client)
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
