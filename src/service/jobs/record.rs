//! The row of a job on the disk, beside its specification and its results: a JSON object.

use super::Client;
use super::ended::{Ended, Held};
use super::idempotency::Key;
use super::job::{Estimate, Halt, Job, Lifecycle, Persistence, State};
use crate::digest::Digest;
use crate::worker::SweepFacts;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use specification::Time;

/// The row of a job.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Record {
    /// The client that posted the job.
    pub client: Client,
    /// A label chosen by the client.
    pub label: Option<String>,
    /// The time horizon of the problem.
    pub horizon: Time,
    /// The problem type and the estimated memory of the solve.
    #[serde(default)]
    pub estimate: Option<Estimate>,
    /// When the job was admitted.
    pub created: Timestamp,
    /// The size of the posted document, in bytes.
    pub document_bytes: usize,
    /// The digest of the posted document.
    #[serde(default)]
    pub document: Option<Digest>,
    /// The idempotency key under which the client may ask for the job again.
    pub key: Option<Key>,
    /// The number of times the process died while the job ran.
    pub crashes: u32,
    /// The number of those crashes in which no other job ran.
    #[serde(default)]
    pub crashes_alone: u32,
    /// The number of those lone crashes in which the system had run out of memory.
    #[serde(default)]
    pub shortages_alone: u32,
    /// The job was already running when it was first stored, so that no mark shows that it ran.
    pub underway: bool,
    /// The client has cancelled the job.
    pub dismissed: bool,
    /// How the job ended, if it has.
    pub ended: Option<Ended>,
}

#[cfg(test)]
impl Record {
    /// The row of a job that has results.
    pub fn example(held: super::Held) -> Self {
        let ended = Ended { held: Some(held), ..Ended::unsolved(super::Ending::Successful) };
        Self {
            client: Client::at(std::net::Ipv4Addr::LOCALHOST.into()),
            label: None,
            horizon: Time { start: 0.0, end: 1.0 },
            estimate: None,
            created: ended.finished,
            document_bytes: 2,
            document: None,
            key: None,
            crashes: 0,
            crashes_alone: 0,
            shortages_alone: 0,
            underway: false,
            dismissed: false,
            ended: Some(ended),
        }
    }
}

impl Job {
    /// The row of the job, if the disk has one.
    pub(super) fn row(&self) -> Option<Record> {
        let lifecycle = self.lock();
        let record = Record::of(self, &lifecycle);
        match (lifecycle.persistence, lifecycle.ended()) {
            (Persistence::Disk, Some(ended)) if !matches!(ended.held, Some(Held::Memory(_))) => {
                Some(record.ended(ended))
            }
            // A job whose end waits to be written has the row of an unfinished job.
            (Persistence::Disk, _) => Some(record),
            (Persistence::Memory | Persistence::Storing | Persistence::Forgotten, _) => None,
        }
    }
}

impl Record {
    /// The row of `job` in its present lifecycle.
    pub fn of(job: &Job, lifecycle: &Lifecycle) -> Self {
        // A sweep that has gone on since is not what a process died of.
        let is_cleared = job.chunks.as_ref().is_some_and(|chunks| chunks.has_progressed());
        let alone = |count: u32| if is_cleared { 0 } else { count };
        let (underway, dismissed) = match &lifecycle.state {
            State::Running { halt, .. } => (true, *halt == Some(Halt::Dismiss)),
            State::Accepted(_) => (false, job.chunks.as_ref().is_some_and(|chunks| chunks.is_dismissed())),
            State::Ended(_) => (false, false),
        };
        Self {
            client: job.client,
            label: job.label.clone(),
            horizon: job.horizon,
            estimate: job.estimate.clone(),
            created: job.created.date,
            document_bytes: job.document_bytes,
            document: job.digest.get().copied(),
            key: job.key.clone(),
            crashes: job.crashes(),
            crashes_alone: alone(job.crashes_alone),
            shortages_alone: alone(job.shortages_alone),
            underway,
            dismissed,
            ended: None,
        }
    }

    /// The sweep, if the job is one.
    pub fn sweep(&self) -> Option<SweepFacts> {
        self.estimate.as_ref()?.sweep
    }

    /// This row with an end.
    pub fn ended(self, ended: &Ended) -> Self {
        Self { underway: false, ended: Some(ended.clone()), ..self }
    }
}
