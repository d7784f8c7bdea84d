//! The waiting jobs and the counts of running ones, which decide the job that an ordinary or a relief worker takes
//! next.
//!
//! At most `workers` jobs run to their end at a time. Some additional workers (`express`) give each job a *first time
//! slice*, a short time in which most jobs end: a job that has not had its slice waits only for slices of other jobs,
//! never for long runs. A job that has not ended in its slice continues if fewer than `workers` jobs run to their
//! end. Otherwise it yields: it is stopped, and starts again from the beginning when another job has ended. A *relief
//! worker* is an additional worker: while `workers` jobs run to their end, it runs a job that has used up its slice,
//! of a client that has no job running to its end.
//!
//! A restart costs at most the first slice again. To suspend the worker process instead would occupy its memory while
//! the job waits, and a thousand jobs may wait; to let the job run beside the others would take a process for each.

use super::Client;
use super::chunks::Chunk;
use super::drain_rate::DrainRate;
use super::job::Job;
use super::queue::{FairQueue, Heavy};
use super::spent::Spent;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The queue of waiting jobs and the counts of running ones, from which workers take jobs.
pub struct Intake {
    pub queue: FairQueue<Arc<Job>>,
    pub running: usize,
    /// The number of jobs that run on relief workers, which run the long jobs of clients that have no long job
    /// running.
    relieved: usize,
    /// The number of jobs that may run to their end, and not only for a first time slice; without those on relief
    /// workers (additional workers for clients that have no long job running).
    long: usize,
    /// The counts of running jobs, for each client that has any.
    of: HashMap<Client, Running>,
    spent: Spent,
    /// The largest number of jobs at a time that may run to their end, and not only for a first time slice; without
    /// those on relief workers (additional workers for clients that have no long job running).
    workers: usize,
    pub draining: bool,
    pub drain_rate: DrainRate,
}

/// The numbers of running jobs of a client.
#[derive(Debug, Default)]
struct Running {
    all: usize,
    /// The number of the client's jobs that may run to their end, and not only for a first time slice, on any worker.
    long: usize,
}

/// The terms under which a worker runs a job: for a first time slice only, or to the end of the job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lane {
    /// The job is in its first time slice, after which it may have to yield its worker.
    First,
    /// The job may run to its end, on a worker that is not a relief worker.
    Long,
    /// The job may run to its end, on a relief worker: an additional one for a client that has no long job running.
    Relief,
}

/// A job that a worker has taken from the queue.
#[derive(Debug)]
pub struct Taken {
    pub job: Arc<Job>,
    /// The next chunk of the sweep (a range of its members), if the job is a sweep that has one left.
    pub chunk: Option<Chunk>,
    pub lane: Lane,
}

/// The terms under which a job runs (for a first time slice, or to its end), which change when the slice ends.
#[derive(Debug)]
pub struct LaneCell(Mutex<Lane>);

impl LaneCell {
    /// Creates the cell of the terms of a job, which starts under the terms `lane`.
    pub fn of(lane: Lane) -> Self {
        Self(Mutex::new(lane))
    }

    /// Returns the terms under which the job currently runs: for a first time slice only, or to its end.
    pub fn get(&self) -> Lane {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the terms under which the job runs: for a first time slice only, or to its end.
    pub fn set(&self, lane: Lane) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = lane;
    }
}

/// The waiting time that is reported to a refused client before the rate at which jobs leave the queue is known.
pub const UNMEASURED: Duration = Duration::from_secs(5);

impl Heavy for Arc<Job> {
    fn bytes(&self) -> usize {
        self.document_bytes
    }
}

impl Intake {
    /// Creates the intake (queue and counts) of a service without running jobs. At most `workers` jobs may run to their
    /// end at a time, and the worker time that clients have used decays with `half_life`.
    pub fn new(queue: FairQueue<Arc<Job>>, workers: usize, half_life: Duration) -> Self {
        Self {
            queue,
            running: 0,
            relieved: 0,
            long: 0,
            of: HashMap::new(),
            spent: Spent::new(half_life),
            workers,
            draining: false,
            drain_rate: DrainRate::default(),
        }
    }

    /// Returns the number of jobs that run to their end, on ordinary or relief workers.
    pub fn long(&self) -> usize {
        self.long + self.relieved
    }

    /// Takes the next job for a worker, from the client with the fewest running jobs. While `workers` jobs run to
    /// their end, only jobs that have not had their first time slice are taken, and ties between clients go to the
    /// one with the least recent worker time: a few short jobs do not wait for the slices of many long ones.
    pub fn take(&mut self) -> Option<Taken> {
        let (now, may_be_long) = (Instant::now(), self.long < self.workers);
        let spent = |client| if may_be_long { Duration::ZERO } else { self.spent.by(client, now) };
        let load = |client| Some((self.of.get(&client).map_or(0, |of| of.all), spent(client)));
        let job = self.queue.pop(load, |job| may_be_long || !job.has_had_slice())?;
        let lane = if may_be_long { Lane::Long } else { Lane::First };
        Some(self.begin(job, lane))
    }

    /// Whether a waiting job needs a relief worker: `workers` jobs run to their end, and the waiting job has used up
    /// its first time slice, while no job of its client runs to its end.
    pub fn wants_relief(&self) -> bool {
        let waits_in_vain = |client: Client, job: &Arc<Job>| job.has_had_slice() && !has_long(&self.of, client);
        self.long >= self.workers && self.queue.any(waits_in_vain)
    }

    /// Takes a waiting job that needs a relief worker (see [`Intake::wants_relief`]) for such a worker.
    pub fn relieve(&mut self) -> Option<Taken> {
        if !self.wants_relief() {
            return None;
        }
        let (now, of, spent) = (Instant::now(), &self.of, &self.spent);
        let load = |client| (!has_long(of, client)).then(|| spent.by(client, now));
        let job = self.queue.pop(load, |job| job.has_had_slice())?;
        Some(self.begin(job, Lane::Relief))
    }

    /// Whether a job may continue at the end of its first time slice; if so, counts it as a job that runs to its end.
    pub fn goes_on(&mut self, job: &Job) -> bool {
        let may = self.draining || self.long < self.workers;
        if may {
            self.long += 1;
            self.of.entry(job.client).or_default().long += 1;
        }
        may
    }

    /// Updates the counts of running jobs, and the worker time of the client, for a job that has left its worker
    /// after `time`.
    pub fn depart(&mut self, job: &Job, lane: Lane, time: Duration) {
        let now = Instant::now();
        self.running -= 1;
        self.relieved -= usize::from(lane == Lane::Relief);
        self.long -= usize::from(lane == Lane::Long);
        if let Some(of) = self.of.get_mut(&job.client) {
            of.all -= 1;
            of.long -= usize::from(lane != Lane::First);
            if of.all == 0 {
                self.of.remove(&job.client);
            }
        }
        self.spent.add(job.client, time, now);
    }

    /// Forgets clients whose used worker time has decayed to nothing.
    pub fn forget(&mut self) {
        self.spent.forget(Instant::now());
    }

    pub fn is_idle(&self) -> bool {
        self.queue.is_empty() && self.running == 0
    }

    pub fn time_for(&self, jobs: usize) -> Duration {
        self.drain_rate.time_for(jobs, Instant::now()).unwrap_or(UNMEASURED)
    }

    /// Takes the next chunk of a sweep, whose job then returns to the queue for other workers to take the rest.
    fn begin(&mut self, job: Arc<Job>, lane: Lane) -> Taken {
        let chunk = job.chunks.as_ref().and_then(|chunks| chunks.take(self.workers));
        self.wait_again(&job);
        self.count(&job, lane);
        Taken { job, chunk, lane }
    }

    /// Puts the job of a sweep in the queue, if there are members that no worker has; returns whether it was put in
    /// the queue.
    pub fn wait_again(&mut self, job: &Arc<Job>) -> bool {
        let queues = job
            .chunks
            .as_ref()
            .is_some_and(|chunks| job.is_wanted() && !(self.draining && job.is_durable()) && chunks.queues());
        if queues {
            self.queue.push(job.client, Arc::clone(job));
        }
        queues
    }

    fn count(&mut self, job: &Job, lane: Lane) {
        self.running += 1;
        self.relieved += usize::from(lane == Lane::Relief);
        self.long += usize::from(lane == Lane::Long);
        let of = self.of.entry(job.client).or_default();
        of.all += 1;
        of.long += usize::from(lane != Lane::First);
    }
}

/// Whether a job of `client` runs to its end, on an ordinary or relief worker.
fn has_long(running: &HashMap<Client, Running>, client: Client) -> bool {
    running.get(&client).is_some_and(|of| of.long > 0)
}
