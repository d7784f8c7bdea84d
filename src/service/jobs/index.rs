//! The jobs that clients may ask for: all that have not ended, and the latest that have, up to a number, a size and an
//! age. The oldest ending is forgotten first; the latest is kept whatever its size.

use super::Client;
use super::idempotency::Key;
use super::job::{Job, JobId};
use jiff::Timestamp;
use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How much of the past is kept.
#[derive(Clone, Copy, Debug)]
pub struct Retention {
    /// Ended jobs.
    pub jobs: usize,
    /// Bytes of their results.
    pub bytes: usize,
    /// Time since their end.
    pub age: Duration,
}

/// A key stands for something else that was posted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mismatch;

/// Jobs by name and by key, in memory.
#[derive(Debug)]
pub struct Index {
    retention: Retention,
    held: Mutex<Held>,
}

#[derive(Debug, Default)]
struct Held {
    jobs: HashMap<JobId, Arc<Job>>,
    keys: HashMap<(Client, String), Arc<Job>>,
    /// Ended jobs, oldest ending first.
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
    /// No jobs yet.
    pub fn new(retention: Retention) -> Self {
        Self { retention, held: Mutex::default() }
    }

    /// Takes in a job that has just been accepted; gives back the one that came before it under the same key.
    ///
    /// # Errors
    /// Something else was posted under the key.
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

    /// The job of that name, if it is not forgotten.
    pub fn find(&self, id: JobId) -> Option<Arc<Job>> {
        self.lock().jobs.get(&id).map(Arc::clone)
    }

    /// The job under that key.
    ///
    /// # Errors
    /// Something else was posted under the key.
    pub fn recall(&self, client: Client, key: &Key) -> Result<Option<Arc<Job>>, Mismatch> {
        self.lock().recall(client, key)
    }

    /// How many ended jobs there are, and their bytes.
    pub fn kept(&self) -> (usize, usize) {
        let held = self.lock();
        (held.ended.len(), held.bytes)
    }

    /// Every job, in no order.
    pub fn all(&self) -> Vec<Arc<Job>> {
        self.lock().jobs.values().map(Arc::clone).collect()
    }

    /// Counts a job as ended, with the bytes of its result, and gives those that are forgotten for it.
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

    /// Gives those that are forgotten for their age at this time.
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

    /// Forgets a job, ended or not.
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
