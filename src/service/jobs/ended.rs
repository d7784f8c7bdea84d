//! The end of a job: how it ended, how far it came, and where its results are.

use super::Results;
use crate::digest::{Digest, Fingerprint};
use crate::worker::Death;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use solution::{Status, Verdict};
use std::sync::Arc;
use std::time::Duration;

/// How a job ended.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// The end time was reached.
    Successful,
    /// The numerical method failed or a limit stopped it, for this reason; the trajectory so far is kept.
    Failed(String),
    /// There is no solution, because of a fault.
    Broken(Fault),
    /// The client stopped the job, before the solve began or on the way.
    Dismissed,
}

/// Why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// The solver panicked: a defect of the software.
    #[serde(alias = "panicked")]
    Defect,
    /// The worker was refused memory beyond the limit of a solve.
    TooMuchMemory {
        /// The limit, in bytes.
        allowed: usize,
        /// The size of the refused allocation in bytes, if it is known.
        asked: Option<u64>,
        /// The estimate before the solve in bytes, if there was one.
        estimate: Option<usize>,
    },
    /// The worker exhausted its stack.
    StackOverflow,
    /// The worker was killed from outside, by a signal.
    Killed {
        /// The number of the signal.
        signal: i32,
    },
    /// The job did not stop at its deadline, and its worker was killed.
    Overran,
    /// The process died while this job ran alone: twice for want of memory, or many times.
    Poisoned,
    /// The results as JSON would be longer than the limit.
    TooLarge {
        /// The limit, in bytes.
        limit: usize,
    },
    /// The disk refused the results.
    Unwritable,
    /// The stored specification can no longer be parsed, for instance after a change of version.
    Unreadable,
    /// The stored specification differs from what was written.
    Damaged,
}

impl Fault {
    /// The code of the fault, which is also the name of its documentation page.
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

    /// The fault that a worker's death is for a job with `allowed` bytes of memory and an `estimate` of its needs.
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

/// Where the results of a job are held.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Held {
    /// In memory, as long as the process lives.
    #[serde(skip)]
    Memory(Arc<Results>),
    /// As JSON in the database.
    Table(Fingerprint),
    /// As JSON in a file of their own, by a version before format 3.
    File(Fingerprint),
    /// As columns in a file of their own.
    Columns {
        /// The fingerprint of their JSON.
        json: Fingerprint,
        /// The fingerprint of the index of the columns.
        index: Fingerprint,
    },
}

impl Held {
    /// The digest of the results as JSON.
    pub fn digest(&self) -> Digest {
        match self {
            Self::Memory(results) => results.digest(),
            Self::Table(json) | Self::File(json) | Self::Columns { json, .. } => json.digest,
        }
    }
}

/// The waiting and the running time of a job.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// From admission to start.
    pub queue: Duration,
    /// From start to end.
    pub solve: Duration,
}

/// The end of a job.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Ended {
    /// When a worker started it, if one did.
    pub started: Option<Timestamp>,
    /// When it ended.
    pub finished: Timestamp,
    /// The durations, if they were measured in this process.
    #[serde(skip)]
    pub timing: Option<Timing>,
    /// The fraction of the time horizon that was integrated, in `[0, 1]`.
    pub fraction: f64,
    /// The number of accepted steps.
    pub steps: u64,
    /// How it ended.
    pub ending: Ending,
    /// The verdict on the solution, if there is one.
    #[serde(default)]
    pub verdict: Option<Verdict>,
    /// The results, if there are any.
    pub held: Option<Held>,
    /// The members of a sweep that have rows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rows: Option<usize>,
    /// The stored results differ from what was written.
    #[serde(default)]
    pub damaged: bool,
    /// The results repeat an earlier solve of the identical specification.
    #[serde(skip)]
    pub repeated: bool,
}

impl Ended {
    /// The end, now, of a job that was not solved in this process.
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

    /// The size of what stands in memory of the results, in bytes.
    pub fn resident(&self) -> usize {
        match &self.held {
            Some(Held::Memory(results)) => results.resident(),
            _ => 0,
        }
    }

    /// The size of the results, in bytes.
    pub fn bytes(&self) -> usize {
        match &self.held {
            Some(Held::Memory(results)) => results.bytes(),
            Some(Held::Table(json) | Held::File(json) | Held::Columns { json, .. }) => json.bytes,
            None => 0,
        }
    }
}

impl Ending {
    /// The ending as one word for logs: successful, failed, dismissed, or the code of the fault.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Successful => "successful",
            Self::Failed(_) => "failed",
            Self::Dismissed => "dismissed",
            Self::Broken(fault) => fault.code(),
        }
    }

    /// The ending of a solve that returned; `cancelled` if it was asked to stop.
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
