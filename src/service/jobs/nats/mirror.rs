//! The mirror of a gateway: every entry of the bucket of states as a job in memory, in the index and, while it waits,
//! in the queue, from which no worker of this process takes jobs. The requests of clients are answered from the
//! mirror, as by a service on one machine. An entry that another process has just written may still be on its way: a
//! request for a job that is not in memory is answered from the bucket.

use super::entry::Entry;
use super::gateway::Far;
use super::open_parts::OpenParts;
use super::parts::{Part, PartId};
use crate::compiled::Generations;
use crate::jobs::ended::Timing;
use crate::jobs::job::{Lifecycle, Moment, Persistence};
use crate::jobs::{Client, Ended, Ending, Job, JobId, Jobs, State};
use crate::worker::Progress;
use jiff::Timestamp;
use problem::Control;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::ops::Bound;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

/// The last known state of each job on the NATS servers.
#[derive(Debug, Default)]
pub struct Mirror {
    jobs: HashMap<JobId, Seen>,
    running: BTreeMap<JobId, Client>,
    /// The last of the running jobs whose client was named to an idle worker.
    named: Option<JobId>,
    /// The jobs that were deleted, with the times of deletion: their remains in the bucket of states are removed
    /// after a while.
    gone: VecDeque<(Timestamp, JobId)>,
    /// Short results that were received recently, for the clients that wait for them.
    short: Short,
    /// The unfinished chunks of sweeps that workers share.
    parts: OpenParts,
}

/// A cache of short results by the ids of their jobs.
#[derive(Debug)]
struct Short(Generations<Arc<RawValue>>);

impl Default for Short {
    fn default() -> Self {
        Self(Generations::new(KEPT_RESULTS))
    }
}

/// The number of short results that are kept: sixteen megabytes at most.
const KEPT_RESULTS: usize = 1024;

/// The time for which the bucket of states records that a job was deleted, for gateways that are cut off from the
/// servers meanwhile.
const GONE: Duration = Duration::from_secs(24 * 3600);

#[derive(Debug)]
struct Seen {
    revision: u64,
    phase: Phase,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Waiting,
    /// The job is running; the value is the number of crashes before the current attempt.
    Running(u32),
    Ended,
    Gone,
}

/// The progress of an attempt to solve a job, as workers publish it.
#[derive(Debug, Serialize, Deserialize)]
pub struct Told {
    /// The number of the attempt to solve the job, counted from one.
    pub attempt: u32,
    /// The progress of the attempt at the job, with the latest events of the trajectory.
    pub progress: Progress,
}

impl Mirror {
    /// Adds a job that this gateway has put into the NATS queue.
    pub fn admitted(&mut self, id: JobId) {
        self.jobs.insert(id, Seen { revision: 0, phase: Phase::Waiting });
    }

    /// Returns the number of chunks that wait for a worker, and the number of jobs and chunks that workers have.
    pub fn load(&self) -> (usize, usize) {
        let (waiting, claimed) = self.parts.count();
        (waiting, self.running.len() + claimed)
    }

    /// Updates the state of a chunk of a sweep by its new entry; `None` if the entry was deleted.
    pub fn part_came(&mut self, id: PartId, part: Option<&Part>) {
        let sweep = self.jobs.get(&id.sweep);
        // The entry of a chunk that comes after the end of its sweep is ignored.
        if !sweep.is_some_and(|sweep| matches!(sweep.phase, Phase::Ended | Phase::Gone)) {
            self.parts.came(id, part);
        }
    }

    /// Returns the short results of a job, if they were received recently.
    pub fn short_results(&mut self, id: JobId) -> Option<Arc<RawValue>> {
        self.short.0.find(&id.number().to_le_bytes())
    }

    /// Removes and returns the deleted jobs whose deletion need not be recorded any more.
    pub fn forget_gone(&mut self, now: Timestamp) -> Vec<JobId> {
        let mut forgotten = Vec::new();
        while let Some((when, id)) = self.gone.front().copied()
            && now.duration_since(when).try_into().is_ok_and(|age: Duration| age > GONE)
        {
            self.gone.pop_front();
            self.jobs.remove(&id);
            forgotten.push(id);
        }
        forgotten
    }

    /// Returns the jobs that workers are solving.
    pub fn running_jobs(&self) -> Vec<JobId> {
        self.running.keys().copied().collect()
    }

    /// Returns up to `most` sweeps with chunks that wait for a worker.
    pub fn sweeps_that_wait(&self, most: usize) -> Vec<JobId> {
        self.parts.sweeps_that_wait().take(most).collect()
    }

    /// Returns the clients of up to `most` running jobs, after the job that was named last.
    pub fn next_running(&mut self, most: usize) -> Vec<Client> {
        let behind = self.named.map_or(Bound::Unbounded, Bound::Excluded);
        let rest = self.running.range((behind, Bound::Unbounded));
        let next: Vec<(JobId, Client)> =
            rest.chain(&self.running).take(most.min(self.running.len())).map(|(id, client)| (*id, *client)).collect();
        self.named = next.last().map(|(id, _)| *id);
        next.into_iter().map(|(_, client)| client).collect()
    }
}

impl Jobs {
    /// Updates the known state of a job by its entry, unless a later entry has been seen, and returns the job; `None`
    /// if it has been deleted.
    pub(super) async fn take_over(&self, far: &Far, id: JobId, entry: Entry, revision: u64) -> Option<Arc<Job>> {
        let (job, forgotten) = self.mirror(far, id, entry, revision);
        self.store.tidy(forgotten).await;
        job
    }

    fn mirror(&self, far: &Far, id: JobId, entry: Entry, revision: u64) -> (Option<Arc<Job>>, Vec<Arc<Job>>) {
        let mut mirror = far.mirror();
        let before = mirror.jobs.get(&id).map(|seen| (seen.revision, seen.phase));
        if before.is_some_and(|(known, phase)| known >= revision || phase == Phase::Gone) {
            return (self.find(id), Vec::new());
        }
        let Entry { record, claim, results, .. } = entry;
        let (crashes, ended) = (record.crashes, record.ended.clone());
        let job = self.find(id).unwrap_or_else(|| {
            let job = Arc::new(Job::recovered(id, crate::jobs::Record { ended: None, ..record.clone() }, None));
            // Insertion may fail if an idempotency key names two jobs, which the bucket of states does not allow; the
            // key then finds the first job.
            let _ = self.store.index().insert(&job);
            job
        });
        job.crashes.store(crashes, Relaxed);
        let phase = match (&ended, &claim) {
            (Some(_), _) => Phase::Ended,
            (None, Some(_)) => Phase::Running(crashes),
            (None, None) => Phase::Waiting,
        };
        let mut forgotten = Vec::new();
        if before.map(|(_, phase)| phase) != Some(phase) {
            if matches!(phase, Phase::Running(_)) {
                mirror.running.insert(id, job.client);
            } else {
                mirror.running.remove(&id);
            }
            let mut intake = self.lock();
            if matches!(before, Some((_, Phase::Waiting))) {
                intake.queue.remove(job.client, |waiting| waiting.id == id);
            }
            if phase == Phase::Waiting {
                intake.queue.push(job.client, Arc::clone(&job));
            }
            if phase == Phase::Ended && before.is_some() {
                intake.drain_rate.departed(Instant::now());
            }
            drop(intake);
            // The results of jobs that had ended before the start of the gateway are read on request.
            if let (Some(results), true) = (results, before.is_some()) {
                mirror.short.0.insert(id.number().to_le_bytes().into(), results.into());
            }
            match (ended, claim) {
                (Some(ended), _) => {
                    let ended = Ended { timing: timing(&ended, record.created), ..ended };
                    forgotten = self.store.keep(&job, &ended, 0);
                    job.conclude(ended);
                }
                (None, Some(claim)) => {
                    let date = claim.started;
                    let ago = Timestamp::now().duration_since(date).try_into().unwrap_or_default();
                    let clock = Instant::now().checked_sub(ago).unwrap_or_else(Instant::now);
                    job.lock().run_elsewhere(Moment { date, clock });
                }
                (None, None) => job.lock().wait_elsewhere(),
            }
        }
        if phase == Phase::Ended {
            mirror.parts.end(id);
        }
        mirror.jobs.insert(id, Seen { revision, phase });
        (Some(job), forgotten)
    }

    /// Records that a job was deleted, which the bucket of states reports with this revision.
    pub(super) fn take_away(&self, far: &Far, id: JobId, revision: u64, when: Timestamp) {
        let mut mirror = far.mirror();
        let before = mirror.jobs.get(&id).map(|seen| (seen.revision, seen.phase));
        if before.is_some_and(|(known, phase)| known >= revision && phase == Phase::Gone) {
            return;
        }
        mirror.running.remove(&id);
        mirror.parts.end(id);
        mirror.jobs.insert(id, Seen { revision, phase: Phase::Gone });
        mirror.gone.push_back((when, id));
        if let Some(job) = self.find(id) {
            self.lock().queue.remove(job.client, |waiting| waiting.id == id);
            self.store.index().forget(id);
            let mut lifecycle = job.lock();
            lifecycle.persistence = Persistence::Forgotten;
            lifecycle.finish(Ended::unsolved(Ending::Dismissed));
            drop(lifecycle);
            job.wake();
        }
    }

    /// Removes from the mirror a job that could not be put into the NATS queue, or whose client has disconnected.
    pub(super) fn drop_from_mirror(&self, far: &Far, job: &Job) {
        let mut mirror = far.mirror();
        mirror.jobs.remove(&job.id);
        mirror.running.remove(&job.id);
        self.lock().queue.remove(job.client, |waiting| waiting.id == job.id);
        self.store.index().forget(job.id);
    }

    /// Passes the progress of a job, received from its worker, on to the clients that follow the job.
    pub(super) fn hear(&self, id: JobId, told: Told) {
        let Some(job) = self.find(id).filter(|job| job.attempt() == told.attempt) else { return };
        if let Some(control) = job.control() {
            told.progress.relay(&control);
        }
    }
}

impl Lifecycle {
    /// Marks the job as running on a worker of another machine, since `started`.
    fn run_elsewhere(&mut self, started: Moment) {
        if !matches!(self.state, State::Ended(_)) {
            self.state = State::Running { started, control: Arc::new(Control::new()), halt: None, on_trial: false };
        }
    }

    /// Marks the job as waiting for a worker of another machine.
    fn wait_elsewhere(&mut self) {
        if !matches!(self.state, State::Ended(_)) {
            self.state = State::Accepted(None);
        }
    }
}

/// Returns the times that a job waited and ran, if it ran on another machine.
fn timing(ended: &Ended, created: Timestamp) -> Option<Timing> {
    let started = ended.started?;
    let between = |from: Timestamp, to: Timestamp| to.duration_since(from).try_into().unwrap_or_default();
    Some(Timing { queue: between(created, started), solve: between(started, ended.finished) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clients_of_running_jobs_are_named_in_turn() {
        let mut mirror = Mirror::default();
        assert_eq!(mirror.next_running(2), []);
        for number in 1..=3_u64 {
            mirror.running.insert(JobId::of_number(number.into()), Client::Token(number));
        }
        let named = |mirror: &mut Mirror| {
            let token = |client| if let Client::Token(number) = client { number } else { 0 };
            mirror.next_running(2).into_iter().map(token).collect::<Vec<u64>>()
        };
        assert_eq!(named(&mut mirror), [1, 2]);
        assert_eq!(named(&mut mirror), [3, 1]);
        mirror.running.remove(&JobId::of_number(1));
        assert_eq!(named(&mut mirror), [2, 3]);
        mirror.running.remove(&JobId::of_number(2));
        // Each client of a running job is named once in an answer, even if fewer clients than asked for are left.
        assert_eq!(named(&mut mirror), [3]);
    }
}
