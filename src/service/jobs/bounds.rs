//! The limits of a service, and the reasons to refuse a job.

use super::index::Mismatch;
use super::intake::{Intake, UNMEASURED};
use super::nats::Away;
use super::queue::Full;
use super::writer::Unwritable;
use super::{Retention, Room};
use std::time::Duration;

/// The limits on the jobs of a service.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// The largest number of solves at a time that may run to their end, and not only for a first time slice; without
    /// those on relief workers (additional workers for clients that have no long job running).
    pub workers: usize,
    /// The limits of the queue of waiting jobs.
    pub queue: Room,
    /// The largest number of accepted steps of a solve.
    pub steps: u64,
    /// The largest estimated memory of a solve, in bytes.
    pub memory: usize,
    /// The wall-clock time limit of a job.
    pub wall: Duration,
    /// The largest size of the results of one job as JSON, in bytes.
    pub result_bytes: usize,
    /// The limits on the ended jobs that are kept.
    pub retention: Retention,
}

impl Bounds {
    /// Returns the memory that a worker may keep between jobs, in bytes: an eighth of the limit of a solve, and an
    /// allowance for the memory that small solves leave allocated.
    pub fn kept_by_worker(&self) -> u64 {
        (self.memory / 8 + (64 << 20)) as u64
    }

    /// Returns the error for a full queue, with the time after which there should be room.
    pub fn admission_error(&self, intake: &Intake, full: Full) -> AdmissionError {
        // The time is that in which a tenth of the places in the queue becomes free, so that a client that repeats
        // its request then finds a place, even if other clients repeat theirs too.
        match full {
            Full::Queue => AdmissionError::QueueFull(intake.time_for(self.queue.places.div_ceil(10))),
            Full::Bytes => AdmissionError::QueueBytes(intake.time_for(intake.queue.len().div_ceil(10))),
            Full::Share => {
                AdmissionError::ClientShare(intake.time_for(self.queue.share.div_ceil(10) * intake.queue.clients()))
            }
        }
    }
}

/// The reason why a job is not admitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdmissionError {
    /// The largest number of jobs is waiting; a place in the queue should be free after this time.
    QueueFull(Duration),
    /// The waiting specifications have reached their largest total size; there should be room after this time.
    QueueBytes(Duration),
    /// The client has its share of the queue; one of its places should be free after this time.
    ClientShare(Duration),
    /// The solve is estimated to take this many bytes, more than a solve may take.
    Memory(usize),
    /// The service is about to stop, and admits no more jobs.
    Draining,
    /// A different specification was posted under the idempotency key.
    KeyReused,
    /// The first job under the idempotency key is still being stored.
    KeyInUse,
    /// The job store refuses writes, for instance since the disk is full.
    Unwritable,
    /// The NATS servers over which jobs are shared do not answer.
    Away,
}

/// The error for a full queue of checks of specifications; the rate at which checks leave their queue is not
/// measured.
impl From<Full> for AdmissionError {
    fn from(full: Full) -> Self {
        match full {
            Full::Queue => Self::QueueFull(UNMEASURED),
            Full::Bytes => Self::QueueBytes(UNMEASURED),
            Full::Share => Self::ClientShare(UNMEASURED),
        }
    }
}

impl From<Unwritable> for AdmissionError {
    fn from(_: Unwritable) -> Self {
        Self::Unwritable
    }
}

impl From<Away> for AdmissionError {
    fn from(_: Away) -> Self {
        Self::Away
    }
}

impl From<Mismatch> for AdmissionError {
    fn from(_: Mismatch) -> Self {
        Self::KeyReused
    }
}
