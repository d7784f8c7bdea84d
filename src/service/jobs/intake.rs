//! The jobs that wait and the count of those that run: which is taken next, by a worker or in relief.
//!
//! So many jobs as there are `workers` run to their ends. There are some workers more (`express`), on which a job has a *first
//! slice*, a short time in which most are done: whatever has not had its own waits for first slices, and never for what
//! comes after them. A job that is not done in its slice goes on where it is if a place has become free to run to the end.
//! Otherwise it makes room: it is stopped, and begins again when there is such a place.
//!
//! To begin again costs at most the slice once more. To suspend its process instead would keep its memory for as long as it
//! waits, and a thousand jobs may wait; to let it go on beside the others would take a process and its memory for each.

use super::Client;
use super::drain_rate::DrainRate;
use super::job::Job;
use super::queue::{FairQueue, Heavy};
use super::spent::Spent;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// What waits and what runs.
pub struct Intake {
    pub queue: FairQueue<Arc<Job>>,
    pub running: usize,
    /// Of those, jobs in the hands of relief workers.
    relieved: usize,
    /// Of the others, jobs that run to their ends.
    long: usize,
    /// What runs, of each client that has any.
    of: HashMap<Client, Running>,
    spent: Spent,
    /// Jobs that may run to their ends at a time, beside those in relief.
    workers: usize,
    pub draining: bool,
    pub drain_rate: DrainRate,
}

/// What runs of a client.
#[derive(Debug, Default)]
struct Running {
    all: usize,
    /// Of those, jobs that run to their ends, in relief or not.
    long: usize,
}

/// How a job runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lane {
    /// In its first slice, after which it may have to make room.
    First,
    /// To its end.
    Long,
    /// The same, in the hands of a relief worker.
    Relief,
}

/// The lane of a job while it runs.
#[derive(Debug)]
pub struct LaneCell(Mutex<Lane>);

impl LaneCell {
    /// That one.
    pub fn of(lane: Lane) -> Self {
        Self(Mutex::new(lane))
    }

    /// Which it is.
    pub fn get(&self) -> Lane {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// From now on it is another.
    pub fn set(&self, lane: Lane) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = lane;
    }
}

/// What a refused client is told before any job has ended.
pub const UNMEASURED: Duration = Duration::from_secs(5);

impl Heavy for Arc<Job> {
    fn bytes(&self) -> usize {
        self.document_bytes
    }
}

impl Intake {
    /// Nothing runs yet; so many jobs may run to their ends at a time, and half of what clients have had is
    /// forgotten in that time.
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

    /// How many jobs run to their ends.
    pub fn long(&self) -> usize {
        self.long + self.relieved
    }

    /// Takes a job for a worker, of the client for whom the least runs. While as many run to their ends as may, one that has
    /// had its first slice is left, and of those clients the one goes first who has had the least of the workers lately: a
    /// few short jobs do not wait for the slices of many long ones.
    pub fn take(&mut self) -> Option<(Arc<Job>, Lane)> {
        let (now, may_be_long) = (Instant::now(), self.long < self.workers);
        let spent = |client| if may_be_long { Duration::ZERO } else { self.spent.by(client, now) };
        let load = |client| Some((self.of.get(&client).map_or(0, |of| of.all), spent(client)));
        let job = self.queue.pop(load, |job| may_be_long || !job.has_had_slice())?;
        let lane = if may_be_long { Lane::Long } else { Lane::First };
        self.begin(&job, lane);
        Some((job, lane))
    }

    /// Whether as many jobs run to their ends as may, and one waits that has had its first slice, of a client of whom none does.
    pub fn wants_relief(&self) -> bool {
        let waits_in_vain = |client: Client, job: &Arc<Job>| job.has_had_slice() && !has_long(&self.of, client);
        self.long >= self.workers && self.queue.any(waits_in_vain)
    }

    /// Takes such a job for a relief worker.
    pub fn relieve(&mut self) -> Option<Arc<Job>> {
        if !self.wants_relief() {
            return None;
        }
        let (now, of, spent) = (Instant::now(), &self.of, &self.spent);
        let load = |client| (!has_long(of, client)).then(|| spent.by(client, now));
        let job = self.queue.pop(load, |job| job.has_had_slice())?;
        self.begin(&job, Lane::Relief);
        Some(job)
    }

    /// Has a job, at the end of its first slice, go on if it may.
    pub fn goes_on(&mut self, job: &Job) -> bool {
        let may = self.draining || self.long < self.workers;
        if may {
            self.long += 1;
            self.of.entry(job.client).or_default().long += 1;
        }
        may
    }

    /// A worker is free of a job, which it had for so long.
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

    /// Lets go of what clients have had long ago.
    pub fn forget(&mut self) {
        self.spent.forget(Instant::now());
    }

    pub fn is_idle(&self) -> bool {
        self.queue.is_empty() && self.running == 0
    }

    pub fn time_for(&self, jobs: usize) -> Duration {
        self.drain_rate.time_for(jobs, Instant::now()).unwrap_or(UNMEASURED)
    }

    fn begin(&mut self, job: &Job, lane: Lane) {
        self.running += 1;
        self.relieved += usize::from(lane == Lane::Relief);
        self.long += usize::from(lane == Lane::Long);
        let of = self.of.entry(job.client).or_default();
        of.all += 1;
        of.long += usize::from(lane != Lane::First);
    }
}

/// Whether a job of `client` runs to its end.
fn has_long(running: &HashMap<Client, Running>, client: Client) -> bool {
    running.get(&client).is_some_and(|of| of.long > 0)
}
