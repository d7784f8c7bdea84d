//! The execution of a job whose turn in the queue has come: a mark on the disk, a solve on a worker, and the end in
//! the store.

use super::crashes::MOST_KILLS;
use super::ended::{Ended, Ending, Fault, Held};
use super::intake::{Lane, LaneCell, Taken};
use super::job::{Halt, Job, State};
use super::results::{Long, Results, TooLarge};
use super::spool::Spool;
use super::{Jobs, is_damage};
use crate::worker::{
    Death, Event, FAIR, Finished, Left, Limits, Members, Origin, Prints, Slice, Solved, Supervisor, Task, Watch,
};
use problem::Control;
use solution::{Status, Verdict};
use std::borrow::Cow;
use std::io;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};
use tokio::select;
use tokio::time::timeout;
use tracing::Instrument;

/// The time limit for a suspect job, which was running when an earlier service process died, to run alone, and for its
/// wait to do so. In both together other jobs wait less than the 30 s for which a client waits by default.
const ALONE: Duration = Duration::from_secs(10);

/// A job, or a chunk of a sweep, that is given to a worker to solve.
#[derive(Clone, Copy)]
pub(super) struct Assignment<'a> {
    pub job: &'a Job,
    pub document: &'a [u8],
    /// The members of the sweep to solve, if the job is a chunk of a sweep.
    pub members: Option<&'a Members>,
    pub limits: Limits,
    /// Called at the end of the first time slice of the job.
    pub over: &'a (dyn Fn() + Sync),
}

/// The outcome of an attempt to solve a job.
pub(super) enum Outcome {
    Ended(Box<Ended>),
    /// The job was stopped at the stop of the service, for the next process to start again.
    Stopped,
    /// The job has used up its first time slice, and returns to the queue.
    Waits,
    /// The job was cancelled, or parked at the stop of the service, before it started.
    Gone,
}

impl Jobs {
    /// Waits for a job and lets the supervised worker at `place` in the pool solve it. Returns false if the workers
    /// have been dismissed, at the stop of the service.
    pub(super) async fn solve_next(&self, place: usize, supervisor: &mut Supervisor) -> bool {
        // A job is taken only once a worker is ready for it.
        select! {
            () = supervisor.ready() => {}
            () = self.dismissed() => return false,
        }
        if let Some(taken) = self.next(supervisor).await {
            self.see_to(place, supervisor, taken).await;
        }
        !self.is_dismissed.load(Relaxed)
    }

    /// Returns the next job for a worker. If no job waits, returns `None` once a job arrives, the idle worker dies or
    /// the workers are dismissed.
    async fn next(&self, supervisor: &mut Supervisor) -> Option<Taken> {
        let mut arrival = pin!(self.arrival.notified());
        // The notification of a new job is registered before the queue is read, so that an arrival in between is not
        // missed.
        arrival.as_mut().enable();
        if self.is_dismissed.load(Relaxed) {
            return None;
        }
        let next = self.lock().take();
        if next.is_none() {
            select! {
                () = arrival => {}
                () = supervisor.idle() => {}
                () = self.dismissed() => {}
            }
        }
        next
    }

    /// Waits for a job in need of relief (it has used up its first time slice, its client has no other job that runs
    /// to its end, and all workers are taken), and lets the relief worker at `place` solve it. Returns false if
    /// workers have been dismissed.
    pub(super) async fn relieve_next(&self, place: usize, supervisor: &mut Supervisor) -> bool {
        select! {
            () = self.relief.notified() => {}
            () = supervisor.idle() => return true,
            () = self.dismissed() => return false,
        }
        loop {
            let next = {
                let mut intake = self.lock();
                let next = intake.relieve();
                // A further job may wait for a relief worker, and another relief worker is woken for it.
                self.call_relief(&intake);
                next
            };
            let Some(taken) = next else { return true };
            self.see_to(place, supervisor, taken).await;
        }
    }

    async fn see_to(&self, place: usize, supervisor: &mut Supervisor, taken: Taken) {
        let Taken { job, chunk, lane } = taken;
        match &job.chunks {
            Some(chunks) => {
                // Another worker is woken to take the remaining members of the sweep.
                self.arrival.notify_one();
                self.see_chunk_through(place, supervisor, (&job, chunks), chunk, lane).await;
            }
            None => self.see_through(place, supervisor, &job, lane).await,
        }
    }

    /// Does the `work` of a job beside other jobs, unless the job is a suspect, which was running when an earlier
    /// process died. A suspect runs alone at first, so that the next death of the process is evidence against it; but
    /// only for a limited time, so that it does not delay the others if it is innocent.
    pub(super) async fn apart<T>(&self, is_suspect: bool, work: impl Future<Output = T>) -> T {
        let mut work = pin!(work);
        if is_suspect && let Ok(alone) = timeout(ALONE, self.suspects.write()).await {
            match timeout(ALONE, &mut work).await {
                Ok(done) => return done,
                Err(_) => {
                    let _beside_others = alone.downgrade();
                    return work.await;
                }
            }
        }
        // The job is not a suspect, or it is a suspect for which the other jobs have not ended in time, so that it
        // runs beside them.
        let _beside_others = self.suspects.read().await;
        work.await
    }

    async fn see_through(&self, place: usize, supervisor: &mut Supervisor, job: &Arc<Job>, lane: Lane) {
        let (begun, lane) = (Instant::now(), LaneCell::of(lane));
        let mut origin = Origin::of(Some(job.id.to_string()), &job.context);
        let span = origin.span();
        origin.join(&span);
        let attempt = self.attempt(place, supervisor, job, &origin, &lane).instrument(span);
        let outcome = self.apart(job.crashes() > 0, attempt).await;
        let waits = matches!(outcome, Outcome::Waits);
        match outcome {
            Outcome::Ended(ended) => {
                job.log_end(&ended);
                self.store.conclude(job, *ended).await;
            }
            Outcome::Stopped => self.store.park(job).await,
            Outcome::Waits | Outcome::Gone => {}
        }
        let mut intake = self.lock();
        intake.depart(job, lane.get(), begun.elapsed());
        if waits {
            self.metrics.yielded();
            let is_wanted = matches!(job.lock().state, State::Accepted(_));
            // While the service drains (admits no more jobs), a durable job is left to the next process.
            if is_wanted && !(intake.draining && job.is_durable()) {
                intake.queue.push(job.client, Arc::clone(job));
            }
        } else {
            intake.drain_rate.departed(Instant::now());
        }
        self.announce_if_idle(&intake);
        // A waiting job may need a relief worker now: its client may have no running job any more, or this job may
        // have become one that runs to its end.
        self.call_relief(&intake);
    }

    /// Counts the start-ups and ends of worker processes.
    pub(super) fn notice(&self, event: Event<'_>) {
        self.metrics.notice(event);
        match event {
            Event::Started(_, time) => {
                let time = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
                self.fastest_start.fetch_min(time, Relaxed);
                self.living.fetch_add(1, Relaxed);
                self.unstartable.store(false, Relaxed);
            }
            Event::Grown(_) | Event::Lowered(_) | Event::Unwanted(_) | Event::Died(..) => {
                self.living.fetch_sub(1, Relaxed);
            }
            Event::NotStarted(_) => self.unstartable.store(true, Relaxed),
        }
    }

    /// Whether jobs can be solved: false if no worker process lives and none can be started.
    pub fn has_workers(&self) -> bool {
        self.living.load(Relaxed) > 0 || !self.unstartable.load(Relaxed)
    }

    /// Dismisses the workers at the stop of the service, each at the end of its current job.
    pub(super) fn dismiss_workers(&self) {
        self.is_dismissed.store(true, Relaxed);
        self.dismissed.notify_waiters();
    }

    /// Waits until the workers are dismissed, each to end after its current job.
    async fn dismissed(&self) {
        loop {
            let dismissed = self.dismissed.notified();
            if self.is_dismissed.load(Relaxed) {
                return;
            }
            dismissed.await;
        }
    }

    async fn attempt(
        &self,
        place: usize,
        supervisor: &mut Supervisor,
        job: &Job,
        origin: &Origin,
        lane: &LaneCell,
    ) -> Outcome {
        let document = match self.posted(job) {
            Ok(document) => document,
            Err(error) => {
                tracing::error!(%error, "the specification of job {} cannot be read", job.id);
                let fault = if is_damage(&error) {
                    self.metrics.found_damaged();
                    Fault::Damaged
                } else {
                    Fault::Unreadable
                };
                return Outcome::Ended(Ended::unsolved(Ending::Broken(fault)).into());
            }
        };
        if let Some(outcome) = self.try_inline_in_turn(job, &document) {
            return outcome;
        }
        self.store.mark(place, job);
        let outcome = match job.start(self.bounds.wall, lane.get() == Lane::First) {
            Some(control) => self.solve(supervisor, job, origin, &document, &control, lane).await,
            None => Outcome::Gone,
        };
        self.store.unmark(place, job);
        tracing::debug!("the worker is done with the job");
        outcome
    }

    async fn solve(
        &self,
        supervisor: &mut Supervisor,
        job: &Job,
        origin: &Origin,
        document: &Arc<[u8]>,
        control: &Control,
        lane: &LaneCell,
    ) -> Outcome {
        if !job.has_had_slice() {
            self.metrics.waited(job.created.clock.elapsed());
        }
        let begun = Instant::now();
        let is_unwanted = || job.is_forgotten() || job.halted() == Some(Halt::Yield);
        let watch = Watch { origin, control, halted: &job.halted, is_unwanted: &is_unwanted };
        let over = || self.end_slice(job, lane);
        let assignment = Assignment { job, document, members: None, limits: self.limits(), over: &over };
        let (finished, spool) = self.perform(supervisor, &assignment, &watch, lane).await;
        let halted = job.halted();
        let is_over = matches!(&finished, Ok(Finished::Solved(solved, _)) if solved.status != Status::Stopped);
        if halted == Some(Halt::Yield) && !is_over {
            // While its worker stopped the job, the client may have cancelled it, or the service parked it.
            match job.go_back(document) {
                None => return Outcome::Waits,
                Some(Halt::Park) => return Outcome::Stopped,
                Some(Halt::Dismiss | Halt::Yield) => {
                    return Outcome::Ended(job.ended(Ending::Dismissed).into());
                }
            }
        }
        let broken = |fault, code: &'static str| {
            self.metrics.ended(job.problem(), code.into(), begun.elapsed());
            Outcome::Ended(job.ended(Ending::Broken(fault)).into())
        };
        match finished {
            Ok(Finished::Solved(solved, _)) if halted == Some(Halt::Park) && solved.status == Status::Stopped => {
                Outcome::Stopped
            }
            Ok(Finished::Solved(solved, left)) => {
                self.metrics.solved(&solved, begun.elapsed());
                let Solved { status, failed, verdict, .. } = *solved;
                let ending = Ending::of(status, failed.as_ref().map(|failed| &*failed.message), halted.is_some());
                let results = match left {
                    Left::Text(json) => Results::read(json),
                    Left::Columns(Prints { json, index }) => {
                        Results::Columns(Long { backing: spool.end(), json, index })
                    }
                    // Rows are the results of a chunk of a sweep, which the worker was not asked for.
                    Left::Rows(..) => return broken(Fault::Defect, "defect"),
                };
                Outcome::Ended(self.ended(job, ending, Some(verdict), Ok(results)).into())
            }
            Ok(Finished::TooMuchMemory(estimate)) => {
                let fault = Fault::TooMuchMemory { allowed: self.bounds.memory, asked: None, estimate: Some(estimate) };
                broken(fault, "too_much_memory")
            }
            Ok(Finished::TooLarge) => broken(Fault::TooLarge { limit: self.bounds.result_bytes }, "result_too_large"),
            // The solve was stopped before it began, or its worker was killed since it did not heed the request to
            // stop.
            Ok(Finished::Refused(_, true)) | Err(Death::Overran) => match halted {
                Some(Halt::Park) => Outcome::Stopped,
                Some(Halt::Dismiss) => Outcome::Ended(job.ended(Ending::Dismissed).into()),
                Some(Halt::Yield) | None => broken(Fault::Overran, "overran"),
            },
            // The signal that killed the worker went to all processes of the service, which is about to stop.
            Err(Death::Killed(_)) if job.is_durable() && self.is_draining() => Outcome::Stopped,
            Ok(Finished::Refused(errors, false)) => {
                let errors = String::from_utf8_lossy(&errors);
                tracing::error!(%errors, "the specification of job {} cannot be read", job.id);
                broken(Fault::Unreadable, "unreadable")
            }
            Ok(Finished::Checked(..)) => broken(Fault::Defect, "defect"),
            Err(death) => {
                tracing::error!(?death, "the worker of job {} died: {}", job.id, death.code());
                if matches!(death, Death::Defect(_)) {
                    self.panics.fetch_add(1, Relaxed);
                }
                let estimate = job.estimate.as_ref().map(|estimate| estimate.memory);
                broken(Fault::of(&death, self.bounds.memory, estimate), death.code())
            }
        }
    }

    /// Lets a worker solve the job or chunk; begins again if the worker is killed by a signal from outside.
    pub(super) async fn perform(
        &self,
        supervisor: &mut Supervisor,
        assignment: &Assignment<'_>,
        watch: &Watch<'_>,
        lane: &LaneCell,
    ) -> (Result<Finished, Death>, Spool) {
        let Assignment { job, document, members, limits, over } = *assignment;
        let mut kills = 0;
        loop {
            let mut spool = self.store.spool(job.id);
            let slice = (lane.get() == Lane::First).then(|| Slice { time: self.slice(), over });
            let long = &mut spool;
            let mut task = Task { solve: true, members, document, limits, watch, long, yields: true, slice };
            let finished = supervisor.perform(&mut task).await;
            let Err(Death::Killed(signal)) = finished else { return (finished, spool) };
            kills += 1;
            // A worker killed from outside while there was enough memory is no evidence against the job.
            if self.was_memory_short() || kills > MOST_KILLS || job.halted().is_some() || self.is_draining() {
                return (finished, spool);
            }
            tracing::warn!(signal, "the worker of job {} was ended from outside; the job begins again", job.id);
        }
    }

    /// At the end of a job's first time slice, lets the job continue if it may, and otherwise asks it to yield.
    pub(super) fn end_slice(&self, job: &Job, lane: &LaneCell) {
        job.use_up_slice();
        if self.lock().goes_on(job) {
            lane.set(Lane::Long);
            job.stay();
        } else {
            job.halt(Halt::Yield);
        }
    }

    /// Returns the length of a first time slice: `FAIR` start-up times of a worker. A job that does not heed the
    /// request to yield costs a worker, so that at most the fraction `1/(1 + FAIR)` of the time of the express
    /// workers goes into start-ups.
    fn slice(&self) -> Duration {
        Duration::from_nanos(self.fastest_start.load(Relaxed)).saturating_mul(FAIR)
    }

    /// Whether the system has killed a process for lack of memory, possibly the lost worker, since the last call of
    /// this function.
    fn was_memory_short(&self) -> bool {
        let (was_short, taken) = self.shortage.account();
        if let Some(taken) = taken {
            self.store.account(&taken);
        }
        was_short
    }

    pub(super) fn ended(
        &self,
        job: &Job,
        ending: Ending,
        verdict: Option<Verdict>,
        results: Result<Results, TooLarge>,
    ) -> Ended {
        match results {
            Ok(results) => Ended { verdict, held: Some(Held::Memory(Arc::new(results))), ..job.ended(ending) },
            Err(TooLarge) => job.ended(Ending::Broken(Fault::TooLarge { limit: self.bounds.result_bytes })),
        }
    }

    /// Returns the posted specification of a waiting job.
    pub(super) fn posted(&self, job: &Job) -> io::Result<Arc<[u8]>> {
        match job.state() {
            State::Accepted(Some(document)) => Ok(document),
            State::Accepted(None) | State::Running { .. } | State::Ended(_) => self.store.document(job),
        }
    }
}

impl Job {
    /// Logs the end of a job: client, ending, durations and size of the results.
    pub(super) fn log_end(&self, ended: &Ended) {
        let milliseconds = |time: Duration| time.as_secs_f64() * 1e3;
        tracing::info!(
            target: "dvi::job",
            {
            job.id = %self.id,
            request.id = &*self.context.request,
            trace.id = self.context.trace.map(tracing::field::display),
            client = %self.client,
            problem = &*self.problem(),
            ending = ended.ending.code(),
            trusted = ended.verdict.as_ref().map(|verdict| verdict.trusted),
            steps = ended.steps,
            bytes = ended.bytes(),
            queue_ms = ended.timing.map(|timing| milliseconds(timing.queue)),
            duration_ms = ended.timing.map(|timing| milliseconds(timing.solve)),
            },
            "job {} ended: {}",
            self.id,
            ended.ending.code()
        );
    }

    /// Returns the problem type of the job, as a label of metrics.
    pub(super) fn problem(&self) -> Cow<'static, str> {
        self.estimate.as_ref().map_or("unknown".into(), |estimate| estimate.problem.clone())
    }
}
