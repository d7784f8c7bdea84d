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
    /// The numerics failed or a limit stopped them, for this reason; the trajectory so far is kept.
    Failed(String),
    /// There is no solution to show.
    Broken(Fault),
    /// Its client stopped it, after some steps or before the first.
    Dismissed,
}

/// Why there is no solution to show.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// The solver panicked, which is a fault of ours.
    #[serde(alias = "panicked")]
    Defect,
    /// Its worker was refused memory beyond what a solve may take.
    TooMuchMemory {
        /// The bytes that it may take.
        allowed: usize,
        /// The bytes that it asked for at once when it was refused, where that is known.
        asked: Option<u64>,
        /// The bytes that it had been estimated to take, where that is known.
        estimate: Option<usize>,
    },
    /// The stack of its worker was used up.
    StackOverflow,
    /// Its worker was ended from outside, by this signal.
    Killed {
        /// The number of the signal.
        signal: i32,
    },
    /// It did not stop at its deadline, and its worker was ended.
    Overran,
    /// The process ended while it ran and no other did: twice for want of memory, or many times.
    Poisoned,
    /// The JSON would be longer than `limit` bytes.
    TooLarge {
        /// The most bytes a result may have.
        limit: usize,
    },
    /// The disk did not take the result.
    Unwritable,
    /// What was accepted once can no longer be read, as after a change of version.
    Unreadable,
    /// What was accepted once is no longer what was stored.
    Damaged,
}

impl Fault {
    /// The word under which it has a page.
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

    /// That of a worker's death over a job which may take so many bytes and was estimated to take so many.
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

/// Where results are.
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
        /// Of their JSON.
        json: Fingerprint,
        /// Of the index of the columns.
        index: Fingerprint,
    },
}

impl Held {
    /// The digest of their JSON.
    pub fn digest(&self) -> Digest {
        match self {
            Self::Memory(results) => results.digest(),
            Self::Table(json) | Self::File(json) | Self::Columns { json, .. } => json.digest,
        }
    }
}

/// How long a job waited and how long it ran.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// From its acceptance to its start.
    pub queue: Duration,
    /// From its start to its end.
    pub solve: Duration,
}

/// The end of a job.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Ended {
    /// When a worker took it, if one did.
    pub started: Option<Timestamp>,
    /// When it ended.
    pub finished: Timestamp,
    /// Measured in this process.
    #[serde(skip)]
    pub timing: Option<Timing>,
    /// The part of the time horizon that was done, in `[0, 1]`.
    pub fraction: f64,
    /// Accepted steps of the method.
    pub steps: u64,
    /// How it ended.
    pub ending: Ending,
    /// The verdict on its answer, if it left one.
    #[serde(default)]
    pub verdict: Option<Verdict>,
    /// What it left.
    pub held: Option<Held>,
    /// What it left is no longer what was stored.
    #[serde(default)]
    pub damaged: bool,
    /// It is the answer to the same specification, of an earlier solve.
    #[serde(skip)]
    pub repeated: bool,
}

impl Ended {
    /// The end, now, of a job that no worker has solved in this process.
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
            damaged: false,
            repeated: false,
        }
    }

    /// The bytes that keeping it takes.
    pub fn bytes(&self) -> usize {
        match &self.held {
            Some(Held::Memory(results)) => results.bytes(),
            Some(Held::Table(json) | Held::File(json) | Held::Columns { json, .. }) => json.bytes,
            None => 0,
        }
    }
}

impl Ending {
    /// A word for logs: how it ended, or why there is no solution.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Successful => "successful",
            Self::Failed(_) => "failed",
            Self::Dismissed => "dismissed",
            Self::Broken(fault) => fault.code(),
        }
    }

    /// The ending of a solve that returned, `cancelled` by its client or not on the way.
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
