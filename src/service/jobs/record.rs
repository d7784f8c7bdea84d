//! What the disk knows of a job, beside its specification and its results: JSON, a row a job.

use super::Client;
use super::ended::{Ended, Held};
use super::idempotency::Key;
use super::job::{Estimate, Halt, Job, Lifecycle, Persistence, State};
use crate::digest::Digest;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use specification::Time;

/// A row.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Record {
    /// Whose it is.
    pub client: Client,
    /// The client's own words for it.
    pub label: Option<String>,
    /// The time horizon of its problem.
    pub horizon: Time,
    /// What was known of its solve when it was accepted.
    #[serde(default)]
    pub estimate: Option<Estimate>,
    /// When it was accepted.
    pub created: Timestamp,
    /// The bytes of what was posted.
    pub document_bytes: usize,
    /// The digest of those.
    #[serde(default)]
    pub document: Option<Digest>,
    /// Under which the client may ask for it again.
    pub key: Option<Key>,
    /// How often the process ended while it ran.
    pub crashes: u32,
    /// How often it was the only one that ran.
    #[serde(default)]
    pub crashes_alone: u32,
    /// How often memory had run out then.
    #[serde(default)]
    pub shortages_alone: u32,
    /// It was running when it was first stored, so that no mark says so.
    pub underway: bool,
    /// Its client does not want it any more.
    pub dismissed: bool,
    /// How it ended, if it has.
    pub ended: Option<Ended>,
}

#[cfg(test)]
impl Record {
    /// The row of a job that left something.
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
    /// Its row, if the disk has one.
    pub(super) fn row(&self) -> Option<Record> {
        let life = self.lock();
        let record = Record::of(self, &life);
        match (life.keeping, life.ended()) {
            (Persistence::Disk, Some(ended)) if !matches!(ended.held, Some(Held::Memory(_))) => {
                Some(record.ended(ended))
            }
            // One that waits to be written.
            (Persistence::Disk, _) => Some(record),
            (Persistence::Memory | Persistence::Storing | Persistence::Forgotten, _) => None,
        }
    }
}

impl Record {
    /// The row of `job` at this point of its `life`.
    pub fn of(job: &Job, life: &Lifecycle) -> Self {
        let (underway, dismissed) = match &life.state {
            State::Running { halt, .. } => (true, *halt == Some(Halt::Dismiss)),
            State::Accepted(_) | State::Ended(_) => (false, false),
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
            crashes: job.crashes,
            crashes_alone: job.crashes_alone,
            shortages_alone: job.shortages_alone,
            underway,
            dismissed,
            ended: None,
        }
    }

    /// The same, ended.
    pub fn ended(self, ended: &Ended) -> Self {
        Self { underway: false, ended: Some(ended.clone()), ..self }
    }
}
