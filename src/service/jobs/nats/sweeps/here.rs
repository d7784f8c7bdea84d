//! The chunks of a sweep that the worker which divides the sweep solves itself. Their rows are in memory, and are
//! written to the NATS servers only when the sweep is shared with other workers.

use super::Sweep;
use crate::jobs::chunks::{Chunk, Solved};
use crate::jobs::nats::parts::{Done, Part, PartId, Work, outcome};
use crate::jobs::{Ended, Job};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A chunk of a sweep, solved by the worker that divides the sweep.
pub struct Here {
    id: PartId,
    chunk: Chunk,
    pub job: Arc<Job>,
    begun: Instant,
}

impl Sweep<'_> {
    /// Begins to solve a chunk of the sweep in this process.
    pub async fn begin_here(&mut self, chunk: Chunk) {
        let id = self.next_id();
        let (record, document) = (self.record.clone(), Arc::clone(&self.document));
        let begun = Instant::now();
        let job = self.worker.jobs.take_part(record, self.until, self.facts, &chunk, document);
        self.worker.begin_part(id, &job).await;
        self.here = Some(Here { id, chunk, job, begun });
    }

    /// Waits until the chunk of the sweep that this worker solves has ended.
    pub async fn end_here(&mut self) {
        if let Some(here) = &self.here {
            let ended = here.job.settled().await;
            self.count_here(ended).await;
        }
    }

    /// Records the outcome of the chunk of the sweep that this worker has solved; `None` means that the chunk was
    /// parked, to be solved again later.
    pub async fn count_here(&mut self, ended: Option<Arc<Ended>>) {
        let Some(Here { id, chunk, job, begun }) = self.here.take() else { return };
        self.worker.mine().remove(&Work::Part(id));
        let made = ended.map(|ended| outcome(&job, &ended, begun.elapsed()));
        let _ = self.worker.jobs.forget(&job).await;
        match made {
            Some((Done::Rows { rows, lost, steps, bytes, digest, seconds, attempt }, made)) if rows > 0 => {
                self.chunks.lose(lost);
                let members = chunk.members.start..chunk.members.start + rows;
                // The rows of the chunk stay in memory as long as no other worker needs them.
                self.chunks.keep(members, steps, made.clone());
                let time = Duration::try_from_secs_f64(seconds).unwrap_or_default();
                self.chunks.end(&chunk, None, &Solved::Rows { rows, steps, bytes }, time);
                let done = Done::Rows { rows, lost, steps, bytes, digest, seconds, attempt };
                self.unwritten.push((id, chunk, done, made));
                self.note_progress().await;
            }
            Some((Done::Broken(fault), _)) => self.chunks.end(&chunk, None, &Solved::Broken(fault), Duration::ZERO),
            Some((done, _)) => {
                if let Done::Rows { lost, .. } = done {
                    self.chunks.lose(lost);
                }
                self.chunks.end(&chunk, None, &Solved::Nothing, Duration::ZERO);
            }
            None => self.chunks.end(&chunk, None, &Solved::Nothing, Duration::ZERO),
        }
        self.report();
    }

    /// Writes the outcomes and rows of chunks that this worker has solved to the NATS servers, for a worker that may
    /// have to continue the sweep.
    pub async fn write(&mut self) {
        for (id, chunk, done, rows) in std::mem::take(&mut self.unwritten) {
            self.worker.write_rows(&id.rows(1), &rows).await;
            self.enter(id, &Part { done: Some(done), ..Part::waiting(&chunk, None) }).await;
        }
    }
}
