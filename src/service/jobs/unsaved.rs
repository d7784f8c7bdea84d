//! Ends of jobs that the disk has not taken, as where it is full: they stay in memory up to a bound, for when there is room
//! again. The disk knows such a job as one that has not ended, so that a start in between solves it once more.

use super::ended::Ended;
use super::job::{Job, Lifecycle, State};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Jobs whose ends are to be written.
#[derive(Debug)]
pub struct Unsaved {
    bound: usize,
    jobs: Mutex<Jobs>,
}

#[derive(Debug, Default)]
struct Jobs {
    /// Those that have ended, with their results in memory.
    ended: Vec<Arc<Job>>,
    /// The bytes of those.
    bytes: usize,
    /// Those whose results were too many, which are to be solved again.
    again: Vec<Arc<Job>>,
}

impl Unsaved {
    /// Room for so many bytes of results, and for one end whatever its size.
    pub fn new(bound: usize) -> Self {
        Self { bound, jobs: Mutex::default() }
    }

    /// Keeps the end of a job in memory, and tells it; leaves the job for later where there is too much already.
    pub fn keep(&self, job: &Arc<Job>, ended: Ended) {
        let mut jobs = self.lock();
        if jobs.ended.iter().any(|known| known.id == job.id) {
            return;
        }
        let bytes = ended.bytes();
        let mut life = job.lock();
        if jobs.bytes > 0 && jobs.bytes.saturating_add(bytes) > self.bound {
            jobs.again.push(Arc::clone(job));
            life.state = State::Accepted(None);
            life.parked = true;
        } else {
            jobs.bytes += bytes;
            jobs.ended.push(Arc::clone(job));
            life.finish(ended);
        }
        drop((jobs, life));
        job.wake();
    }

    /// How many ends are kept.
    pub fn len(&self) -> usize {
        self.lock().ended.len()
    }

    /// Whether none is kept, and none is to be solved again.
    pub fn is_empty(&self) -> bool {
        let jobs = self.lock();
        jobs.ended.is_empty() && jobs.again.is_empty()
    }

    /// The jobs whose ends are to be written.
    pub fn jobs(&self) -> Vec<Arc<Job>> {
        self.lock().ended.clone()
    }

    /// The end of a job, of so many bytes, need not be written any more, if it was kept.
    pub fn forget(&self, job: &Job, bytes: usize) {
        let mut jobs = self.lock();
        if let Some(place) = jobs.ended.iter().position(|known| known.id == job.id) {
            jobs.ended.remove(place);
            jobs.bytes -= bytes;
        }
    }

    /// Gives the jobs that are to be solved again, as they were before they were started.
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
    /// The end that has been told, if it has.
    pub fn ended(&self) -> Option<&Arc<Ended>> {
        match &self.state {
            State::Ended(ended) => Some(ended),
            State::Accepted(_) | State::Running { .. } => None,
        }
    }
}
