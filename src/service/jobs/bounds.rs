//! How much a service takes on, and why it takes on no more.

use super::index::Mismatch;
use super::intake::{Intake, UNMEASURED};
use super::queue::Full;
use super::writer::Unwritable;
use super::{Retention, Room};
use std::time::Duration;

/// How much is taken on.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Solves that run to their ends at a time, beside those in relief.
    pub workers: usize,
    /// What may wait.
    pub queue: Room,
    /// Accepted steps that a solve may make.
    pub steps: u64,
    /// Bytes that a solve may take, by the estimate.
    pub memory: usize,
    /// Time a job may run.
    pub wall: Duration,
    /// Bytes of the JSON of one result.
    pub result_bytes: usize,
    /// How much of the past is kept.
    pub retention: Retention,
}

impl Bounds {
    /// The memory that a worker may hold between jobs: an eighth of what a solve may take, and of what is left behind by
    /// small ones.
    pub fn kept_by_worker(&self) -> u64 {
        (self.memory / 8 + (64 << 20)) as u64
    }

    /// Why nothing more goes in, and when there should be room again.
    pub fn refusal(&self, intake: &Intake, full: Full) -> AdmissionError {
        // One in ten of the places: whoever comes back then finds one, even if others come back too.
        match full {
            Full::Queue => AdmissionError::QueueFull(intake.time_for(self.queue.places.div_ceil(10))),
            Full::Bytes => AdmissionError::QueueBytes(intake.time_for(intake.queue.len().div_ceil(10))),
            Full::Share => {
                AdmissionError::ClientShare(intake.time_for(self.queue.share.div_ceil(10) * intake.queue.clients()))
            }
        }
    }
}

/// Why a job is not taken on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdmissionError {
    /// Every place in the queue is taken; there should be one after this time.
    QueueFull(Duration),
    /// The specifications that wait are as large as they may be; there should be room after this time.
    QueueBytes(Duration),
    /// The client has its share of the queue; it should have a place after this time.
    ClientShare(Duration),
    /// The solve would take this many bytes, which are more than it may.
    Memory(usize),
    /// The service is about to stop.
    Draining,
    /// Something else was posted under the key.
    KeyReused,
    /// The first job under the key is still being stored.
    KeyInUse,
    /// The disk takes nothing.
    Unwritable,
}

/// There is no room to wait for a check either.
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

impl From<Mismatch> for AdmissionError {
    fn from(_: Mismatch) -> Self {
        Self::KeyReused
    }
}
