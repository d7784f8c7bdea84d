//! The row of a job in the database, which has its state and its properties, as a JSON object.

use super::Client;
use super::ended::{Ended, Held};
use super::idempotency::Key;
use super::job::{Estimate, Halt, Job, Lifecycle, Persistence, State};
use crate::digest::Digest;
use crate::worker::SweepFacts;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use specification::Time;

/// The row of a job in the database: its state and its properties.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Record {
    /// The client that posted the job.
    pub client: Client,
    /// A label chosen by the client.
    pub label: Option<String>,
    /// The time horizon of the job's problem.
    pub horizon: Time,
    /// The problem type and the estimated memory of the solve.
    #[serde(default)]
    pub estimate: Option<Estimate>,
    /// The time at which the job was admitted.
    pub created: Timestamp,
    /// The size of the posted specification, in bytes.
    pub document_bytes: usize,
    /// The digest of the posted specification.
    #[serde(default)]
    pub document: Option<Digest>,
    /// The idempotency key under which the client may ask for the job again.
    pub key: Option<Key>,
    /// The number of times that the service process, or the worker on another machine, died while the job ran.
    pub crashes: u32,
    /// The number of crashes of the service process while this job ran alone.
    #[serde(default)]
    pub crashes_alone: u32,
    /// The number of crashes of the service process while this job ran alone and the system had run out of memory.
    #[serde(default)]
    pub shortages_alone: u32,
    /// Whether the job was already running when it was first stored, so that no mark shows that it ran.
    pub underway: bool,
    /// Whether the client has cancelled the job.
    pub dismissed: bool,
    /// The end of the job, if it has ended.
    pub ended: Option<Ended>,
}

#[cfg(test)]
impl Record {
    /// Creates, for tests, the row of an ended job whose results are at `held`.
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
    /// Returns the row of the job as it is in the database on the disk, if it is there.
    pub(super) fn row(&self) -> Option<Record> {
        let lifecycle = self.lock();
        let record = Record::of(self, &lifecycle);
        match (lifecycle.persistence, lifecycle.ended()) {
            (Persistence::Disk, Some(ended)) if !matches!(ended.held, Some(Held::Memory(_))) => {
                Some(record.ended(ended))
            }
            // The row of a job whose end waits to be written is that of an unfinished job.
            (Persistence::Disk, _) => Some(record),
            (Persistence::Memory | Persistence::Storing | Persistence::Forgotten, _) => None,
        }
    }
}

impl Record {
    /// Creates the database row of `job` in its state `lifecycle`, without the end, which `Record::ended` adds.
    pub fn of(job: &Job, lifecycle: &Lifecycle) -> Self {
        // A sweep that has progressed since the death of a process did not cause that death.
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

    /// Returns the properties of the sweep, if the job is one.
    pub fn sweep(&self) -> Option<SweepFacts> {
        self.estimate.as_ref()?.sweep
    }

    /// Returns this row of a job with its end `ended`.
    pub fn ended(self, ended: &Ended) -> Self {
        Self { underway: false, ended: Some(ended.clone()), ..self }
    }
}
