//! The bounds of a service, and the reasons to refuse a job.

use super::index::Mismatch;
use super::intake::{Intake, UNMEASURED};
use super::nats::Away;
use super::queue::Full;
use super::writer::Unwritable;
use super::{Retention, Room};
use std::time::Duration;

/// The bounds of a service.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// The number of solves that run to their end at a time, without those on relief workers.
    pub workers: usize,
    /// The bounds of the queue.
    pub queue: Room,
    /// The largest number of accepted steps of a solve.
    pub steps: u64,
    /// The largest estimated memory of a solve, in bytes.
    pub memory: usize,
    /// The wall-time limit of a job.
    pub wall: Duration,
    /// The largest size of one result as JSON, in bytes.
    pub result_bytes: usize,
    /// The bounds on ended jobs.
    pub retention: Retention,
}

impl Bounds {
    /// The memory that a worker may keep between jobs, in bytes: an eighth of what a solve may take, and an allowance
    /// for what small solves leave behind.
    pub fn kept_by_worker(&self) -> u64 {
        (self.memory / 8 + (64 << 20)) as u64
    }

    /// The error for a full queue, with the time after which there should be room.
    pub fn admission_error(&self, intake: &Intake, full: Full) -> AdmissionError {
        // Wait for a tenth of the places: a client that comes back then finds one, even if others come back too.
        match full {
            Full::Queue => AdmissionError::QueueFull(intake.time_for(self.queue.places.div_ceil(10))),
            Full::Bytes => AdmissionError::QueueBytes(intake.time_for(intake.queue.len().div_ceil(10))),
            Full::Share => {
                AdmissionError::ClientShare(intake.time_for(self.queue.share.div_ceil(10) * intake.queue.clients()))
            }
        }
    }
}

/// Why a job is not admitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdmissionError {
    /// Every place in the queue is taken; one should be free after this time.
    QueueFull(Duration),
    /// The waiting specifications have reached their total size; there should be room after this time.
    QueueBytes(Duration),
    /// The client has its share of the queue; a place of its own should be free after this time.
    ClientShare(Duration),
    /// The solve is estimated to take this many bytes, more than a solve may take.
    Memory(usize),
    /// The service is about to stop.
    Draining,
    /// A different document was posted under the key.
    KeyReused,
    /// The first job under the key is still being stored.
    KeyInUse,
    /// The disk refuses writes.
    Unwritable,
    /// The servers that jobs are shared over do not answer.
    Away,
}

/// The room to wait for a check is full as well; its drain rate is not measured.
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
