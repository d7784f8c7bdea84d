//! What becomes of a job that has its turn: it is marked, a worker solves it, and its end comes to the store.

use super::crashes::MOST_KILLS;
use super::ended::{Ended, Ending, Fault, Held};
use super::intake::{Lane, LaneCell};
use super::job::{Halt, Job, State};
use super::results::{Long, Results, TooLarge};
use super::{Jobs, is_damage};
use crate::worker::{Death, Event, FAIR, Finished, Left, Origin, Prints, Slice, Solved, Supervisor, Task, Watch};
use problem::Control;
use solution::{Status, Verdict};
use std::borrow::Cow;
use std::io;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};
use tokio::select;
use tracing::Instrument;

/// What has become of a job that had its turn.
pub(super) enum Outcome {
    Ended(Box<Ended>),
    /// It is to be left to the next process.
    Stopped,
    /// It has had its first slice, and goes back to the queue.
    Waits,
    /// It was cancelled or parked before it started.
    Gone,
}

impl Jobs {
    /// Waits for a job and has it solved under supervision, at that place in the pool. False if workers have been
    /// dismissed.
    pub(super) async fn solve_next(&self, place: usize, supervisor: &mut Supervisor) -> bool {
        // A job is taken where there is a worker for it.
        select! {
            () = supervisor.ready() => {}
            () = self.dismissed() => return false,
        }
        if let Some((job, lane)) = self.next(supervisor).await {
            self.see_through(place, supervisor, &job, lane).await;
        }
        !self.is_dismissed.load(Relaxed)
    }

    /// The next job for a worker; nothing after a while in which there was none, or if workers have been dismissed.
    async fn next(&self, supervisor: &mut Supervisor) -> Option<(Arc<Job>, Lane)> {
        let mut arrival = pin!(self.arrival.notified());
        // Before the look at the queue: a job that comes in between is not overlooked.
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

    /// Waits until a job that has had its first slice, of a client of whom none runs to its end, finds all workers taken, and has
    /// it solved in relief. False if workers have been dismissed.
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
                // There may be one for another relief worker as well.
                self.call_relief(&intake);
                next
            };
            let Some(job) = next else { return true };
            self.see_through(place, supervisor, &job, Lane::Relief).await;
        }
    }

    async fn see_through(&self, place: usize, supervisor: &mut Supervisor, job: &Arc<Job>, lane: Lane) {
        let (begun, lane) = (Instant::now(), LaneCell::of(lane));
        let mut origin = Origin::of(Some(job.id.to_string()), &job.context);
        let span = origin.span();
        origin.join(&span);
        let outcome = if job.crashes > 0 {
            let _alone = self.suspects.write().await;
            self.attempt(place, supervisor, job, &origin, &lane).instrument(span).await
        } else {
            let _beside_others = self.suspects.read().await;
            self.attempt(place, supervisor, job, &origin, &lane).instrument(span).await
        };
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
            // What the disk keeps is left to the next process by one that is about to stop.
            if is_wanted && !(intake.draining && job.is_lasting()) {
                intake.queue.push(job.client, Arc::clone(job));
            }
        } else {
            intake.drain_rate.departed(Instant::now());
        }
        self.announce_if_idle(&intake);
        // Nothing may run for its client now, or what runs may have taken its place.
        self.call_relief(&intake);
    }

    /// Notes what becomes of workers.
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

    /// Whether there is somebody to solve: false where no worker lives and none can be started.
    pub fn has_workers(&self) -> bool {
        self.living.load(Relaxed) > 0 || !self.unstartable.load(Relaxed)
    }

    /// Sends workers home, each at the end of the job in hand.
    pub(super) fn dismiss_workers(&self) {
        self.is_dismissed.store(true, Relaxed);
        self.dismissed.notify_waiters();
    }

    /// Returns when workers are sent home.
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
        if let Some(outcome) = self.glance_in_turn(job, &document) {
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
        let mut kills = 0;
        let (finished, spool) = loop {
            let mut spool = self.store.spool(job.id);
            let (limits, long) = (self.limits(), &mut spool);
            let over = || self.end_slice(job, lane);
            let slice = (lane.get() == Lane::First).then(|| Slice { time: self.slice(), over: &over });
            let mut task = Task { solve: true, document, limits, watch: &watch, long, yields: true, slice };
            let finished = supervisor.perform(&mut task).await;
            let Err(Death::Killed(signal)) = finished else { break (finished, spool) };
            kills += 1;
            // Who ends a worker while there is memory says nothing of the job.
            if self.was_memory_short() || kills > MOST_KILLS || job.halted().is_some() || self.is_draining() {
                break (finished, spool);
            }
            tracing::warn!(signal, "the worker of job {} was ended from outside; the job begins again", job.id);
        };
        let halted = job.halted();
        let is_over = matches!(&finished, Ok(Finished::Solved(solved, _)) if solved.status != Status::Stopped);
        if halted == Some(Halt::Yield) && !is_over {
            // Unless it has been asked for something else meanwhile.
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
                };
                Outcome::Ended(self.ended(job, ending, Some(verdict), Ok(results)).into())
            }
            Ok(Finished::TooMuchMemory(estimate)) => {
                let fault = Fault::TooMuchMemory { allowed: self.bounds.memory, asked: None, estimate: Some(estimate) };
                broken(fault, "too_much_memory")
            }
            Ok(Finished::TooLarge) => broken(Fault::TooLarge { limit: self.bounds.result_bytes }, "result_too_large"),
            // Stopped before the solve began, or on the way without heeding it.
            Ok(Finished::Refused(_, true)) | Err(Death::Overran) => match halted {
                Some(Halt::Park) => Outcome::Stopped,
                Some(Halt::Dismiss) => Outcome::Ended(job.ended(Ending::Dismissed).into()),
                Some(Halt::Yield) | None => broken(Fault::Overran, "overran"),
            },
            // A signal to the whole unit, which is about to stop.
            Err(Death::Killed(_)) if job.is_lasting() && self.is_draining() => Outcome::Stopped,
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

    /// At the end of its first slice a job goes on if it may, and is asked to make room if not.
    fn end_slice(&self, job: &Job, lane: &LaneCell) {
        job.use_up_slice();
        if self.lock().goes_on(job) {
            lane.set(Lane::Long);
            job.stay();
        } else {
            job.halt(Halt::Yield);
        }
    }

    /// The time of a first slice. A job that does not heed the wish to stop at its end costs a worker: of the time of the
    /// workers that are kept for first slices, at most a part of `1/(1 + FAIR)` goes into starting others.
    fn slice(&self) -> Duration {
        Duration::from_nanos(self.fastest_start.load(Relaxed)).saturating_mul(FAIR)
    }

    /// Whether the system has ended a process for want of memory, which may have been the worker that is lost.
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

    /// What was posted for a job that waits.
    fn posted(&self, job: &Job) -> io::Result<Arc<[u8]>> {
        match job.state() {
            State::Accepted(Some(document)) => Ok(document),
            State::Accepted(None) | State::Running { .. } | State::Ended(_) => self.store.document(job),
        }
    }
}

impl Job {
    /// A line of the log: whose it was, how it ended, how long it took and what it left.
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

    /// The type of its problem, as figures name it.
    fn problem(&self) -> Cow<'static, str> {
        self.estimate.as_ref().map_or("unknown".into(), |estimate| estimate.problem.clone())
    }
}
