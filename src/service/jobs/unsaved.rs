//! Ends of jobs that the disk has refused, for instance since it is full: they stay in memory, up to a size limit,
//! until there is space. On the disk such a job is unfinished, so that a restart in between solves it again.

use super::ended::Ended;
use super::job::{Job, Lifecycle, State};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The jobs whose ends the disk has refused and which wait to be written to it.
#[derive(Debug)]
pub struct Unsaved {
    bound: usize,
    jobs: Mutex<Jobs>,
}

#[derive(Debug, Default)]
struct Jobs {
    /// The jobs that have ended and whose ends the disk has refused, with their results in memory.
    ended: Vec<Arc<Job>>,
    /// The total size in bytes of the results in memory of jobs whose ends the disk has refused.
    bytes: usize,
    /// The jobs whose results did not fit in memory, which are to be solved again.
    again: Vec<Arc<Job>>,
}

impl Unsaved {
    /// Creates an empty list of refused ends, with room in memory for `bound` bytes of results, and for a single end
    /// whatever its size.
    pub fn new(bound: usize) -> Self {
        Self { bound, jobs: Mutex::default() }
    }

    /// Keeps in memory the end of a job that the disk has refused, and reports the end; if the size limit is reached,
    /// parks the job instead, to be solved again.
    pub fn keep(&self, job: &Arc<Job>, ended: Ended) {
        let mut jobs = self.lock();
        if jobs.ended.iter().any(|known| known.id == job.id) {
            return;
        }
        let bytes = ended.bytes();
        let mut lifecycle = job.lock();
        lifecycle.is_ending = false;
        if jobs.bytes > 0 && jobs.bytes.saturating_add(bytes) > self.bound {
            jobs.again.push(Arc::clone(job));
            lifecycle.state = State::Accepted(None);
            lifecycle.parked = true;
        } else {
            jobs.bytes += bytes;
            jobs.ended.push(Arc::clone(job));
            lifecycle.finish(ended);
        }
        drop((jobs, lifecycle));
        job.wake();
    }

    /// Returns the number of ends of jobs that wait to be written to the disk.
    pub fn len(&self) -> usize {
        self.lock().ended.len()
    }

    /// Whether no end of a job waits to be written to the disk, and no job is to be solved again.
    pub fn is_empty(&self) -> bool {
        let jobs = self.lock();
        jobs.ended.is_empty() && jobs.again.is_empty()
    }

    /// Returns the jobs whose ends wait to be written to the disk.
    pub fn jobs(&self) -> Vec<Arc<Job>> {
        self.lock().ended.clone()
    }

    /// Drops the end of a job, with results of `bytes` bytes, if it waited to be written to the disk.
    pub fn forget(&self, job: &Job, bytes: usize) {
        let mut jobs = self.lock();
        if let Some(place) = jobs.ended.iter().position(|known| known.id == job.id) {
            jobs.ended.remove(place);
            jobs.bytes -= bytes;
        }
    }

    /// Takes the jobs that are to be solved again, since their results did not fit in memory, as waiting jobs.
    pub fn take_again(&self) -> Vec<Arc<Job>> {
        let jobs = std::mem::take(&mut self.lock().again);
        jobs.iter().for_each(|job| job.lock().parked = false);
        jobs
    }

    fn lock(&self) -> MutexGuard<'_, Jobs> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Lifecycle {
    /// Returns the end that the job reports to clients, if it has ended.
    pub fn ended(&self) -> Option<&Arc<Ended>> {
        match &self.state {
            State::Ended(ended) => Some(ended),
            State::Accepted(_) | State::Running { .. } => None,
        }
    }
}
