//! The jobs that wait and the count of those that run: which is taken next, by a worker or in relief.

use super::Client;
use super::drain_rate::DrainRate;
use super::job::Job;
use super::queue::{FairQueue, Heavy};
use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What waits and what runs.
pub struct Intake {
    pub queue: FairQueue<Arc<Job>>,
    pub running: usize,
    /// The same, of each client that has any.
    pub running_of: HashMap<Client, usize>,
    /// Of those, jobs in the hands of relief workers.
    pub relieved: usize,
    pub draining: bool,
    pub drain_rate: DrainRate,
}

/// What a refused client is told before any job has ended.
pub const UNMEASURED: Duration = Duration::from_secs(5);

impl Heavy for Arc<Job> {
    fn bytes(&self) -> usize {
        self.document_bytes
    }
}

impl Intake {
    pub fn new(queue: FairQueue<Arc<Job>>) -> Self {
        let (running_of, drain_rate) = (HashMap::new(), DrainRate::default());
        Self { queue, running: 0, running_of, relieved: 0, draining: false, drain_rate }
    }

    /// Takes a job for a worker: the first of the client for whom the least runs.
    pub fn take(&mut self) -> Option<Arc<Job>> {
        let job = self.queue.pop(|client| self.running_of.get(&client).copied().unwrap_or(0))?;
        self.begin(&job);
        Some(job)
    }

    /// Whether all of so many workers are taken, and a job waits of a client for whom nothing runs.
    pub fn wants_relief(&self, workers: usize) -> bool {
        self.running - self.relieved >= workers && self.queue.any(|client| !self.running_of.contains_key(&client))
    }

    /// Takes a job for a relief worker: the first of a client for whom nothing runs.
    pub fn relieve(&mut self, workers: usize) -> Option<Arc<Job>> {
        if !self.wants_relief(workers) {
            return None;
        }
        let job = self.queue.pop_below(1, |client| self.running_of.get(&client).copied().unwrap_or(0))?;
        self.relieved += 1;
        self.begin(&job);
        Some(job)
    }

    fn begin(&mut self, job: &Job) {
        self.running += 1;
        *self.running_of.entry(job.client).or_default() += 1;
    }

    /// A worker is free of a job.
    pub fn depart(&mut self, job: &Job, relief: bool) {
        self.running -= 1;
        self.relieved -= usize::from(relief);
        if let Some(running) = self.running_of.get_mut(&job.client) {
            *running -= 1;
            if *running == 0 {
                self.running_of.remove(&job.client);
            }
        }
        self.drain_rate.departed(Instant::now());
    }

    pub fn is_idle(&self) -> bool {
        self.queue.is_empty() && self.running == 0
    }

    pub fn time_for(&self, jobs: usize) -> Duration {
        self.drain_rate.time_for(jobs, Instant::now()).unwrap_or(UNMEASURED)
    }
}
