//! Jobs from admission to expiry: a fair bounded queue, a bounded pool of workers, and a store of jobs and results.
//!
//! 1. [`Jobs::submit`] puts a job in the store and in the queue, or returns the limit that is reached. A small
//!    problem that has no other job to wait for is solved inline instead, in this process (see `solve_inline`).
//! 2. A free [worker](crate::worker) solves the next job, chosen fairly among clients, under a deadline. A job that
//!    exceeds its first time slice may have to release its worker, and starts again from the beginning later. Of a
//!    sweep, a worker solves the next members (see `chunks`).
//! 3. The ended job is entered in the store, which deletes the oldest results, and waiting requests are woken.
//!
//! If jobs are shared with other machines (see `nats`), jobs are stored on NATS servers, solved by other processes,
//! and their ends are received from the servers.
//!
//! [`Jobs::cancel`] and [`Jobs::forget`] bypass the queue: they work when it is full. In a durable service a job that
//! was accepted asynchronously outlives the process (see the module `store`).

mod apart;
mod bounds;
mod change;
mod chunk_work;
mod chunks;
mod client;
mod crashes;
mod database;
mod disk;
mod drain_rate;
mod ended;
mod files;
mod guarded;
mod home;
mod idempotency;
mod index;
mod inspection;
mod intake;
mod job;
mod leaves;
mod marks;
mod nats;
mod overlay;
mod pool;
mod queue;
mod record;
mod reserve;
mod results;
mod row_log;
mod salvage;
mod seal;
mod shortage;
mod solve_inline;
mod spent;
mod spool;
mod stopping;
mod store;
mod tables;
mod tenancy;
mod turns;
mod unsaved;
mod watched;
mod work;
mod writer;

pub use apart::is_sound;
pub use bounds::{AdmissionError, Bounds};
pub use client::Client;
pub use ended::{Ended, Ending, Fault, Held, Timing};
pub use idempotency::Key;
pub use index::{Mismatch, Retention};
pub use inspection::Inspection;
pub use job::{Halt, Job, JobId, Moment, Order, State};
pub use nats::{Away, Gateway, Nats, WorkOptions, work};
pub use pool::Pool;
pub use queue::Room;
pub use results::{Encoded, Opened, Results, SHORT, TooLarge};
pub use salvage::{Salvaged, repair};
pub use turns::{Turn, Turns};
pub use writer::Unwritable;

pub use super::worker::Solver;

use super::metrics::Metrics;
use super::worker::Limits;
use intake::{Intake, Lane};
use jiff::Timestamp;
use job::Persistence;
use nats::Far;
use queue::FairQueue;
use record::Record;
use shortage::Shortage;
use std::ffi::OsStr;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use store::Store;
use tokio::sync::mpsc::UnboundedSender;
use tokio::sync::{Notify, RwLock};

/// All jobs of a service.
pub struct Jobs {
    solver: Solver,
    metrics: Arc<Metrics>,
    bounds: Bounds,
    intake: Mutex<Intake>,
    /// Wakes an idle worker when a job has arrived.
    arrival: Notify,
    /// Wakes a relief worker, an additional worker for the long jobs of clients that have none running, when such a
    /// job may wait.
    relief: Notify,
    store: Store,
    /// The connection to the NATS servers over which jobs are shared with other machines, and the jobs known there;
    /// `None` if jobs are not shared.
    far: Option<Far>,
    /// A lock that a job which was running when an earlier process died holds exclusively, at first, so that it runs
    /// alone; all other jobs share the lock: see [`Jobs::apart`].
    suspects: RwLock<()>,
    idle: Notify,
    /// Wakes the supervisors of workers that wait for a job, when the service stops and the supervisors are to end.
    dismissed: Notify,
    is_dismissed: AtomicBool,
    /// The shortest start-up time of any worker process so far, in nanoseconds.
    fastest_start: AtomicU64,
    panics: AtomicU64,
    shortage: Shortage,
    /// The number of live workers, and whether the last attempt to start one failed.
    living: AtomicUsize,
    unstartable: AtomicBool,
}

impl Jobs {
    /// Loads the jobs stored in `folder` and queues the unfinished ones. Without a folder no job is loaded, and none
    /// outlives the process. If `program` is given, a child process running it checks the folder first.
    ///
    /// # Errors
    /// The folder is in use, or the disk reports an I/O error.
    pub fn open(
        bounds: Bounds,
        solver: Solver,
        folder: Option<&Path>,
        program: Option<&OsStr>,
        metrics: Arc<Metrics>,
    ) -> io::Result<Self> {
        let (store, accepted) = Store::open(folder, program, bounds.retention, bounds.result_bytes, &metrics)?;
        let mut queue = FairQueue::new(bounds.queue);
        accepted.into_iter().for_each(|job| queue.push(job.client, job));
        Ok(Self::of(bounds, solver, queue, store, metrics))
    }

    /// Creates the collection of the jobs that are shared with other machines over the connection `far`; jobs that
    /// are removed from memory to make room are sent to `forgotten`.
    fn far(
        bounds: Bounds,
        solver: Solver,
        far: Far,
        forgotten: UnboundedSender<Arc<Job>>,
        metrics: Arc<Metrics>,
    ) -> io::Result<Self> {
        let (store, _) = Store::open(None, None, bounds.retention, bounds.result_bytes, &metrics)?;
        let queue = FairQueue::new(bounds.queue);
        Ok(Self { far: Some(far), ..Self::of(bounds, solver, queue, store.elsewhere(forgotten), metrics) })
    }

    fn of(bounds: Bounds, solver: Solver, queue: FairQueue<Arc<Job>>, store: Store, metrics: Arc<Metrics>) -> Self {
        Self {
            solver,
            metrics,
            bounds,
            intake: Mutex::new(Intake::new(queue, bounds.workers, bounds.wall)),
            arrival: Notify::new(),
            relief: Notify::new(),
            store,
            far: None,
            suspects: RwLock::default(),
            idle: Notify::new(),
            dismissed: Notify::new(),
            is_dismissed: AtomicBool::new(false),
            fastest_start: AtomicU64::new(u64::MAX),
            panics: AtomicU64::new(0),
            shortage: Shortage::default(),
            living: AtomicUsize::new(0),
            unstartable: AtomicBool::new(false),
        }
    }

    /// Whether a job of `client` with a specification of `document_bytes` bytes would be admitted at this moment.
    ///
    /// # Errors
    /// The limit that is reached.
    pub fn admits(&self, client: Client, document_bytes: usize) -> Result<(), AdmissionError> {
        self.admit(&self.lock(), client, document_bytes)
    }

    fn admit(&self, intake: &Intake, client: Client, document_bytes: usize) -> Result<(), AdmissionError> {
        if intake.draining {
            return Err(AdmissionError::Draining);
        }
        intake.queue.admits(client, document_bytes).map_err(|full| self.bounds.admission_error(intake, full))
    }

    /// Returns the job that the client has already posted under an idempotency key.
    ///
    /// # Errors
    /// The key belongs to a different specification, or its job is not yet on the disk.
    pub async fn recall(
        &self,
        client: Client,
        key: &Key,
        document_bytes: usize,
    ) -> Result<Option<Arc<Job>>, AdmissionError> {
        let here = self.store.index().recall(client, key)?;
        match (here, &self.far) {
            // If a job can be admitted, its admission reserves the key on the NATS servers, and then finds jobs that
            // another gateway (service process that shares jobs) has just admitted.
            (None, Some(far)) if self.admits(client, document_bytes).is_err() => {
                self.recall_far(far, client, key).await
            }
            (here, _) => here.map(known).transpose(),
        }
    }

    /// Returns the limits (steps, memory, time, size of the result) of one task on a worker.
    pub fn limits(&self) -> Limits {
        let Bounds { steps, memory, wall, result_bytes, .. } = self.bounds;
        Limits { steps, memory, wall_seconds: Some(wall.as_secs_f64()), result_bytes }
    }

    /// Admits a job, or returns the earlier job with the same idempotency key. A durable job is on the disk, if the
    /// service has a data folder, when this function returns.
    ///
    /// # Errors
    /// The limit that is reached.
    pub async fn submit(&self, order: Order, durable: bool) -> Result<Arc<Job>, AdmissionError> {
        let memory = order.facts.memory;
        if memory > self.bounds.memory {
            return Err(AdmissionError::Memory(memory));
        }
        if !durable && let Some(job) = self.try_inline(&order).await {
            return Ok(job);
        }
        if let Some(far) = &self.far {
            return self.submit_far(far, order).await;
        }
        let place = if durable { self.store.place().await? } else { None };
        let (client, document) = (order.client, Arc::clone(&order.document));
        let job = Arc::new(Job::new(order, place.is_some()));
        let answer = {
            let mut intake = self.lock();
            self.admit(&intake, client, document.len())?;
            // The intake (queue and counts) stays locked until the job is in the store, where a worker that takes the
            // job from the queue must find it.
            if let Some(first) = self.store.index().insert(&job)? {
                return known(first);
            }
            intake.queue.push(client, Arc::clone(&job));
            place.map(|place| self.store.store(&job, &mut job.lock(), document, place))
        };
        self.arrival.notify_one();
        if let Some(answer) = answer
            && let Err(unwritable) = answer.written().await
        {
            self.forget(&job).await?;
            return Err(unwritable.into());
        }
        Ok(job)
    }

    /// Makes a job durable, if the service has a data folder, once its client no longer waits for it.
    ///
    /// # Errors
    /// The job could not be written to the disk.
    pub async fn outlive(&self, job: &Arc<Job>) -> Result<(), Unwritable> {
        self.store.outlive(job).await
    }

    /// Returns the job with this id, unless it has been deleted; includes jobs that another gateway has just
    /// admitted.
    ///
    /// # Errors
    /// The servers that store the jobs do not answer.
    pub async fn look_up(&self, id: JobId) -> Result<Option<Arc<Job>>, Away> {
        match &self.far {
            Some(far) => self.look_up_far(far, id).await,
            None => Ok(self.find(id)),
        }
    }

    /// Returns the job with this id in memory, unless it has been deleted.
    pub fn find(&self, id: JobId) -> Option<Arc<Job>> {
        self.store.index().find(id)
    }

    /// Returns all jobs that have not been deleted, in no particular order.
    pub fn all(&self) -> Vec<Arc<Job>> {
        self.store.index().all()
    }

    /// Returns the posted specification of a job.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub async fn document(&self, job: &Job) -> io::Result<Arc<[u8]>> {
        match &self.far {
            Some(far) if job.document.is_none() => self.document_far(far, job).await,
            Some(_) | None => self.store.document(job),
        }
    }

    /// Returns the results of a job.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub async fn results(&self, job: &Job, held: &Held) -> io::Result<Arc<Results>> {
        let results = match (held, &self.far) {
            (Held::Memory(_), _) | (_, None) => self.store.results(job.id, held).await,
            (_, Some(far)) => self.results_far(far, job, held).await,
        };
        if let Err(error) = &results {
            self.found(job, error).await;
        }
        results
    }

    /// Records that reading the results of a job failed with `error`; damaged results are set aside and not served
    /// again.
    pub async fn found(&self, job: &Job, error: &io::Error) {
        if is_damage(error) {
            self.metrics.found_damaged();
            self.store.set_aside(job).await;
        }
    }

    /// Whether the row of the job `id` on the disk is damaged.
    pub fn is_damaged(&self, id: JobId) -> bool {
        self.store.is_damaged(id)
    }

    /// Dismisses a waiting job, asks a running job to stop at its next step, and leaves an ended job unchanged.
    ///
    /// # Errors
    /// The change could not be written to the disk, so that a later process may start the job again.
    pub async fn cancel(&self, job: &Arc<Job>) -> Result<(), Unwritable> {
        if let Some(far) = self.far.as_ref().filter(|_| job.is_durable()) {
            return self.cancel_far(far, job).await;
        }
        self.take_out(job);
        let cancelled = self.store.cancel(job).await;
        if let Some(chunks) = job.chunks.as_ref().filter(|chunks| chunks.is_dismissed()) {
            // A sweep that waited, and has rows, can end without a worker: its table is made of these rows.
            self.begin_sweep(job, chunks, Lane::Long);
        }
        self.stop_chunks(job, Halt::Dismiss).await;
        cancelled
    }

    /// Cancels a job and deletes it.
    ///
    /// # Errors
    /// The change could not be written to the disk, so that a later process will list the job again.
    pub async fn forget(&self, job: &Arc<Job>) -> Result<(), Unwritable> {
        if let Some(far) = self.far.as_ref().filter(|_| job.is_durable()) {
            return self.forget_far(far, job).await;
        }
        self.take_out(job);
        let cancelled = self.store.cancel(job).await;
        let forgotten = self.store.forget(job).await;
        self.stop_chunks(job, Halt::Dismiss).await;
        forgotten.and(cancelled)
    }

    /// Deletes the jobs whose retention time has passed at `now`.
    pub async fn expire(&self, now: Timestamp) {
        self.lock().forget();
        self.store.expire(now).await;
        if let Some(far) = &self.far {
            self.expire_far(far, now).await;
        }
    }

    /// Retries writes that a full disk refused, and queues again the jobs whose results could not be kept in memory.
    pub async fn heal(&self) {
        if let Some(taken) = self.shortage.look() {
            self.store.account(&taken);
        }
        for job in self.store.heal().await {
            if job.is_forgotten() {
                continue;
            }
            self.lock().queue.push(job.client, job);
            self.arrival.notify_one();
        }
    }

    /// Returns the number of times that the database of jobs was rebuilt.
    pub fn rebuilds(&self) -> u64 {
        self.store.rebuilds()
    }

    /// Returns the number of ended jobs whose ends wait for space on the disk.
    pub fn unsaved(&self) -> usize {
        self.store.unsaved()
    }

    /// Returns the number of jobs that will be taken from the queue before this waiting job; `None` if it does not
    /// wait.
    pub fn position(&self, job: &Job) -> Option<usize> {
        self.lock().queue.position(job.client, |waiting| waiting.id == job.id)
    }

    /// Returns the estimated time until the job ends, for `Retry-After`.
    pub fn time_to_end(&self, job: &Job) -> Duration {
        match job.state() {
            State::Accepted(_) => self.position(job).map_or(Duration::ZERO, |ahead| self.lock().time_for(ahead + 1)),
            State::Running { started, control, .. } => {
                let (done, spent) = (control.fraction(), started.clock.elapsed());
                let rest = spent.as_secs_f64() * (1.0 - done) / done;
                // The wall-clock time limit of a job bounds its remaining time; for a sweep, that limit is the limit
                // of each chunk.
                let most = if job.chunks.is_some() { Duration::MAX } else { self.bounds.wall.saturating_sub(spent) };
                Duration::try_from_secs_f64(rest).unwrap_or(spent).min(most)
            }
            State::Ended { .. } => Duration::ZERO,
        }
    }

    /// Returns the numbers of waiting and of running jobs, including chunks of sweeps that machines share.
    pub fn load(&self) -> (usize, usize) {
        let (waiting, taken) = self.far.as_ref().map_or((0, 0), |far| far.mirror().load());
        let intake = self.lock();
        (intake.queue.len() + waiting, intake.running + taken)
    }

    /// Returns the number of running jobs that may run to their end, and not only for a first time slice.
    pub fn long(&self) -> usize {
        self.lock().long()
    }

    /// Returns the number of ended jobs that are kept, and the total size of their specifications and results in
    /// bytes.
    pub fn kept(&self) -> (usize, usize) {
        self.store.index().kept()
    }

    /// Returns the total size of the waiting specifications, in bytes.
    pub fn waiting_bytes(&self) -> usize {
        self.lock().queue.bytes()
    }

    /// Returns the number of panics of the solver since the start of the service.
    pub fn panics(&self) -> u64 {
        self.panics.load(Relaxed)
    }

    /// Whether the service has stopped admitting jobs.
    pub fn is_draining(&self) -> bool {
        self.lock().draining
    }

    /// Checks that the servers over which jobs are shared, if there are any, are connected.
    ///
    /// # Errors
    /// The servers are not connected.
    pub fn near(&self) -> Result<(), Away> {
        self.far.as_ref().map_or(Ok(()), |far| far.exchange.near())
    }

    /// Whether the disk, if the service has a data folder, accepts writes, and the servers over which jobs are
    /// shared, if any, are connected.
    pub fn is_writable(&self) -> bool {
        self.store.is_writable() && self.near().is_ok()
    }

    /// Wakes a relief worker if a job waits for one: the job has used up its first time slice, and jobs of other
    /// clients occupy all workers.
    fn call_relief(&self, intake: &Intake) {
        if intake.wants_relief() {
            self.relief.notify_one();
        }
    }

    fn take_out(&self, job: &Job) {
        let mut intake = self.lock();
        intake.queue.remove(job.client, |waiting| waiting.id == job.id);
        self.announce_if_idle(&intake);
    }

    fn announce_if_idle(&self, intake: &Intake) {
        if intake.is_idle() {
            self.idle.notify_waiters();
        }
    }

    fn lock(&self) -> MutexGuard<'_, Intake> {
        self.intake.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Whether `error` says that stored data differ from what was written.
pub fn is_damage(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::InvalidData
}

/// Returns `job`, which was posted earlier under an idempotency key, or an error if it is being written to the disk
/// for the first time.
fn known(job: Arc<Job>) -> Result<Arc<Job>, AdmissionError> {
    if job.lock().persistence == Persistence::Storing { Err(AdmissionError::KeyInUse) } else { Ok(job) }
}
