//! Jobs from acceptance to oblivion: a fair bounded queue, a bounded pool of workers, a store of what they made.
//!
//! 1. [`Jobs::submit`] puts a job in the store and in the queue, or says which bound is reached.
//!    One that nobody has to wait for is solved at a glance instead.
//! 2. Where a [worker](crate::worker) is free, it solves the first job of the client whose turn it is, under a deadline. One
//!    that takes longer than a first slice may have to make room for others, and begins again.
//! 3. The ended job is counted in the store, which forgets what is too old, and its waiters are woken.
//!
//! [`Jobs::cancel`] and [`Jobs::forget`] pass the queue by: they work when it is full. In a durable service a job that
//! was accepted to be waited for elsewhere outlives the process: see [`store`](self).

mod apart;
mod bounds;
mod change;
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
mod overlay;
mod pool;
mod queue;
mod record;
mod reserve;
mod results;
mod salvage;
mod seal;
mod shortage;
mod solve_inline;
mod spent;
mod spool;
mod stopping;
mod store;
mod tables;
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
pub(crate) use idempotency::hexadecimal;
pub use index::{Mismatch, Retention};
pub use inspection::Inspection;
pub use job::{Halt, Job, JobId, Moment, Order, State};
pub use pool::Pool;
pub use queue::Room;
pub use results::{Encoded, Opened, Results, SHORT, TooLarge};
pub use salvage::{Salvaged, repair};
pub use turns::{Turn, Turns};
pub use writer::Unwritable;

pub use super::worker::Solver;

use super::metrics::Metrics;
use super::worker::Limits;
use intake::Intake;
use jiff::Timestamp;
use job::Persistence;
use problem::Control;
use queue::FairQueue;
use record::Record;
use shortage::Shortage;
use specification::{Draft, Specification, SpecificationError};
use std::ffi::OsStr;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use store::Store;
use tokio::sync::{Notify, RwLock};

/// All jobs of a service.
pub struct Jobs {
    solver: Solver,
    metrics: Arc<Metrics>,
    bounds: Bounds,
    intake: Mutex<Intake>,
    /// Wakes a worker that waits, since a job has come in.
    arrival: Notify,
    /// Wakes a relief worker that may have something to do.
    relief: Notify,
    store: Store,
    /// A job that was running when a process ended may have ended it: nothing runs beside it.
    suspects: RwLock<()>,
    idle: Notify,
    /// Wakes supervisors that wait for a worker when they are to go.
    dismissed: Notify,
    is_dismissed: AtomicBool,
    /// The shortest time in which a worker has started, in nanoseconds.
    fastest_start: AtomicU64,
    panics: AtomicU64,
    shortage: Shortage,
    /// Workers that live, and whether the last attempt to start one failed.
    living: AtomicUsize,
    unstartable: AtomicBool,
}

impl Jobs {
    /// The jobs of `folder`, those that have not ended in the queue; without a folder none, and none will outlive the
    /// process. Where there is a `program`, a process of it looks at the folder first.
    ///
    /// # Errors
    /// The folder is in use, or those of the disk.
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
        Ok(Self {
            solver,
            metrics,
            bounds,
            intake: Mutex::new(Intake::new(queue, bounds.workers, bounds.wall)),
            arrival: Notify::new(),
            relief: Notify::new(),
            store,
            suspects: RwLock::default(),
            idle: Notify::new(),
            dismissed: Notify::new(),
            is_dismissed: AtomicBool::new(false),
            fastest_start: AtomicU64::new(u64::MAX),
            panics: AtomicU64::new(0),
            shortage: Shortage::default(),
            living: AtomicUsize::new(0),
            unstartable: AtomicBool::new(false),
        })
    }

    /// Whether a job of `client` with a document of so many bytes would be taken on at this moment.
    ///
    /// # Errors
    /// The bound that is reached.
    pub fn admits(&self, client: Client, document_bytes: usize) -> Result<(), AdmissionError> {
        self.admit(&self.lock(), client, document_bytes)
    }

    fn admit(&self, intake: &Intake, client: Client, document_bytes: usize) -> Result<(), AdmissionError> {
        if intake.draining {
            return Err(AdmissionError::Draining);
        }
        intake.queue.admits(client, document_bytes).map_err(|full| self.bounds.refusal(intake, full))
    }

    /// The job that the client has already posted under that key.
    ///
    /// # Errors
    /// The key stands for something else, or its job is not yet on the disk.
    pub fn recall(&self, client: Client, key: &Key) -> Result<Option<Arc<Job>>, AdmissionError> {
        self.store.index().recall(client, key)?.map(known).transpose()
    }

    /// What a task may take of a worker.
    pub fn limits(&self) -> Limits {
        let Bounds { steps, memory, wall, result_bytes, .. } = self.bounds;
        Limits { steps, memory, wall_seconds: Some(wall.as_secs_f64()), result_bytes }
    }

    /// Checks a document as one that is to be solved here.
    ///
    /// # Errors
    /// All that is wrong with it.
    pub fn check(&self, draft: Draft, control: &Control) -> Result<Specification, Vec<SpecificationError>> {
        self.limits().check(draft, control)
    }

    /// Takes on a job, or gives the one that was posted before under its key. One that is to be `lasting` is on the disk,
    /// if there is one, when this returns.
    ///
    /// # Errors
    /// The bound that is reached.
    pub async fn submit(&self, order: Order, lasting: bool) -> Result<Arc<Job>, AdmissionError> {
        let memory = order.facts.memory;
        if memory > self.bounds.memory {
            return Err(AdmissionError::Memory(memory));
        }
        if !lasting && let Some(job) = self.solve_at_a_glance(&order).await {
            return Ok(job);
        }
        let place = if lasting { self.store.place().await? } else { None };
        let (client, document) = (order.client, Arc::clone(&order.document));
        let job = Arc::new(Job::new(order, place.is_some()));
        let answer = {
            let mut intake = self.lock();
            self.admit(&intake, client, document.len())?;
            // Before the lock is given back: a worker that takes the job must find it in the store.
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

    /// Gives a job to the disk, if there is one, that was to be waited for and takes longer.
    ///
    /// # Errors
    /// The disk did not take it.
    pub async fn outlive(&self, job: &Arc<Job>) -> Result<(), Unwritable> {
        self.store.outlive(job).await
    }

    /// The job of that name, if it is not forgotten.
    pub fn find(&self, id: JobId) -> Option<Arc<Job>> {
        self.store.index().find(id)
    }

    /// Every job that is not forgotten, in no order.
    pub fn all(&self) -> Vec<Arc<Job>> {
        self.store.index().all()
    }

    /// What was posted for a job.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn document(&self, job: &Job) -> io::Result<Arc<[u8]>> {
        self.store.document(job)
    }

    /// What a job left.
    ///
    /// # Errors
    /// Those of the disk.
    pub async fn results(&self, job: &Job, held: &Held) -> io::Result<Arc<Results>> {
        let results = self.store.results(job.id, held).await;
        if let Err(error) = &results {
            self.found(job, error).await;
        }
        results
    }

    /// Takes note that the results of a job could not be read for this reason: those that are damaged are not shown again.
    pub async fn found(&self, job: &Job, error: &io::Error) {
        if is_damage(error) {
            self.metrics.found_damaged();
            self.store.set_aside(job).await;
        }
    }

    /// Whether that name is of a job whose row on the disk is damaged.
    pub fn is_damaged(&self, id: JobId) -> bool {
        self.store.is_damaged(id)
    }

    /// Dismisses a waiting job, asks a running one to stop at its next step, leaves an ended one as it is.
    ///
    /// # Errors
    /// The disk did not take the news, so that a later process may start the job again.
    pub async fn cancel(&self, job: &Arc<Job>) -> Result<(), Unwritable> {
        self.take_out(job);
        self.store.cancel(job).await
    }

    /// Cancels a job and forgets it.
    ///
    /// # Errors
    /// The disk did not take the news, so that a later process knows the job again.
    pub async fn forget(&self, job: &Arc<Job>) -> Result<(), Unwritable> {
        self.take_out(job);
        let cancelled = self.store.cancel(job).await;
        self.store.forget(job).await.and(cancelled)
    }

    /// Forgets the jobs that ended too long before `now`.
    pub async fn expire(&self, now: Timestamp) {
        self.lock().forget();
        self.store.expire(now).await;
    }

    /// Tries to write again what a full disk did not take, and has solved again what there was no memory to keep.
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

    /// How often the database was built anew.
    pub fn rebuilds(&self) -> u64 {
        self.store.rebuilds()
    }

    /// How many ends of jobs wait for room on the disk.
    pub fn unsaved(&self) -> usize {
        self.store.unsaved()
    }

    /// How many jobs will be taken before this waiting one; nothing if it does not wait.
    pub fn position(&self, job: &Job) -> Option<usize> {
        self.lock().queue.position(job.client, |waiting| waiting.id == job.id)
    }

    /// When it is worth while to ask for the job again.
    pub fn time_to_end(&self, job: &Job) -> Duration {
        match job.state() {
            State::Accepted(_) => self.position(job).map_or(Duration::ZERO, |ahead| self.lock().time_for(ahead + 1)),
            State::Running { started, control, .. } => {
                let (done, spent) = (control.fraction(), started.clock.elapsed());
                let rest = spent.as_secs_f64() * (1.0 - done) / done;
                // Longer than it may take it does not.
                let most = self.bounds.wall.saturating_sub(spent);
                Duration::try_from_secs_f64(rest).unwrap_or(spent).min(most)
            }
            State::Ended { .. } => Duration::ZERO,
        }
    }

    /// How many jobs wait, and how many run.
    pub fn load(&self) -> (usize, usize) {
        let intake = self.lock();
        (intake.queue.len(), intake.running)
    }

    /// How many of the jobs that run have not to make room for others.
    pub fn long(&self) -> usize {
        self.lock().long()
    }

    /// How many ended jobs are kept, and the bytes of their specifications and results.
    pub fn kept(&self) -> (usize, usize) {
        self.store.index().kept()
    }

    /// The bytes of the specifications that wait.
    pub fn waiting_bytes(&self) -> usize {
        self.lock().queue.bytes()
    }

    /// How often the solver has panicked.
    pub fn panics(&self) -> u64 {
        self.panics.load(Relaxed)
    }

    /// Whether the intake has been stopped.
    pub fn is_draining(&self) -> bool {
        self.lock().draining
    }

    /// Whether the disk, if there is one, takes what it is given.
    pub fn is_writable(&self) -> bool {
        self.store.is_writable()
    }

    /// Wakes a relief worker, if there is something for it.
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

/// Whether what is stored is not what was written.
pub fn is_damage(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::InvalidData
}

/// The job that was posted before, once it is where it is to be.
fn known(job: Arc<Job>) -> Result<Arc<Job>, AdmissionError> {
    if job.lock().keeping == Persistence::Storing { Err(AdmissionError::KeyInUse) } else { Ok(job) }
}
