//! A worker: it takes jobs from the servers, has the processes that it supervises solve them, and gives the results back.
//! Within, it is a service in memory of its own, whose only client is the queue.
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

/// The interval at which progress is told, and that at which it is written for gateways that come later.
const TELL: Duration = Duration::from_millis(100);
const KEEP: Duration = Duration::from_secs(5);

/// The signs of life of a worker within the time after which it counts as lost.
const BEATS: u32 = 4;

/// The time that another worker has to say whether it has a job.
const ANSWER: Duration = Duration::from_secs(2);

/// The time for solves that are left to reach their next step.
pub const LAST_CALL: Duration = Duration::from_secs(10);

/// The pause before something is tried again, and before a job is looked at again whose entry is not there yet.
pub const PAUSE: Duration = Duration::from_millis(500);

/// The time for which a job of another version is left to a worker that can read it.
pub const OTHERS: Duration = Duration::from_secs(10);

/// The worker and the jobs that it has.
pub struct Worker {
    pub name: String,
    pub exchange: Exchange,
    pub jobs: Arc<Jobs>,
    pub lines: Lines,
    mine: Mutex<HashMap<Work, Option<Arc<Job>>>>,
    /// The number of sweeps that this worker divides for others.
    pub divided: AtomicUsize,
    /// The specification of the sweep that the worker last had a chunk of.
    latest: Mutex<Option<(JobId, Arc<[u8]>)>>,
    compiled: Compiled,
    /// Jobs that are to stop.
    cancelled: Mutex<HashSet<JobId>>,
    until_idle: Option<Duration>,
    /// When a job last ended.
    active: Mutex<Instant>,
    is_stopping: AtomicBool,
}

/// A job that this worker has claimed.
pub struct Claimed {
    pub id: JobId,
    pub entry: Entry,
    pub revision: u64,
    pub document: Arc<[u8]>,
}

/// A place of a worker, which takes the next message when this is dropped.
pub type Place = oneshot::Sender<()>;

/// What becomes of a message.
pub enum Reply {
    /// The job has ended, or is deleted.
    Acknowledge,
    /// It is to come again after a while.
    Later(Duration),
    /// Another worker has the job, and a message of its own.
    Nothing,
}

impl Reply {
    /// What becomes of a message whose entry is not at hand.
    pub fn after(trouble: Trouble) -> Self {
        match trouble {
            Trouble::OtherVersion => Self::Later(OTHERS),
            Trouble::Away => Self::Later(PAUSE),
        }
    }
}

/// Works until there has been nothing to do for the time that `options` say, or until a message on `stop`; running jobs
/// then have the grace time, which a second message cuts short. Each of the processes that `launcher` starts may take
/// `memory_mib` for a solve.
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
                // A solve that does not stop is given to another worker when this one is not heard any more.
                let _ = timeout(LAST_CALL, &mut all).await;
            }
        }
    }
    // What has been written to the connection leaves with it.
    let _ = timeout(ANSWER, worker.exchange.client.flush()).await;
    tracing::info!("stopped");
    drop(pool);
    Ok(())
}

impl Worker {
    /// Stops the running jobs, for other workers to begin again.
    fn leave_jobs(&self) {
        let jobs: Vec<_> = self.mine().values().flatten().cloned().collect();
        for job in jobs {
            let jobs = Arc::clone(&self.jobs);
            tokio::spawn(async move { jobs.leave(&job).await });
        }
    }

    /// Leaves sweeps that this worker divides to others, for it takes no more chunks itself.
    fn leave_sweeps(&self) {
        let mine = self.mine();
        let jobs: Vec<_> = mine.iter().filter(|(work, _)| matches!(work, Work::Job(_))).collect();
        for job in jobs.into_iter().filter_map(|(_, job)| job.clone()).filter(|job| job.chunks.is_some()) {
            let jobs = Arc::clone(&self.jobs);
            tokio::spawn(async move { jobs.leave(&job).await });
        }
    }

    /// Takes jobs and has them solved, one after the other. Sweeps that are divided for others go on beside them.
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

    /// Sees to a message until it is answered.
    async fn attend(self: &Arc<Self>, message: &Message, lost_after: Duration, place: Place) {
        let mut beats = interval_at(Instant::now() + lost_after / BEATS, lost_after / BEATS);
        beats.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let beating = async {
            loop {
                beats.tick().await;
                // If this is lost, the next comes in time.
                let _ = message.ack_with(AckKind::Progress).await;
            }
        };
        // Freed with the answer at the latest.
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
            // The message comes again, and its entry says that the job has ended.
            tracing::debug!(%error, "a message could not be answered");
        }
        *self.active.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    /// Whether no more jobs are to be taken.
    fn is_over(&self) -> bool {
        let idle = self.active.lock().unwrap_or_else(PoisonError::into_inner).elapsed();
        let is_idle = self.until_idle.is_some_and(|most| idle > most) && self.mine().is_empty();
        self.is_stopping.load(Relaxed) || is_idle
    }

    async fn see_to(self: &Arc<Self>, message: &Message, lost_after: Duration, place: &mut Option<Place>) -> Reply {
        let Some(work) = Work::of(&message.subject) else {
            // Another version knows what it is.
            return Reply::Later(OTHERS);
        };
        if self.mine().contains_key(&work) {
            // Its last signs of life came late.
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

    /// Solves a job, if it is small, and claims it otherwise, if it is to be solved.
    async fn solve_or_claim(&self, id: JobId, message: &Message, lost_after: Duration) -> Result<Claimed, Reply> {
        let errand = Errand::read(&message.payload);
        // A message that comes again may have ended a worker, and only a claim shows that.
        if message.info().is_ok_and(|info| info.delivered == 1)
            && let Some(errand) = &errand
            && self.solve_small(id, errand).await
        {
            return Err(Reply::Acknowledge);
        }
        self.claim(id, errand, lost_after).await
    }

    /// Solves a small job at once, which takes less time than to claim it, and writes its end; returns whether it has done so.
    /// An end is refused if the entry has changed since the message was written: another has ended the job, or claimed it.
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
            // If the answer was lost, it is found ended.
            Err(_) => return false,
        }
        true
    }

    /// Claims a job, if it is to be solved.
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

    /// Ends a job whose specification is not there.
    async fn end_unread(&self, id: JobId, entry: Entry, revision: u64) -> Reply {
        let ended = Ended::unsolved(crate::jobs::Ending::Broken(crate::jobs::Fault::Damaged));
        self.write_end(id, (entry, revision), &ended, None).await
    }

    /// Gives a job back that was claimed.
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
            // The next worker finds that this one does not have it.
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

    /// Has a job stop if a client wants it to.
    pub async fn begin(&self, job: &Arc<Job>, is_dismissed: bool) {
        self.mine().insert(Work::Job(job.id), Some(Arc::clone(job)));
        let is_cancelled = self.cancelled().contains(&job.id);
        if is_cancelled || is_dismissed {
            // Nothing on a disk is to be changed.
            let _ = self.jobs.cancel(job).await;
        }
    }

    /// Forgets a job that has ended, or been left.
    pub async fn let_go(&self, job: &Arc<Job>, is_kept: bool) {
        let id = job.id;
        // Before another job of this id: the same worker may take it again.
        let _ = self.jobs.forget(job).await;
        if is_kept {
            let _ = self.exchange.clear(&format!("progress.{id}")).await;
        }
        if self.cancelled().remove(&id) {
            let _ = self.exchange.clear(&format!("cancel.{id}")).await;
        }
    }

    /// Tells the progress of a job until it has ended, or has been left. Returns whether the progress has been written.
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
                // Who does not hear it hears the next.
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

    /// Writes results and end of a job, however long it takes.
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
                // An answer that was lost on its way is found here as well.
                Ok(Some((entry, revision))) if entry.record.ended.is_some() && entry.record.crashes + 1 == attempt => {
                    self.tell_end(id, &entry, revision).await;
                    return Reply::Acknowledge;
                }
                Ok(Some(_)) => {
                    tracing::warn!(job.id = %id, "job {id} has gone to another worker meanwhile");
                    let _ = self.exchange.remove_results(id, attempt).await;
                    return Reply::Nothing;
                }
                // The client has deleted it.
                Ok(None) => {
                    let _ = self.exchange.remove_results(id, attempt).await;
                    return Reply::Acknowledge;
                }
                Err(Trouble::OtherVersion) => return Reply::Nothing,
                Err(Trouble::Away) => sleep(PAUSE).await,
            }
        }
    }

    /// Tells gateways the end of a job, which they hear of later otherwise.
    async fn tell_end(&self, id: JobId, entry: &Entry, revision: u64) {
        let text = Errand::text(entry, revision);
        let _ = self.exchange.client.publish(self.exchange.subject("ended", id), text.into()).await;
    }

    /// The specification of the sweep that the worker last had a chunk of.
    pub fn latest(&self) -> MutexGuard<'_, Option<(JobId, Arc<[u8]>)>> {
        self.latest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The jobs and chunks that the worker has; those that it has begun to solve as jobs.
    pub fn mine(&self) -> MutexGuard<'_, HashMap<Work, Option<Arc<Job>>>> {
        self.mine.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The jobs that are to stop.
    pub fn cancelled(&self) -> MutexGuard<'_, HashSet<JobId>> {
        self.cancelled.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The end of a job with its short results, for its entry; `None` if results are longer, or there are none.
fn with_short(ended: &Ended) -> Option<(Ended, Box<RawValue>)> {
    let Some(Held::Memory(results)) = &ended.held else { return None };
    let json = short(results)?;
    Some((Ended { held: Some(Held::Table(results.fingerprint())), ..ended.clone() }, json))
}

impl Jobs {
    /// Takes a job on that another process has admitted.
    fn take_on(&self, id: JobId, record: &Record, document: Arc<[u8]>) -> Arc<Job> {
        // Keys are the business of who admits jobs.
        let record = Record { key: None, ..record.clone() };
        let job = Arc::new(Job::taken_on(id, record, None, document));
        // Without a key, nothing is in its way.
        let _ = self.store.index().insert(&job);
        self.lock().queue.push(job.client, Arc::clone(&job));
        self.arrival.notify_one();
        job
    }

    /// Stops a job, for another process to begin again.
    pub(super) async fn leave(&self, job: &Arc<Job>) {
        if job.halt(Halt::Park) {
            self.stop_chunks(job, Halt::Park).await;
        } else {
            self.take_out(job);
            self.store.park(job).await;
        }
    }
}
