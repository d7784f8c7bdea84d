//! The index of jobs that clients may ask for: all unfinished jobs, and the latest ended ones, bounded in number, size
//! and age. The job that ended first is forgotten first; the latest is kept whatever its size.

use super::Client;
use super::idempotency::Key;
use super::job::{Job, JobId};
use jiff::Timestamp;
use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Bounds on the ended jobs that are kept.
#[derive(Clone, Copy, Debug)]
pub struct Retention {
    /// The number of ended jobs.
    pub jobs: usize,
    /// The bytes of their specifications and results.
    pub bytes: usize,
    /// The time since their end.
    pub age: Duration,
}

/// An idempotency key was used before with a different document.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mismatch;

/// The jobs by id and by idempotency key, in memory.
#[derive(Debug)]
pub struct Index {
    retention: Retention,
    held: Mutex<Held>,
}

#[derive(Debug, Default)]
struct Held {
    jobs: HashMap<JobId, Arc<Job>>,
    keys: HashMap<(Client, String), Arc<Job>>,
    /// The ended jobs, in order of their ends.
    ended: VecDeque<Past>,
    bytes: usize,
}

#[derive(Debug)]
struct Past {
    id: JobId,
    finished: Timestamp,
    bytes: usize,
}

impl Index {
    /// An empty index.
    pub fn new(retention: Retention) -> Self {
        Self { retention, held: Mutex::default() }
    }

    /// Adds a job that has just been admitted, or returns the earlier job with the same key.
    ///
    /// # Errors
    /// A different document was posted under the key.
    pub fn insert(&self, job: &Arc<Job>) -> Result<Option<Arc<Job>>, Mismatch> {
        let mut held = self.lock();
        if let Some(key) = &job.key {
            if let Some(known) = held.recall(job.client, key)? {
                return Ok(Some(known));
            }
            held.keys.insert((job.client, key.name.clone()), Arc::clone(job));
        }
        held.jobs.insert(job.id, Arc::clone(job));
        Ok(None)
    }

    /// The job with this id, unless it is forgotten.
    pub fn find(&self, id: JobId) -> Option<Arc<Job>> {
        self.lock().jobs.get(&id).map(Arc::clone)
    }

    /// The client's job with this key.
    ///
    /// # Errors
    /// A different document was posted under the key.
    pub fn recall(&self, client: Client, key: &Key) -> Result<Option<Arc<Job>>, Mismatch> {
        self.lock().recall(client, key)
    }

    /// The number of ended jobs, and their bytes.
    pub fn kept(&self) -> (usize, usize) {
        let held = self.lock();
        (held.ended.len(), held.bytes)
    }

    /// All jobs, in no particular order.
    pub fn all(&self) -> Vec<Arc<Job>> {
        self.lock().jobs.values().map(Arc::clone).collect()
    }

    /// Counts a job as ended, with its size in `bytes`, and returns the jobs that are forgotten to make room.
    pub fn keep(&self, id: JobId, finished: Timestamp, bytes: usize) -> Vec<Arc<Job>> {
        let mut held = self.lock();
        if !held.jobs.contains_key(&id) {
            return Vec::new();
        }
        held.ended.push_back(Past { id, finished, bytes });
        held.bytes += bytes;
        let mut forgotten = Vec::new();
        while held.ended.len() > 1 && (held.ended.len() > self.retention.jobs || held.bytes > self.retention.bytes) {
            forgotten.extend(held.forget_oldest());
        }
        forgotten
    }

    /// Forgets the jobs whose retention time has passed at `now`, and returns them.
    pub fn expire(&self, now: Timestamp) -> Vec<Arc<Job>> {
        let mut held = self.lock();
        let mut forgotten = Vec::new();
        let is_old = |past: &Past| {
            now.duration_since(past.finished).try_into().is_ok_and(|age: Duration| age > self.retention.age)
        };
        while held.ended.front().is_some_and(is_old) {
            forgotten.extend(held.forget_oldest());
        }
        forgotten
    }

    /// Forgets a job, whether it has ended or not.
    pub fn forget(&self, id: JobId) {
        let mut held = self.lock();
        if held.take(id).is_some()
            && let Some(index) = held.ended.iter().position(|past| past.id == id)
            && let Some(past) = held.ended.remove(index)
        {
            held.bytes -= past.bytes;
        }
    }

    fn lock(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Held {
    fn recall(&self, client: Client, key: &Key) -> Result<Option<Arc<Job>>, Mismatch> {
        let Some(job) = self.keys.get(&(client, key.name.clone())) else { return Ok(None) };
        if job.key.as_ref() == Some(key) { Ok(Some(Arc::clone(job))) } else { Err(Mismatch) }
    }

    fn forget_oldest(&mut self) -> Option<Arc<Job>> {
        let past = self.ended.pop_front()?;
        self.bytes -= past.bytes;
        self.take(past.id)
    }

    fn take(&mut self, id: JobId) -> Option<Arc<Job>> {
        let job = self.jobs.remove(&id)?;
        if let Some(key) = &job.key {
            self.keys.remove(&(job.client, key.name.clone()));
        }
        Some(job)
    }
}
