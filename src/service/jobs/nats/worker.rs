//! A worker over NATS: it takes jobs from the servers, lets the processes that it supervises solve them, and returns
//! the results. Internally, it is a service in memory, whose only client is the queue on the servers.
//!
//! It only connects to the servers, and nothing connects to it, so that it runs wherever these can be reached.

use super::claims::{Decision, Holder, decide};
use super::entry::{Entry, Versioned as _, short};
use super::errand::Errand;
use super::lines::Lines;
use super::mirror::Told;
use super::parts::Work;
use super::servers::{Exchange, Trouble, job_key};
use super::work_options::WorkOptions;
use crate::compiled::{Compiled, SMALL};
use crate::jobs::{Bounds, Ended, Halt, Held, Job, JobId, Jobs, Pool, Record, Solver};
use crate::metrics::Metrics;
use crate::options::Options;
use crate::worker::{Launcher, Progress};
use async_nats::jetstream::AckKind;
use async_nats::jetstream::message::Message;
use serde_json::value::RawValue;
use std::collections::{HashMap, HashSet};
use std::io;
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::mpsc::Receiver;
use tokio::sync::oneshot;
use tokio::task::JoinSet;
use tokio::time::{Instant, MissedTickBehavior, interval, interval_at, sleep, timeout};
use uuid::Uuid;

/// The interval at which a worker publishes the progress of a job, and that at which it stores the progress for
/// gateways that start later.
const TELL: Duration = Duration::from_millis(100);
const KEEP: Duration = Duration::from_secs(5);

/// The number of signs of life that a worker sends within the time after which it counts as lost.
const BEATS: u32 = 4;

/// The time limit for sending the messages that remain in the buffer of the connection when the worker stops.
const ANSWER: Duration = Duration::from_secs(2);

/// The time limit for solves that are asked to stop to reach their next step.
pub const LAST_CALL: Duration = Duration::from_secs(10);

/// The pause before a failed request to the NATS servers is repeated, and before a job is tried again whose entry could
/// not be read.
pub const PAUSE: Duration = Duration::from_millis(500);

/// The time for which a job that another version of the program wrote is left to a worker that can read it.
pub const OTHERS: Duration = Duration::from_secs(10);

/// The state of a worker that takes jobs over NATS, with the jobs that it has.
pub struct Worker {
    pub name: String,
    pub exchange: Exchange,
    pub jobs: Arc<Jobs>,
    pub lines: Lines,
    mine: Mutex<HashMap<Work, Option<Arc<Job>>>>,
    /// The number of sweeps that this worker divides into chunks for other workers.
    pub divided: AtomicUsize,
    /// The specification of the sweep of which the worker last had a chunk.
    latest: Mutex<Option<(JobId, Arc<[u8]>)>>,
    compiled: Compiled,
    /// The ids of the jobs that clients have asked to stop.
    cancelled: Mutex<HashSet<JobId>>,
    until_idle: Option<Duration>,
    /// The time at which the worker last answered the message of a job or chunk.
    active: Mutex<Instant>,
    is_stopping: AtomicBool,
}

/// A job that this worker has claimed in the bucket of states.
pub struct Claimed {
    pub id: JobId,
    pub entry: Entry,
    pub revision: u64,
    pub document: Arc<[u8]>,
}

/// A place among the worker's concurrent solves; when this value is dropped, the place is free, and the worker takes
/// the next message.
pub type Place = oneshot::Sender<()>;

/// The answer of a worker to the message of a job or chunk.
pub enum Reply {
    /// Acknowledge the message: the job has ended, or is deleted.
    Acknowledge,
    /// Let the servers deliver the message again after this time.
    Later(Duration),
    /// Send no answer: another worker has the job, and will answer the message that it got.
    Nothing,
}

impl Reply {
    /// Returns the answer to the message of a job or chunk whose entry could not be read.
    pub fn after(trouble: Trouble) -> Self {
        match trouble {
            Trouble::OtherVersion => Self::Later(OTHERS),
            Trouble::Away => Self::Later(PAUSE),
        }
    }
}

/// Works until there has been nothing to do for the time given in `options`, or until a message on `stop`; running
/// jobs then have the grace time, which a second message cuts short. Each of the processes that `launcher` starts may
/// take `memory_mib` MiB for a solve.
///
/// # Errors
/// The servers do not answer at the start, or the processes cannot be started.
pub async fn work(
    options: WorkOptions,
    memory_mib: NonZeroUsize,
    solver: Solver,
    launcher: &Launcher,
    mut stop: Receiver<()>,
) -> io::Result<()> {
    let WorkOptions { nats, workers, wall_seconds, steps, result_mib, until_idle, grace_seconds } = options;
    let options = Options { workers, wall_seconds, steps, result_mib, memory_mib, ..Options::default() };
    let bounds: Bounds = options.bounds();
    let exchange = tokio::select! {
        exchange = Exchange::join(&nats, "worker") => exchange?,
        _ = stop.recv() => return Ok(()),
    };
    let jobs = Arc::new(Jobs::open(bounds, solver, None, None, Arc::new(Metrics::default()))?);
    let pool = Pool::start(&jobs, workers, 0, launcher)?;
    let worker = Arc::new(Worker {
        name: Uuid::now_v7().to_string(),
        exchange,
        jobs,
        lines: Lines::default(),
        mine: Mutex::default(),
        divided: AtomicUsize::new(0),
        latest: Mutex::default(),
        compiled: Compiled::default(),
        cancelled: Mutex::default(),
        until_idle,
        active: Mutex::new(Instant::now()),
        is_stopping: AtomicBool::new(false),
    });
    tracing::info!(worker = worker.name, workers, confined_to = %pool.confinement(), "working");
    let _tasks = worker.start_tasks();
    let mut places = Vec::new();
    for _ in 0..workers.get() {
        let worker = Arc::clone(&worker);
        places.push(tokio::spawn(async move { worker.take_jobs().await }));
    }
    let mut all = Box::pin(async move {
        for place in places {
            if let Err(error) = place.await {
                tracing::error!(%error, "a place of the worker ended");
            }
        }
    });
    tokio::select! {
        () = &mut all => {}
        _ = stop.recv() => {
            worker.is_stopping.store(true, Relaxed);
            worker.lines.look();
            worker.leave_sweeps();
            tracing::info!(grace_seconds, "stopping: no more jobs are taken");
            let have_ended = tokio::select! {
                () = &mut all => true,
                () = sleep(Duration::from_secs(grace_seconds)) => false,
                Some(()) = stop.recv() => false,
            };
            if !have_ended {
                worker.leave_jobs();
                // A solve that does not stop is given to another worker when this worker sends no signs of life any
                // more.
                let _ = timeout(LAST_CALL, &mut all).await;
            }
        }
    }
    // Messages that are buffered for the connection are sent before the process ends.
    let _ = timeout(ANSWER, worker.exchange.client.flush()).await;
    tracing::info!("stopped");
    drop(pool);
    Ok(())
}

impl Worker {
    /// At the stop of this worker, stops its running jobs, for other workers to begin again.
    fn leave_jobs(&self) {
        let jobs: Vec<_> = self.mine().values().flatten().cloned().collect();
        for job in jobs {
            let jobs = Arc::clone(&self.jobs);
            tokio::spawn(async move { jobs.leave(&job).await });
        }
    }

    /// Gives up the sweeps that this worker divides into chunks for others, since it solves no more chunks itself.
    fn leave_sweeps(&self) {
        let mine = self.mine();
        let jobs: Vec<_> = mine.iter().filter(|(work, _)| matches!(work, Work::Job(_))).collect();
        for job in jobs.into_iter().filter_map(|(_, job)| job.clone()).filter(|job| job.chunks.is_some()) {
            let jobs = Arc::clone(&self.jobs);
            tokio::spawn(async move { jobs.leave(&job).await });
        }
    }

    /// Takes jobs from the NATS queue and lets them be solved, one after the other. Sweeps that are divided for others
    /// continue beside them.
    async fn take_jobs(self: &Arc<Self>) {
        let mut attended = JoinSet::new();
        while let Some((message, lost_after)) = self.lines.next(&self.exchange, || self.is_over()).await {
            let (place, is_free) = oneshot::channel();
            let worker = Arc::clone(self);
            attended.spawn(async move { worker.attend(&message, lost_after, place).await });
            let _ = is_free.await;
            while attended.try_join_next().is_some() {}
        }
        while attended.join_next().await.is_some() {}
    }

    /// Handles the message of a job or chunk until it is answered, and sends signs of life meanwhile, so that
    /// JetStream gives the message to no other worker.
    async fn attend(self: &Arc<Self>, message: &Message, lost_after: Duration, place: Place) {
        let mut beats = interval_at(Instant::now() + lost_after / BEATS, lost_after / BEATS);
        beats.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let beating = async {
            loop {
                beats.tick().await;
                // An error is ignored: if a sign of life is lost, the next one comes in time.
                let _ = message.ack_with(AckKind::Progress).await;
            }
        };
        // The place, which is one of the worker's concurrent solves, becomes free with the answer to the message at
        // the latest.
        let mut place = Some(place);
        let reply = tokio::select! {
            reply = self.see_to(message, lost_after, &mut place) => reply,
            () = beating => Reply::Nothing,
        };
        let replied = match reply {
            Reply::Acknowledge => message.ack().await,
            Reply::Later(time) => message.ack_with(AckKind::Nak(Some(time))).await,
            Reply::Nothing => Ok(()),
        };
        if let Err(error) = replied {
            // Without an answer the message of the job is delivered again, and the entry then says what became of the
            // job.
            tracing::debug!(%error, "a message could not be answered");
        }
        *self.active.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    /// Whether the worker is to take no more jobs: it is stopping, or has been idle for long enough.
    fn is_over(&self) -> bool {
        let idle = self.active.lock().unwrap_or_else(PoisonError::into_inner).elapsed();
        let is_idle = self.until_idle.is_some_and(|most| idle > most) && self.mine().is_empty();
        self.is_stopping.load(Relaxed) || is_idle
    }

    async fn see_to(self: &Arc<Self>, message: &Message, lost_after: Duration, place: &mut Option<Place>) -> Reply {
        let Some(work) = Work::of(&message.subject) else {
            // The kind of the message is unknown to this version: it is left to a worker of another version, which
            // may know it.
            return Reply::Later(OTHERS);
        };
        if self.mine().contains_key(&work) {
            // The message of the job was delivered again because the worker's signs of life came late.
            return Reply::Later(lost_after);
        }
        self.mine().insert(work, None);
        let reply = match work {
            Work::Part(id) => self.see_to_part(id, lost_after).await,
            Work::Job(id) => match self.solve_or_claim(id, message, lost_after).await {
                Ok(claimed) => match claimed.entry.record.sweep() {
                    Some(facts) => {
                        let is_new = message.info().is_ok_and(|info| info.delivered == 1);
                        self.divide(claimed, facts, is_new, place).await
                    }
                    None => self.solve(claimed).await,
                },
                Err(reply) => reply,
            },
        };
        self.mine().remove(&work);
        reply
    }

    /// Solves a job at once, if it is small, and otherwise claims it in the bucket of states.
    async fn solve_or_claim(&self, id: JobId, message: &Message, lost_after: Duration) -> Result<Claimed, Reply> {
        let errand = Errand::read(&message.payload);
        // The job of a message that is delivered again may have made a worker die; such a job is claimed first, since
        // only a claim records the death of a worker.
        if message.info().is_ok_and(|info| info.delivered == 1)
            && let Some(errand) = &errand
            && self.solve_small(id, errand).await
        {
            return Err(Reply::Acknowledge);
        }
        self.claim(id, errand, lost_after).await
    }

    /// Solves a small job at once, which takes less time than to claim it, and writes its end; returns whether it has
    /// done so. The write is refused if the entry has changed since the message was written, because another worker
    /// has ended or claimed the job.
    async fn solve_small(&self, id: JobId, errand: &Errand) -> bool {
        let Errand { entry, revision } = errand;
        let (Some(estimate), Some(document)) = (&entry.record.estimate, &entry.document) else { return false };
        if estimate.sweep.is_some() || estimate.memory > SMALL || self.cancelled().contains(&id) {
            return false;
        }
        let Ok(Some(known)) = self.compiled.read(document.as_bytes(), &self.jobs.limits()) else { return false };
        let job = Job::taken_on(id, entry.record.clone(), None, document.as_bytes().into());
        let Some(ended) = self.jobs.solve_small(&job, &known) else { return false };
        let Some((ended, results)) = with_short(&ended) else { return false };
        let record = Record { ended: Some(ended), ..entry.record.clone() };
        let entry = Entry { record, results: Some(results), ..entry.clone() };
        match self.exchange.state.update(job_key(id), entry.text().into(), *revision).await {
            Ok(revision) => self.tell_end(id, &entry, revision).await,
            // If the end of the job was written and only the answer of the servers was lost, the claim that follows
            // finds the job ended.
            Err(_) => return false,
        }
        true
    }

    /// Claims a job in the bucket of states, unless its entry says that it is not to be solved.
    async fn claim(&self, id: JobId, errand: Option<Errand>, lost_after: Duration) -> Result<Claimed, Reply> {
        let mut found = match errand {
            Some(Errand { entry, revision }) => Ok(Some((entry, revision))),
            None => self.exchange.entry(id).await,
        };
        loop {
            let (entry, revision) = match found {
                Ok(Some(found)) => found,
                Ok(None) => return Err(Reply::Acknowledge),
                Err(Trouble::OtherVersion) => return Err(Reply::Later(OTHERS)),
                Err(Trouble::Away) => return Err(Reply::Later(PAUSE)),
            };
            let holder = match &entry.claim {
                Some(claim) if entry.record.ended.is_none() && claim.worker == self.name => Holder::LeftIt,
                Some(claim) if entry.record.ended.is_none() => self.ask(&claim.worker, Work::Job(id), lost_after).await,
                Some(_) | None => Holder::Unknown,
            };
            let (next, is_over) = match decide(&entry, &self.name, holder, lost_after) {
                Decision::Drop => return Err(Reply::Acknowledge),
                Decision::Wait(time) => return Err(Reply::Later(time)),
                Decision::End(next) => (*next, true),
                Decision::Take(next) => (*next, false),
            };
            match self.exchange.state.update(job_key(id), next.text().into(), revision).await {
                Ok(_) if is_over => return Err(Reply::Acknowledge),
                Ok(revision) => {
                    return match self.exchange.document_of(id, &next).await {
                        Ok(document) => Ok(Claimed { id, entry: next, revision, document: document.into() }),
                        Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                            Err(self.end_unread(id, next, revision).await)
                        }
                        Err(_) => Err(self.release(id, next, revision).await),
                    };
                }
                Err(_) => found = self.exchange.entry(id).await,
            }
        }
    }

    /// Ends a job whose specification is missing on the NATS servers.
    async fn end_unread(&self, id: JobId, entry: Entry, revision: u64) -> Reply {
        let ended = Ended::unsolved(crate::jobs::Ending::Broken(crate::jobs::Fault::Damaged));
        self.write_end(id, (entry, revision), &ended, None).await
    }

    /// Releases the claim to a job, so that another worker takes it.
    pub async fn release(&self, id: JobId, entry: Entry, revision: u64) -> Reply {
        let (claim, divided) = (entry.claim.clone(), entry.divided);
        let released = self.exchange.change(id, Some((entry, revision)), |entry| {
            let is_mine = entry.claim == claim;
            if is_mine {
                entry.claim = None;
                entry.divided = divided;
            }
            is_mine
        });
        match released.await {
            Ok(Some(_)) => Reply::Later(Duration::ZERO),
            Ok(None) => Reply::Acknowledge,
            // The claim to the job may stay in its entry: the next worker that gets the message asks this worker, which
            // answers that it does not have the job.
            Err(_) => Reply::Later(PAUSE),
        }
    }

    async fn solve(&self, claimed: Claimed) -> Reply {
        let Claimed { id, entry, revision, document } = claimed;
        let job = self.jobs.take_on(id, &entry.record, document);
        self.begin(&job, entry.record.dismissed).await;
        let (ended, is_kept) = self.follow_job(&job).await;
        let reply = match ended {
            None => self.release(id, entry, revision).await,
            Some(ended) => self.finish(&job, (entry, revision), &ended).await,
        };
        self.let_go(&job, is_kept).await;
        reply
    }

    /// Registers a job that is being solved, and stops it if a client wants it to stop.
    pub async fn begin(&self, job: &Arc<Job>, is_dismissed: bool) {
        self.mine().insert(Work::Job(job.id), Some(Arc::clone(job)));
        let is_cancelled = self.cancelled().contains(&job.id);
        if is_cancelled || is_dismissed {
            // On this worker, the job is in memory only, so that cancelling it cannot fail.
            let _ = self.jobs.cancel(job).await;
        }
    }

    /// Removes a job that has ended, or was given back, from memory, and the requests and progress stored for it.
    pub async fn let_go(&self, job: &Arc<Job>, is_kept: bool) {
        let id = job.id;
        // The removal of the job is awaited, since this worker may take the job again, and then adds another job with
        // this id.
        let _ = self.jobs.forget(job).await;
        if is_kept {
            let _ = self.exchange.clear(&format!("progress.{id}")).await;
        }
        if self.cancelled().remove(&id) {
            let _ = self.exchange.clear(&format!("cancel.{id}")).await;
        }
    }

    /// Publishes the progress of a job until it has ended or is given back. Returns its end, and whether progress has
    /// been stored.
    pub async fn follow_job(&self, job: &Arc<Job>) -> (Option<Arc<Ended>>, bool) {
        let (id, attempt) = (job.id, job.attempt());
        let mut looks = interval_at(Instant::now() + TELL, TELL);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let (mut told, mut last) = (0, (0.0, 0));
        let (mut is_kept, mut kept) = (false, Instant::now());
        let settled = job.settled();
        tokio::pin!(settled);
        loop {
            tokio::select! {
                biased;
                ended = &mut settled => return (ended, is_kept),
                _ = looks.tick() => {}
            }
            let Some(control) = job.control() else { continue };
            let progress = Progress::of(&control, told);
            let now = (progress.fraction, progress.steps);
            if now != last || !progress.events.is_empty() {
                last = now;
                told = progress.events.last().map_or(told, |(number, _)| *number);
                let text = serde_json::to_vec(&Told { attempt, progress }).unwrap_or_default();
                // A lost report of progress is made up for by the next.
                let _ = self.exchange.client.publish(self.exchange.subject("progress", id), text.into()).await;
            }
            if kept.elapsed() > KEEP && self.exchange.is_near() {
                kept = Instant::now();
                let progress = Progress::of(&control, 0);
                let text = serde_json::to_vec(&Told { attempt, progress }).unwrap_or_default();
                is_kept |= self.exchange.state.put(format!("progress.{id}"), text.into()).await.is_ok();
            }
        }
    }

    /// Writes the results and the end of a job, with retries until the NATS servers accept them.
    pub async fn finish(&self, job: &Arc<Job>, claimed: (Entry, u64), ended: &Ended) -> Reply {
        let (id, attempt) = (job.id, job.attempt());
        let (mut ended, results) =
            with_short(ended).map_or_else(|| (ended.clone(), None), |(ended, json)| (ended, Some(json)));
        if let Some(Held::Memory(results)) = &ended.held {
            let results = Arc::clone(results);
            let mut pauses = interval(PAUSE);
            ended.held = loop {
                pauses.tick().await;
                match self.exchange.put_results(id, attempt, Arc::clone(&results)).await {
                    Ok(held) => break Some(held),
                    Err(error) => tracing::warn!(%error, job.id = %id, "the results of job {id} cannot be written yet"),
                }
            };
        }
        let reply = self.write_end(id, claimed, &ended, results).await;
        if matches!(reply, Reply::Acknowledge) {
            for earlier in 1..attempt {
                let _ = self.exchange.remove_results(id, earlier).await;
            }
        }
        reply
    }

    async fn write_end(
        &self,
        id: JobId,
        (entry, revision): (Entry, u64),
        ended: &Ended,
        results: Option<Box<RawValue>>,
    ) -> Reply {
        let attempt = entry.record.crashes + 1;
        let claim = entry.claim.clone();
        let mut known = Some((entry, revision));
        loop {
            let change = self.exchange.change(id, known.take(), |entry| {
                let is_mine = entry.claim.is_some() && entry.claim == claim;
                if is_mine {
                    entry.record.ended = Some(ended.clone());
                    entry.results = results.clone();
                    entry.claim = None;
                }
                is_mine
            });
            match change.await {
                // This is also the case if an earlier attempt has written the end of the job and only its
                // confirmation was lost.
                Ok(Some((entry, revision))) if entry.record.ended.is_some() && entry.record.crashes + 1 == attempt => {
                    self.tell_end(id, &entry, revision).await;
                    return Reply::Acknowledge;
                }
                Ok(Some(_)) => {
                    tracing::warn!(job.id = %id, "job {id} has gone to another worker meanwhile");
                    let _ = self.exchange.remove_results(id, attempt).await;
                    return Reply::Nothing;
                }
                // The entry of the job is missing, since the client has deleted the job.
                Ok(None) => {
                    let _ = self.exchange.remove_results(id, attempt).await;
                    return Reply::Acknowledge;
                }
                Err(Trouble::OtherVersion) => return Reply::Nothing,
                Err(Trouble::Away) => sleep(PAUSE).await,
            }
        }
    }

    /// Sends the end of a job to gateways, which would otherwise learn of it later.
    async fn tell_end(&self, id: JobId, entry: &Entry, revision: u64) {
        let text = Errand::text(entry, revision);
        let _ = self.exchange.client.publish(self.exchange.subject("ended", id), text.into()).await;
    }

    /// Locks and returns the specification of the sweep of which the worker last had a chunk.
    pub fn latest(&self) -> MutexGuard<'_, Option<(JobId, Arc<[u8]>)>> {
        self.latest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Locks and returns the jobs and chunks that the worker has; the value is the job in this process, once it has
    /// begun.
    pub fn mine(&self) -> MutexGuard<'_, HashMap<Work, Option<Arc<Job>>>> {
        self.mine.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Locks and returns the ids of the jobs that clients have asked to stop.
    pub fn cancelled(&self) -> MutexGuard<'_, HashSet<JobId>> {
        self.cancelled.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the end of a job and its short results, both to be stored in its entry; `None` if the results are longer, or
/// there are none.
fn with_short(ended: &Ended) -> Option<(Ended, Box<RawValue>)> {
    let Some(Held::Memory(results)) = &ended.held else { return None };
    let json = short(results)?;
    Some((Ended { held: Some(Held::Table(results.fingerprint())), ..ended.clone() }, json))
}

impl Jobs {
    /// Puts a job that another process has admitted into the queue of this process.
    fn take_on(&self, id: JobId, record: &Record, document: Arc<[u8]>) -> Arc<Job> {
        // Idempotency keys concern only the gateways, which admit jobs.
        let record = Record { key: None, ..record.clone() };
        let job = Arc::new(Job::taken_on(id, record, None, document));
        // Insertion into the index succeeds, since the job has no idempotency key.
        let _ = self.store.index().insert(&job);
        self.lock().queue.push(job.client, Arc::clone(&job));
        self.arrival.notify_one();
        job
    }

    /// Stops a job in this process, for another process to begin again.
    pub(super) async fn leave(&self, job: &Arc<Job>) {
        if job.halt(Halt::Park) {
            self.stop_chunks(job, Halt::Park).await;
        } else {
            self.take_out(job);
            self.store.park(job).await;
        }
    }
}
