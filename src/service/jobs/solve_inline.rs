//! Inline solves: a small problem is first tried on the thread that serves its connection, since to wake a worker and
//! to be woken by it takes longer than to solve a small problem.
//!
//! A solve that has not ended after a fraction of a millisecond goes to the queue as if it had not been tried, so
//! that it delays other connections no longer than the parsing of a specification does. No solve is tried while jobs
//! of other clients wait, which came first, nor one whose single steps may take long. A job that must be on the disk,
//! or that must be found under an idempotency key, before it is solved, is tried when its turn in the queue comes, on
//! the thread that supervises the worker which would solve it. A worker that serves several gateways tries a job
//! before it claims it: see `jobs::nats`.
//!
//! If the identical specification was solved inline earlier for the same client, the known solution is returned.

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

/// The limit of the CPU time of an inline solve: several times the wake-up time of a worker. CPU time is measured,
/// not elapsed time, since on a busy machine a wake-up takes longer as well.
const INLINE_TIME: Duration = Duration::from_micros(200);

/// The limit of the CPU time of a small solve that replaces the claim of a job on shared servers: about the time that
/// a claim takes on a busy machine. Such a solve delays no other request.
const UNCLAIMED_TIME: Duration = Duration::from_millis(1);

impl Jobs {
    /// Tries to solve a newly posted job inline (in the serving process), and returns the job if it has been solved.
    pub(super) async fn try_inline(&self, order: &Order) -> Option<Arc<Job>> {
        let known = order.known.as_deref().filter(|_| order.key.is_none())?;
        let is_known = known.answer(order.client).is_some() && !order.anew;
        let may_be_tried = if is_known { !self.is_draining() } else { known.is_small() && self.is_free(order.client) };
        if !may_be_tried {
            return None;
        }
        let job = Arc::new(Job::new(Order { known: None, ..order.clone() }, false));
        let ended = self.solve_inline(&job, known, order.anew, INLINE_TIME)?;
        // Insertion into the index succeeds: a job without an idempotency key cannot collide with an earlier one.
        let _ = self.store.index().insert(&job);
        job.log_end(&ended);
        self.store.conclude(&job, ended).await;
        Some(job)
    }

    /// Tries to solve a job inline (in the serving process) when its turn in the queue has come, and returns its
    /// outcome; `None` leaves the job unchanged.
    pub(super) fn try_inline_in_turn(&self, job: &Job, document: &Arc<[u8]>) -> Option<Outcome> {
        let (known, anew) = job.solve_inline()?;
        if !known.is_small() {
            return None;
        }
        let ended = self.solve_inline(job, &known, anew, INLINE_TIME).map(|ended| Outcome::Ended(ended.into()));
        ended.or_else(|| match job.go_back(document)? {
            Halt::Dismiss => Some(Outcome::Ended(job.ended(Ending::Dismissed).into())),
            Halt::Park => Some(Outcome::Stopped),
            Halt::Yield => None,
        })
    }

    /// Solves in this process a small job that another process has admitted, even if its solution is known, and returns
    /// its end; `None` if the solve takes longer than a claim of the job would.
    pub(super) fn solve_small(&self, job: &Job, known: &Known) -> Option<Ended> {
        let ended = if known.is_small() { self.solve_inline(job, known, true, UNCLAIMED_TIME)? } else { return None };
        job.log_end(&ended);
        Some(ended)
    }

    /// Starts a job, and solves it in this process within `time`, or finds its stored solution; returns its end.
    fn solve_inline(&self, job: &Job, known: &Known, anew: bool, time: Duration) -> Option<Ended> {
        let control = job.start_within(time_to_run(time), true)?;
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
        // After a panic of the solver, the job goes to a worker, where the panic happens again and is reported.
        let solution = catch_unwind(AssertUnwindSafe(|| (self.solver)(&known.specification, &control))).ok()?;
        // Work that follows the solve, such as a comparison with further solves, is also cut short at the time limit,
        // which the status of the solution does not show.
        if solution.status != Status::Completed || control.poll().is_some() {
            return None;
        }
        self.metrics.waited(begun.saturating_duration_since(job.created.clock));
        self.metrics.solved(&Solved::of(known.specification.problem(), &solution), begun.elapsed());
        let (ending, verdict) = (Ending::Successful, Some(solution.verdict.clone()));
        let ended = self.ended(job, ending, verdict, Results::of(&solution, self.bounds.result_bytes));
        known.keep(job.client, &ended);
        Some(ended)
    }

    /// Whether an inline solve (in the serving process) would delay no job of another client. Jobs of the same client
    /// may be overtaken, since concurrent requests of one client have no order.
    fn is_free(&self, client: Client) -> bool {
        let intake = self.lock();
        !intake.draining && !intake.queue.any(|waiting, _| waiting != client)
    }
}

/// Creates the control of an inline solve, which stops the solve when this thread has used `time` of CPU time.
fn time_to_run(time: Duration) -> Control {
    let end = running() + time;
    Control::with_deadline(Instant::now() + time).with_reprieve(move || running() < end)
}

/// Returns the CPU time that this thread has used.
fn running() -> Duration {
    let Timespec { tv_sec, tv_nsec } = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(tv_sec.unsigned_abs(), u32::try_from(tv_nsec).unwrap_or_default())
}
