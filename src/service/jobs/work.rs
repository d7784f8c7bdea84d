//! What becomes of a job that has its turn: it is marked, a worker solves it, and its end comes to the store.

use super::crashes::MOST_KILLS;
use super::ended::{Ended, Ending, Fault, Held};
use super::job::{Halt, Job, State};
use super::results::{Long, Results, TooLarge};
use super::{Jobs, is_damage};
use crate::worker::{Death, Event, Finished, Left, Origin, Prints, Solved, Supervisor, Task, Watch};
use problem::Control;
use solution::{Status, Verdict};
use std::borrow::Cow;
use std::io;
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
        select! {
            permit = self.waiting.acquire() => match permit {
                Ok(permit) => permit.forget(),
                Err(_) => return false,
            },
            () = supervisor.idle() => return true,
        }
        let next = self.lock().take();
        if let Some(job) = next {
            self.see_through(place, supervisor, &job, false).await;
        }
        true
    }

    /// Waits until a job of a client for whom nothing runs finds all workers taken, and has it solved in relief. False if
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
                let next = intake.relieve(self.bounds.workers);
                // There may be one for another relief worker as well.
                self.call_relief(&intake);
                next
            };
            let Some(job) = next else { return true };
            self.see_through(place, supervisor, &job, true).await;
        }
    }

    async fn see_through(&self, place: usize, supervisor: &mut Supervisor, job: &Arc<Job>, relief: bool) {
        let mut origin = Origin::of(Some(job.id.to_string()), &job.context);
        let span = origin.span();
        origin.join(&span);
        let outcome = if job.crashes > 0 {
            let _alone = self.suspects.write().await;
            self.attempt(place, supervisor, job, &origin).instrument(span).await
        } else {
            let _beside_others = self.suspects.read().await;
            self.attempt(place, supervisor, job, &origin).instrument(span).await
        };
        match outcome {
            Outcome::Ended(ended) => {
                job.log_end(&ended);
                self.store.conclude(job, *ended).await;
            }
            Outcome::Stopped => self.store.park(job).await,
            Outcome::Gone => {}
        }
        let mut intake = self.lock();
        intake.depart(job, relief);
        self.announce_if_idle(&intake);
        // Nothing may run for its client now.
        self.call_relief(&intake);
    }

    /// Notes what becomes of workers.
    pub(super) fn notice(&self, event: Event<'_>) {
        self.metrics.notice(event);
        match event {
            Event::Started(_) => {
                self.living.fetch_add(1, Relaxed);
                self.unstartable.store(false, Relaxed);
            }
            Event::Grown(_) | Event::Died(..) => {
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
        self.waiting.close();
        self.dismissed.notify_waiters();
    }

    /// Returns when workers are sent home.
    async fn dismissed(&self) {
        loop {
            let dismissed = self.dismissed.notified();
            if self.waiting.is_closed() {
                return;
            }
            dismissed.await;
        }
    }

    async fn attempt(&self, place: usize, supervisor: &mut Supervisor, job: &Job, origin: &Origin) -> Outcome {
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
        let outcome = match job.start(self.bounds.wall) {
            Some(control) => self.solve(supervisor, job, origin, &document, &control).await,
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
        document: &[u8],
        control: &Control,
    ) -> Outcome {
        self.metrics.waited(job.created.clock.elapsed());
        let begun = Instant::now();
        let watch = Watch { origin, control, halted: &job.halted, is_unwanted: &|| job.is_forgotten() };
        let mut kills = 0;
        let (finished, spool) = loop {
            let mut spool = self.store.spool(job.id);
            let mut task = Task { solve: true, document, limits: self.limits(), watch: &watch, long: &mut spool };
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
                None => broken(Fault::Overran, "overran"),
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
