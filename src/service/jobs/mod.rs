//! Jobs from acceptance to oblivion: a fair bounded queue, a bounded pool of workers, a store of what they made.
//!
//! 1. [`Jobs::submit`] puts a job in the store and in the queue, or says which bound is reached.
//! 2. A worker takes the first job of the client whose turn it is, and solves it under a deadline.
//! 3. The ended job is counted in the store, which forgets what is too old, and its waiters are woken.
//!
//! [`Jobs::cancel`] and [`Jobs::forget`] pass the queue by: they work when it is full.

mod drain_rate;
mod job;
mod pool;
mod queue;
mod results;
mod store;

pub use job::{Ending, Job, JobId, Moment, State};
pub use pool::Pool;
pub use queue::Client;
pub use results::{Fault, Results};
pub use store::Retention;

use super::metrics::Metrics;
use crate::problem::{Control, Stop};
use crate::solution::Solution;
use crate::specification::Specification;
use drain_rate::DrainRate;
use queue::{FairQueue, Full};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use store::Store;
use tokio::sync::{Notify, Semaphore};

/// What workers call.
pub type Solver = Arc<dyn Fn(&Specification, &Control) -> Solution + Send + Sync>;

/// How much is taken on.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Jobs that may wait.
    pub queue: usize,
    /// Of those, one client's.
    pub share: usize,
    /// Time a job may run.
    pub wall: Duration,
    /// Bytes of the JSON of one result.
    pub result_bytes: usize,
    /// How much of the past is kept.
    pub retention: Retention,
}

/// Why a job is not taken on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// Every place in the queue is taken; there should be one after this time.
    QueueFull(Duration),
    /// The client has its share of the queue; it should have a place after this time.
    ClientShare(Duration),
    /// The service is about to stop.
    Draining,
}

/// All jobs of a service.
pub struct Jobs {
    solver: Solver,
    metrics: Arc<Metrics>,
    bounds: Bounds,
    intake: Mutex<Intake>,
    /// One permit a waiting job. A job taken out of the queue leaves its permit behind: a worker that finds nothing
    /// to take goes on waiting.
    waiting: Semaphore,
    store: Store,
    idle: Notify,
    panics: AtomicU64,
}

struct Intake {
    queue: FairQueue<Arc<Job>>,
    running: usize,
    draining: bool,
    drain_rate: DrainRate,
}

/// What a refused client is told before any job has ended.
const UNMEASURED: Duration = Duration::from_secs(5);

impl Jobs {
    /// No jobs yet.
    pub fn new(bounds: Bounds, solver: Solver, metrics: Arc<Metrics>) -> Self {
        let queue = FairQueue::new(bounds.queue, bounds.share);
        Self {
            solver: Arc::clone(&metrics).measured(solver),
            metrics,
            bounds,
            intake: Mutex::new(Intake { queue, running: 0, draining: false, drain_rate: DrainRate::default() }),
            waiting: Semaphore::new(0),
            store: Store::new(bounds.retention),
            idle: Notify::new(),
            panics: AtomicU64::new(0),
        }
    }

    /// Whether a job of `client` would be taken on at this moment.
    ///
    /// # Errors
    /// The bound that is reached.
    pub fn admits(&self, client: Client) -> Result<(), Refusal> {
        let intake = self.lock();
        if intake.draining {
            return Err(Refusal::Draining);
        }
        intake.queue.admits(client).map_err(|full| self.refusal(&intake, full))
    }

    /// Takes on a job.
    ///
    /// # Errors
    /// The bound that is reached.
    pub fn submit(&self, client: Client, specification: Arc<Specification>) -> Result<Arc<Job>, Refusal> {
        let job = Arc::new(Job::new(client, specification));
        let mut intake = self.lock();
        if intake.draining {
            return Err(Refusal::Draining);
        }
        intake.queue.push(client, Arc::clone(&job)).map_err(|full| self.refusal(&intake, full))?;
        // Before the lock is given back: a worker that takes the job must find it in the store.
        self.store.insert(Arc::clone(&job));
        drop(intake);
        self.waiting.add_permits(1);
        Ok(job)
    }

    /// The job of that name, if it is not forgotten.
    pub fn find(&self, id: JobId) -> Option<Arc<Job>> {
        self.store.find(id)
    }

    /// The jobs of a client that are not forgotten, in no order.
    pub fn of_client(&self, client: Client) -> Vec<Arc<Job>> {
        self.store.all().into_iter().filter(|job| job.client == client).collect()
    }

    /// Dismisses a waiting job, asks a running one to stop at its next step, leaves an ended one as it is.
    pub fn cancel(&self, job: &Job) {
        self.lock().queue.remove(job.client, |waiting| waiting.id == job.id);
        if job.cancel() {
            self.store.keep(job.id, 0);
            self.announce_if_idle(&self.lock());
        }
    }

    /// Cancels a job and forgets it.
    pub fn forget(&self, job: &Job) {
        self.cancel(job);
        self.store.forget(job.id);
    }

    /// How many jobs will be taken before this waiting one; nothing if it does not wait.
    pub fn position(&self, job: &Job) -> Option<usize> {
        self.lock().queue.position(job.client, |waiting| waiting.id == job.id)
    }

    /// When it is worth while to ask for the job again.
    pub fn time_to_end(&self, job: &Job) -> Duration {
        match job.state() {
            State::Accepted(_) => self.position(job).map_or(Duration::ZERO, |ahead| self.lock().time_for(ahead + 1)),
            State::Running { started, control } => {
                let (done, spent) = (control.fraction(), started.clock.elapsed());
                let rest = spent.as_secs_f64() * (1.0 - done) / done;
                Duration::try_from_secs_f64(rest).unwrap_or(spent)
            }
            State::Ended { .. } => Duration::ZERO,
        }
    }

    /// How many jobs wait, and how many run.
    pub fn load(&self) -> (usize, usize) {
        let intake = self.lock();
        (intake.queue.len(), intake.running)
    }

    /// How often the solver has panicked.
    pub fn panics(&self) -> u64 {
        self.panics.load(Relaxed)
    }

    /// Whether the intake has been stopped.
    pub fn is_draining(&self) -> bool {
        self.lock().draining
    }

    /// Stops the intake; what is taken on goes on.
    pub fn drain(&self) {
        self.lock().draining = true;
    }

    /// Dismisses every waiting job and asks every running one to stop.
    pub fn cancel_all(&self) {
        for job in self.store.all() {
            self.cancel(&job);
        }
    }

    /// Returns when no job waits or runs.
    pub async fn idle(&self) {
        loop {
            let idle = self.idle.notified();
            if self.lock().is_idle() {
                return;
            }
            idle.await;
        }
    }

    /// Waits for a job and solves it on this thread. False if workers have been dismissed.
    async fn solve_next(&self) -> bool {
        match self.waiting.acquire().await {
            Ok(permit) => permit.forget(),
            Err(_) => return false,
        }
        let mut intake = self.lock();
        let Some(job) = intake.queue.pop() else { return true };
        intake.running += 1;
        drop(intake);
        self.solve(&job);
        let mut intake = self.lock();
        intake.running -= 1;
        intake.drain_rate.departed(Instant::now());
        self.announce_if_idle(&intake);
        true
    }

    /// Sends workers home, each at the end of the job in hand.
    fn dismiss_workers(&self) {
        self.waiting.close();
    }

    fn solve(&self, job: &Job) {
        let Some((specification, control)) = job.start(self.bounds.wall) else { return };
        self.metrics.waited(job.created.clock.elapsed());
        let _span = tracing::info_span!("job", job.id = %job.id).entered();
        let solved = catch_unwind(AssertUnwindSafe(|| {
            Results::of((self.solver)(&specification, &control), self.bounds.result_bytes)
        }));
        let ending = match solved {
            Ok(Ok(results)) => Ending::of(results, control.poll() == Some(Stop::Cancelled)),
            Ok(Err(fault)) => Ending::Broken(fault),
            Err(panic) => {
                self.panics.fetch_add(1, Relaxed);
                let message = message(&*panic);
                tracing::error!(job.id = %job.id, panic.message = message, "the solver panicked in job {}", job.id);
                Ending::Broken(Fault::Panicked)
            }
        };
        // Kept before anyone is woken: whoever sees the end of a job finds the store within its bounds.
        self.store.keep(job.id, ending.bytes());
        job.finish(ending);
        tracing::debug!("the job has ended");
    }

    fn refusal(&self, intake: &Intake, full: Full) -> Refusal {
        // One in ten of the places: whoever comes back then finds one, even if others come back too.
        match full {
            Full::Queue => Refusal::QueueFull(intake.time_for(self.bounds.queue.div_ceil(10))),
            Full::Share => {
                Refusal::ClientShare(intake.time_for(self.bounds.share.div_ceil(10) * intake.queue.clients()))
            }
        }
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

impl Intake {
    fn is_idle(&self) -> bool {
        self.queue.is_empty() && self.running == 0
    }

    fn time_for(&self, jobs: usize) -> Duration {
        self.drain_rate.time_for(jobs, Instant::now()).unwrap_or(UNMEASURED)
    }
}

/// What a panic said.
fn message(panic: &(dyn Any + Send)) -> &str {
    match (panic.downcast_ref::<&str>(), panic.downcast_ref::<String>()) {
        (Some(text), _) => text,
        (None, Some(text)) => text,
        (None, None) => "no message",
    }
}
