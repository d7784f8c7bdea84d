//! The jobs that clients may ask for: all that have not ended, and the latest that have, up to a number and a size.
//! The oldest ending is forgotten first; the latest is always kept, whatever its size.

use super::job::{Job, JobId};
use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// How much of the past is kept.
#[derive(Clone, Copy, Debug)]
pub struct Retention {
    /// Ended jobs.
    pub jobs: usize,
    /// Bytes of their results.
    pub bytes: usize,
}

/// Jobs by name, in memory.
#[derive(Debug)]
pub struct Store {
    retention: Retention,
    held: Mutex<Held>,
}

#[derive(Debug, Default)]
struct Held {
    jobs: HashMap<JobId, Arc<Job>>,
    /// Ended jobs with the bytes each takes, oldest ending first.
    ended: VecDeque<(JobId, usize)>,
    bytes: usize,
}

impl Store {
    /// An empty store.
    pub fn new(retention: Retention) -> Self {
        Self { retention, held: Mutex::default() }
    }

    /// Takes in a job that has just been accepted.
    pub fn insert(&self, job: Arc<Job>) {
        self.lock().jobs.insert(job.id, job);
    }

    /// The job of that name, if it is not forgotten.
    pub fn find(&self, id: JobId) -> Option<Arc<Job>> {
        self.lock().jobs.get(&id).map(Arc::clone)
    }

    /// Every job, in no order.
    pub fn all(&self) -> Vec<Arc<Job>> {
        self.lock().jobs.values().map(Arc::clone).collect()
    }

    /// Counts a job as ended, with the bytes of its result, and forgets what is then too old.
    pub fn keep(&self, id: JobId, bytes: usize) {
        let mut held = self.lock();
        if !held.jobs.contains_key(&id) {
            return;
        }
        held.ended.push_back((id, bytes));
        held.bytes += bytes;
        while held.ended.len() > 1 && (held.ended.len() > self.retention.jobs || held.bytes > self.retention.bytes) {
            if let Some((oldest, bytes)) = held.ended.pop_front() {
                held.jobs.remove(&oldest);
                held.bytes -= bytes;
            }
        }
    }

    /// Forgets a job, ended or not.
    pub fn forget(&self, id: JobId) {
        let mut held = self.lock();
        if held.jobs.remove(&id).is_some()
            && let Some(index) = held.ended.iter().position(|(ended, _)| *ended == id)
            && let Some((_, bytes)) = held.ended.remove(index)
        {
            held.bytes -= bytes;
        }
    }

    fn lock(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
