//! The index of the jobs that clients may ask for: all unfinished jobs, and the latest ended ones, limited in number,
//! size and age. The job that ended first is deleted first; the latest is kept whatever its size. Ended jobs in
//! memory have a size limit of their own, beyond which the first of them is deleted, and none of those on the disk.

use super::Client;
use super::idempotency::Key;
use super::job::{Job, JobId};
use jiff::Timestamp;
use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The limits on the ended jobs that are kept.
#[derive(Clone, Copy, Debug)]
pub struct Retention {
    /// The largest number of ended jobs that are kept.
    pub jobs: usize,
    /// The largest total size of the specifications and results of ended jobs, in bytes.
    pub bytes: usize,
    /// The longest time for which a job is kept after its end.
    pub age: Duration,
}

/// The size of the specification and results of an ended job, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// The size of the job's specification and results.
    pub bytes: usize,
    /// The part of `bytes` that is in memory; 0 for a job on the disk.
    pub resident: usize,
}

/// The error that an idempotency key was used earlier with a different specification.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mismatch;

/// The jobs that the service has in memory, by id and by idempotency key.
#[derive(Debug)]
pub struct Index {
    retention: Retention,
    /// The largest total size of ended jobs in memory, in bytes.
    most_resident: usize,
    held: Mutex<Held>,
}

#[derive(Debug, Default)]
struct Held {
    jobs: HashMap<JobId, Arc<Job>>,
    keys: HashMap<(Client, String), Arc<Job>>,
    /// The ended jobs on the disk and those in memory, each list in order of their ends.
    ended: [VecDeque<Past>; 2],
    bytes: usize,
    resident: usize,
}

/// The indices of the two lists of ended jobs in [`Held::ended`].
const ON_DISK: usize = 0;
const IN_MEMORY: usize = 1;

#[derive(Debug)]
struct Past {
    id: JobId,
    finished: Timestamp,
    size: Size,
}

impl Index {
    /// Creates an empty index, which keeps ended jobs of at most `most_resident` bytes in memory.
    pub fn new(retention: Retention, most_resident: usize) -> Self {
        Self { retention, most_resident, held: Mutex::default() }
    }

    /// Adds a job that has just been admitted, or returns the client's earlier job with the same idempotency key.
    ///
    /// # Errors
    /// A different specification was posted under the key.
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

    /// Returns the job with this id, unless it has been deleted.
    pub fn find(&self, id: JobId) -> Option<Arc<Job>> {
        self.lock().jobs.get(&id).map(Arc::clone)
    }

    /// Returns the client's job with this idempotency key.
    ///
    /// # Errors
    /// A different specification was posted under the key.
    pub fn recall(&self, client: Client, key: &Key) -> Result<Option<Arc<Job>>, Mismatch> {
        self.lock().recall(client, key)
    }

    /// Returns the number of ended jobs that are kept, and their total size in bytes.
    pub fn kept(&self) -> (usize, usize) {
        let held = self.lock();
        (held.count(), held.bytes)
    }

    /// Returns all jobs in memory, in no particular order.
    pub fn all(&self) -> Vec<Arc<Job>> {
        self.lock().jobs.values().map(Arc::clone).collect()
    }

    /// Counts a job as ended, with its size; removes ended jobs to make room, and returns them.
    pub fn keep(&self, id: JobId, finished: Timestamp, size: Size) -> Vec<Arc<Job>> {
        let mut held = self.lock();
        if !held.jobs.contains_key(&id) {
            return Vec::new();
        }
        held.ended[if size.resident > 0 { IN_MEMORY } else { ON_DISK }].push_back(Past { id, finished, size });
        held.bytes += size.bytes;
        held.resident += size.resident;
        let mut forgotten = Vec::new();
        while held.ended[IN_MEMORY].len() > 1 && held.resident > self.most_resident {
            forgotten.extend(held.forget_first(IN_MEMORY));
        }
        while held.count() > 1 && (held.count() > self.retention.jobs || held.bytes > self.retention.bytes) {
            let Some((place, _)) = held.oldest() else { break };
            forgotten.extend(held.forget_first(place));
        }
        forgotten
    }

    /// Removes the ended jobs whose retention time has passed at `now`, and returns them.
    pub fn expire(&self, now: Timestamp) -> Vec<Arc<Job>> {
        let mut held = self.lock();
        let mut forgotten = Vec::new();
        let is_old = |past: &Past| {
            now.duration_since(past.finished).try_into().is_ok_and(|age: Duration| age > self.retention.age)
        };
        while let Some((place, _)) = held.oldest().filter(|(_, past)| is_old(past)) {
            forgotten.extend(held.forget_first(place));
        }
        forgotten
    }

    /// Removes a job from the index of jobs, whether it has ended or not.
    pub fn forget(&self, id: JobId) {
        let mut held = self.lock();
        if held.take(id).is_none() {
            return;
        }
        for place in [ON_DISK, IN_MEMORY] {
            if let Some(index) = held.ended[place].iter().position(|past| past.id == id)
                && let Some(past) = held.ended[place].remove(index)
            {
                held.count_out(past.size);
            }
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

    /// Returns the number of ended jobs that are kept.
    fn count(&self) -> usize {
        self.ended.iter().map(VecDeque::len).sum()
    }

    /// Returns the kept job that ended first, with the index of its list: on the disk or in memory.
    fn oldest(&self) -> Option<(usize, &Past)> {
        let first = |place: usize| self.ended[place].front().map(|past| (place, past));
        [ON_DISK, IN_MEMORY].into_iter().filter_map(first).min_by_key(|(_, past)| past.finished)
    }

    fn forget_first(&mut self, place: usize) -> Option<Arc<Job>> {
        let past = self.ended[place].pop_front()?;
        self.count_out(past.size);
        self.take(past.id)
    }

    fn count_out(&mut self, size: Size) {
        self.bytes -= size.bytes;
        self.resident -= size.resident;
    }

    fn take(&mut self, id: JobId) -> Option<Arc<Job>> {
        let job = self.jobs.remove(&id)?;
        if let Some(key) = &job.key {
            self.keys.remove(&(job.client, key.name.clone()));
        }
        Some(job)
    }
}
