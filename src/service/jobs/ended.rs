//! The end of a job: how it ended, how far it came, and where its results are stored.

use super::Results;
use crate::digest::{Digest, Fingerprint};
use crate::worker::Death;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use solution::{Status, Verdict};
use std::sync::Arc;
use std::time::Duration;

/// The way in which a job ended.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// The solve reached its end time.
    Successful,
    /// The numerical method failed or a limit stopped it, for this reason; the trajectory so far is kept.
    Failed(String),
    /// The job has no solution, because of a fault.
    Broken(Fault),
    /// The client stopped the job, before or during the solve.
    Dismissed,
}

/// The fault because of which a job has no solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// The solver panicked: a defect of the software.
    #[serde(alias = "panicked")]
    Defect,
    /// The worker was refused memory beyond the limit of a solve.
    TooMuchMemory {
        /// The memory limit of the solve, in bytes.
        allowed: usize,
        /// The size of the refused allocation in bytes, if it is known.
        asked: Option<u64>,
        /// The estimated memory of the solve in bytes, if there was an estimate.
        estimate: Option<usize>,
    },
    /// The worker that solved the job exhausted its stack.
    StackOverflow,
    /// The worker was killed by a signal from another process or the kernel.
    Killed {
        /// The number of the signal that killed the worker.
        signal: i32,
    },
    /// The job did not stop at its deadline, and its worker was killed.
    Overran,
    /// The service process died while this job ran alone: twice by lack of memory, or many times.
    Poisoned,
    /// The results of the solve, as JSON, would be longer than the limit.
    TooLarge {
        /// The size limit of results as JSON, in bytes.
        limit: usize,
    },
    /// The results could not be written to the disk.
    Unwritable,
    /// The stored specification cannot be parsed, for instance after a change of version.
    Unreadable,
    /// The stored specification differs from what was written.
    Damaged,
}

impl Fault {
    /// Returns the code of the fault, which is also the name of its documentation page.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Defect => "defect",
            Self::TooMuchMemory { .. } => "too_much_memory",
            Self::StackOverflow => "stack_overflow",
            Self::Killed { .. } => "killed",
            Self::Overran => "overran",
            Self::Poisoned => "poisoned",
            Self::TooLarge { .. } => "result_too_large",
            Self::Unwritable => "unwritable",
            Self::Unreadable => "unreadable",
            Self::Damaged => "damaged",
        }
    }

    /// Returns the fault for a worker's death by `death`, with `allowed` bytes of memory and an `estimate` of the
    /// job's needs.
    pub fn of(death: &Death, allowed: usize, estimate: Option<usize>) -> Self {
        match death {
            Death::TooMuchMemory(asked) => Self::TooMuchMemory { allowed, asked: *asked, estimate },
            Death::StackOverflow => Self::StackOverflow,
            Death::Killed(signal) => Self::Killed { signal: *signal },
            Death::Overran => Self::Overran,
            Death::Defect(_) => Self::Defect,
        }
    }
}

/// The place where the results of a job are stored.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Held {
    /// The results are in memory, as long as the process lives.
    #[serde(skip)]
    Memory(Arc<Results>),
    /// The results are stored as JSON in the database.
    Table(Fingerprint),
    /// The results are stored as JSON in a file of their own, written by a version before format 3.
    File(Fingerprint),
    /// The results are stored as columns in a file of their own.
    Columns {
        /// The fingerprint (length and digest) of the results as JSON.
        json: Fingerprint,
        /// The fingerprint (length and digest) of the index of the columnar file.
        index: Fingerprint,
    },
}

impl Held {
    /// Returns the digest of the results as JSON.
    pub fn digest(&self) -> Digest {
        match self {
            Self::Memory(results) => results.digest(),
            Self::Table(json) | Self::File(json) | Self::Columns { json, .. } => json.digest,
        }
    }
}

/// The times that a job waited and ran.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// The time from admission to start of the job.
    pub queue: Duration,
    /// The time from start to end of the job.
    pub solve: Duration,
}

/// The record of the end of a job.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Ended {
    /// The time at which a worker started the job, if one did.
    pub started: Option<Timestamp>,
    /// The time at which the job ended.
    pub finished: Timestamp,
    /// The times that the job waited and ran, if they were measured in this process.
    #[serde(skip)]
    pub timing: Option<Timing>,
    /// The fraction of the time horizon that was integrated, in `[0, 1]`.
    pub fraction: f64,
    /// The number of accepted steps of the solve.
    pub steps: u64,
    /// The way in which the job ended.
    pub ending: Ending,
    /// The verdict on the solution, if there is one.
    #[serde(default)]
    pub verdict: Option<Verdict>,
    /// The place where the results of the job are stored, if there are any.
    pub held: Option<Held>,
    /// The number of members of the sweep that have rows, if the job is a sweep.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rows: Option<usize>,
    /// Whether the stored results of the job differ from what was written.
    #[serde(default)]
    pub damaged: bool,
    /// Whether the results repeat an earlier solve of the identical specification.
    #[serde(skip)]
    pub repeated: bool,
}

impl Ended {
    /// Creates the record of the end, at the current time, of a job that was not solved in this process.
    pub fn unsolved(ending: Ending) -> Self {
        let finished = Timestamp::now();
        Self {
            started: None,
            finished,
            timing: None,
            fraction: 0.0,
            steps: 0,
            ending,
            verdict: None,
            held: None,
            rows: None,
            damaged: false,
            repeated: false,
        }
    }

    /// Returns the size of the part of the results that is in memory, in bytes.
    pub fn resident(&self) -> usize {
        match &self.held {
            Some(Held::Memory(results)) => results.resident(),
            _ => 0,
        }
    }

    /// Returns the size of the results of the job, in bytes.
    pub fn bytes(&self) -> usize {
        match &self.held {
            Some(Held::Memory(results)) => results.bytes(),
            Some(Held::Table(json) | Held::File(json) | Held::Columns { json, .. }) => json.bytes,
            None => 0,
        }
    }
}

impl Ending {
    /// Returns the ending as one word for logs: successful, failed, dismissed, or the code of the fault.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Successful => "successful",
            Self::Failed(_) => "failed",
            Self::Dismissed => "dismissed",
            Self::Broken(fault) => fault.code(),
        }
    }

    /// Returns the ending of a solve that returned; `cancelled` says whether the client asked it to stop.
    pub fn of(status: Status, failed: Option<&str>, cancelled: bool) -> Self {
        match (status, failed) {
            (Status::Completed, _) => Self::Successful,
            (Status::Stopped, _) if cancelled => Self::Dismissed,
            (_, Some(message)) => Self::Failed(message.to_owned()),
            (Status::Stopped, None) => Self::Failed("a limit stopped the solve".to_owned()),
            (Status::Failed, None) => Self::Failed("the solve failed".to_owned()),
        }
    }
}
