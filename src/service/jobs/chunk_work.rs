//! The execution of a parameter sweep: chunks on workers, rows in a log, and at the end the table.
//!
//! 1. A worker takes a chunk of members, which is a job of its own that no client sees: it has a deadline, a first
//!    time slice, and may be stopped. Its rows are written to the log (on the disk if the job is durable) before they
//!    count.
//! 2. Members that the chunk has not solved are open again, and the job of the sweep returns to the queue.
//! 3. When no member is left, or the sweep is stopped, the last worker makes the table of the rows, and the job ends.

use super::chunks::{Chunk, Chunks, Settled, Solved as ChunkSolved, TARGET};
use super::ended::{Ending, Fault, Held};
use super::intake::{Lane, LaneCell};
use super::job::{Halt, Job, State};
use super::results::Results;
use super::row_log::RowLog;
use super::spool::{Backing, Spool};
use super::work::Assignment;
use super::{Jobs, is_damage};
use crate::worker::{Death, Finished, Left, Limits, Lost, Members, Origin, Solved, Supervisor, Watch};
use problem::Control;
use solution::columnar::{PartsIndex, PartsWriter, Skeleton, StoredMembers};
use solution::{Incomplete, Solution, Status, Table, answer};
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::task::spawn_blocking;
use tracing::Instrument;

/// A chunk of a sweep for a worker, with what the worker needs to solve it.
struct ChunkTask<'a> {
    /// The job of the sweep, and the job of the chunk.
    job: &'a Job,
    part: &'a Job,
    chunk: &'a Chunk,
    wall: Duration,
    origin: &'a Origin,
    document: &'a [u8],
}

/// The reason why the table of a sweep could not be made.
enum Unmade {
    /// The table of the sweep, as JSON, would be longer than the limit of results.
    TooLarge,
    /// The stored rows of the sweep could not be read.
    Unread(io::Error),
}

/// How a sweep ended, with its solution and its stored results.
struct Made {
    ending: Ending,
    solution: Solution,
    results: Results,
}

impl Jobs {
    /// Lets a worker process, controlled by a supervisor, solve a chunk of a sweep, or, if no chunk is left, ends the
    /// sweep.
    pub(super) async fn see_chunk_through(
        &self,
        place: usize,
        supervisor: &mut Supervisor,
        (job, chunks): (&Arc<Job>, &Arc<Chunks>),
        chunk: Option<Chunk>,
        lane: Lane,
    ) {
        let (begun, lane) = (Instant::now(), LaneCell::of(lane));
        let mut origin = Origin::of(Some(job.id.to_string()), &job.context);
        let span = origin.span();
        origin.join(&span);
        let work = async {
            let is_begun = self.begin_sweep(job, chunks, lane.get());
            match chunk {
                Some(chunk) if is_begun => self.chunk(place, supervisor, (job, chunks), &chunk, &origin, &lane).await,
                Some(chunk) => chunks.end(&chunk, None, &ChunkSolved::Nothing, Duration::ZERO),
                None => {}
            }
            self.settle(job, chunks).await;
        };
        self.apart(job.crashes() > 0 && !chunks.has_progressed(), work.instrument(span)).await;
        let mut intake = self.lock();
        intake.depart(job, lane.get(), begun.elapsed());
        if intake.wait_again(job) {
            self.arrival.notify_one();
        }
        if matches!(job.lock().state, State::Ended(_)) {
            intake.drain_rate.departed(Instant::now());
        }
        self.announce_if_idle(&intake);
        self.call_relief(&intake);
    }

    /// Changes the state of a sweep to running, if it waits; returns whether it runs and is not asked to stop.
    pub(super) fn begin_sweep(&self, job: &Job, chunks: &Chunks, lane: Lane) -> bool {
        let allowed = chunks.facts.seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        let deadline = allowed.and_then(|allowed| Instant::now().checked_add(allowed));
        let control = deadline.map_or_else(Control::new, Control::with_deadline);
        let (fraction, steps) = chunks.progress();
        control.report(fraction, steps);
        let posted = if chunks.document().is_none() { self.posted(job).ok() } else { None };
        if job.start_within(control, lane == Lane::First).is_some() {
            if chunks.rows() == 0 {
                self.metrics.waited(job.created.clock.elapsed());
            }
            // A sweep that had ended, and whose end could not be stored, continues here and ends again.
            chunks.resume();
            if posted.is_some() {
                chunks.set_document(posted);
            }
            // The specification kept in memory for an inline solve (in the serving process) is dropped, since a sweep
            // is not solved inline.
            drop(job.solve_inline());
            if chunks.is_dismissed() {
                job.halt(Halt::Dismiss);
            }
        } else if lane != Lane::First {
            job.stay();
        }
        job.control().is_some() && job.halted().is_none()
    }

    async fn chunk(
        &self,
        place: usize,
        supervisor: &mut Supervisor,
        (job, chunks): (&Arc<Job>, &Arc<Chunks>),
        chunk: &Chunk,
        origin: &Origin,
        lane: &LaneCell,
    ) {
        let begun = Instant::now();
        let document = chunks.document().map_or_else(|| self.store.document(job), Ok);
        let document = match document {
            Ok(document) => document,
            Err(error) => {
                tracing::error!(%error, "the specification of job {} cannot be read", job.id);
                if is_damage(&error) {
                    self.metrics.found_damaged();
                }
                let fault = if is_damage(&error) { Fault::Damaged } else { Fault::Unreadable };
                return chunks.end(chunk, None, &ChunkSolved::Broken(fault), Duration::ZERO);
            }
        };
        self.store.mark(place, job);
        let part = Arc::new(job.of_chunk(&document));
        // A chunk gets at most the remaining part of the time that the client allows for the whole sweep.
        let deadline = job.control().and_then(|control| control.deadline());
        let left = deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()));
        let wall = left.unwrap_or(self.bounds.wall).min(self.bounds.wall);
        let (solved, bytes) = match part.start(wall, lane.get() == Lane::First) {
            Some(control) => {
                chunks.begin(&part);
                // A request to stop the sweep may have come before the chunk was registered.
                if let Some(reason) = job.halted() {
                    part.halt(reason);
                }
                let task = ChunkTask { job, part: &part, chunk, wall, origin, document: &document };
                self.solve_chunk(supervisor, task, &control, lane).await
            }
            None => (ChunkSolved::Nothing, Vec::new()),
        };
        if let ChunkSolved::Rows { rows, steps, .. } = &solved
            && *rows > 0
        {
            let members = chunk.members.start..chunk.members.start + rows;
            let was_suspect = job.crashes_alone > 0 && !chunks.has_progressed();
            chunks.keep(members, *steps, bytes);
            self.store.save_rows(job).await;
            if was_suspect {
                self.store.note_progress(job).await;
            }
        }
        chunks.end(chunk, Some(&part), &solved, begun.elapsed());
        if let Some(control) = job.control() {
            let (fraction, steps) = chunks.progress();
            control.report(fraction, steps);
        }
        self.store.unmark(place, job);
    }

    /// Solves a chunk of a sweep; returns its outcome and the bytes of the rows of its members.
    async fn solve_chunk(
        &self,
        supervisor: &mut Supervisor,
        task: ChunkTask<'_>,
        control: &Control,
        lane: &LaneCell,
    ) -> (ChunkSolved, Vec<u8>) {
        let ChunkTask { job, part, chunk, wall, origin, document } = task;
        let is_unwanted = || job.is_forgotten() || part.halted() == Some(Halt::Yield);
        let watch = Watch { origin, control, halted: &part.halted, is_unwanted: &is_unwanted };
        let over = || {
            // A sweep that does not end in its first time slice counts as a long job.
            job.use_up_slice();
            self.end_slice(part, lane);
            if lane.get() != Lane::First {
                job.stay();
            }
        };
        let members = Members {
            first: chunk.members.start,
            end: chunk.members.end,
            lost: chunk.lost.clone(),
            seconds: TARGET.as_secs_f64(),
        };
        let limits = Limits { wall_seconds: Some(wall.as_secs_f64()), ..self.limits() };
        let members = Some(&members);
        let assignment = Assignment { job: part, document, members, limits, over: &over };
        let (finished, _) = self.perform(supervisor, &assignment, &watch, lane).await;
        let is_stopped = part.halted().is_some() || job.control().is_none_or(|control| control.poll().is_some());
        let (length, seconds) = (chunk.members.len(), self.bounds.wall.as_secs());
        let lost = |fault: Fault, message: String| {
            let done = (control.fraction() * length as f64) as usize;
            ChunkSolved::Lost(Lost { code: fault.code().to_owned(), message }, done)
        };
        let solved = match finished {
            Ok(Finished::Solved(_, Left::Rows(rows, bytes))) if !are_rows(&bytes, chunk.members.start, rows) => {
                lost(Fault::Defect, "the worker gave rows of other members".to_owned())
            }
            Ok(Finished::Solved(solved, Left::Rows(rows, bytes))) if rows > 0 || is_stopped => {
                let solved = ChunkSolved::Rows { rows, steps: solved.steps, bytes: bytes.len() };
                return (solved, bytes);
            }
            Ok(Finished::Solved(solved, Left::Rows(..))) => {
                let late = Incomplete::WALL_TIME.code;
                if solved.failed.is_some_and(|failed| failed.code == late) {
                    let message = format!("the member took more than {seconds} s");
                    ChunkSolved::Late(Lost { code: late.to_owned(), message })
                } else {
                    lost(Fault::Defect, "the worker gave no row".to_owned())
                }
            }
            Ok(Finished::Refused(_, true)) | Err(Death::Overran) if is_stopped => ChunkSolved::Nothing,
            Err(Death::Killed(_)) if self.is_draining() && job.is_durable() => ChunkSolved::Nothing,
            Ok(Finished::Refused(_, true)) | Err(Death::Overran) => {
                lost(Fault::Overran, format!("the member did not stop after {seconds} s"))
            }
            Ok(Finished::TooMuchMemory(estimate)) => {
                let allowed = self.bounds.memory;
                ChunkSolved::Broken(Fault::TooMuchMemory { allowed, asked: None, estimate: Some(estimate) })
            }
            Ok(Finished::Refused(errors, false)) => {
                let errors = String::from_utf8_lossy(&errors);
                tracing::error!(%errors, "the specification of job {} cannot be read", job.id);
                ChunkSolved::Broken(Fault::Unreadable)
            }
            Ok(Finished::TooLarge) => ChunkSolved::Broken(Fault::TooLarge { limit: self.bounds.result_bytes }),
            Ok(Finished::Checked(..) | Finished::Solved(..)) => ChunkSolved::Broken(Fault::Defect),
            Err(death) => {
                tracing::warn!(?death, ?chunk, "the worker of job {} died: {}", job.id, death.code());
                let fault = Fault::of(&death, self.bounds.memory, None);
                lost(fault, "the member took its worker down".to_owned())
            }
        };
        (solved, Vec::new())
    }

    /// Asks the running chunks of a sweep to stop, if the job is a sweep, and ends the sweep if no chunk is on a
    /// worker.
    pub(super) async fn stop_chunks(&self, job: &Arc<Job>, reason: Halt) {
        if let Some(chunks) = &job.chunks
            && job.control().is_some()
        {
            chunks.halt(reason);
            self.settle(job, chunks).await;
        }
    }

    /// Ends a sweep, if no worker has a chunk of it, and it is complete, was asked to stop or cannot continue.
    pub(super) async fn settle(&self, job: &Arc<Job>, chunks: &Arc<Chunks>) {
        let Some(control) = job.control() else { return };
        let is_late = control.poll().is_some();
        let Some(settled) = chunks.settle(job.halted(), is_late) else { return };
        let mut counted = None;
        let ended = match settled {
            Settled::Parked => {
                self.store.save_rows(job).await;
                return self.store.park(job).await;
            }
            Settled::Broken(fault) => job.ended(Ending::Broken(fault)),
            // If this job is one chunk of a sweep that machines share, the table is made of all rows by the process
            // that divides the sweep.
            Settled::Table(_) if chunks.is_part() => {
                return self.store.conclude(job, job.ended(Ending::Successful)).await;
            }
            Settled::Table(_) if job.is_forgotten() => job.ended(Ending::Dismissed),
            Settled::Table(incomplete) => match self.make_table(job, chunks, incomplete).await {
                Ok(Some(Made { ending, solution, results })) => {
                    counted = Some(Solved { problem: job.problem(), ..Solved::of("", &solution) });
                    self.ended(job, ending, Some(solution.verdict), Ok(results))
                }
                Ok(None) => job.ended(Ending::Dismissed),
                Err(Unmade::TooLarge) => job.ended(Ending::Broken(Fault::TooLarge { limit: self.bounds.result_bytes })),
                Err(Unmade::Unread(error)) => {
                    tracing::error!(%error, "the rows of job {} cannot be read", job.id);
                    let before = chunks.rows();
                    chunks.resume();
                    if chunks.rows() < before {
                        // Members whose rows are damaged are open again, and will be solved again.
                        self.metrics.found_damaged();
                        return;
                    }
                    job.ended(Ending::Broken(Fault::Unreadable))
                }
            },
        };
        let time = ended.timing.map_or(Duration::ZERO, |timing| timing.solve);
        match counted {
            Some(solved) => self.metrics.solved(&solved, time),
            None => self.metrics.ended(job.problem(), ended.ending.code().into(), time),
        }
        job.log_end(&ended);
        self.store.conclude(job, ended).await;
        // A job whose end could not be stored is parked (it will wait in the queue again), and makes its table again
        // when it is resumed.
        let Some(ended) = job.settled().await else { return };
        chunks.set_document(None);
        *chunks.log() = RowLog::default();
        // The rows stay on the disk as long as the table is in memory only.
        if job.is_durable() && !matches!(ended.held, Some(Held::Memory(_))) {
            self.store.remove_rows(job.id);
        }
    }

    /// Makes the table of the rows of a sweep, as results; returns `None` if there are no rows.
    async fn make_table(
        &self,
        job: &Arc<Job>,
        chunks: &Arc<Chunks>,
        incomplete: Option<Incomplete<'static>>,
    ) -> Result<Option<Made>, Unmade> {
        let (chunks, spool, limit) = (Arc::clone(chunks), self.store.spool(job.id), self.bounds.result_bytes);
        let is_dismissed = job.halted() == Some(Halt::Dismiss);
        let make = move || {
            let Some((backing, index)) = parts(&chunks, spool)? else { return Ok(None) };
            let (source, _) = backing.open()?;
            let members = StoredMembers::new(source, index.clone(), 0);
            let incomplete = incomplete.unwrap_or(Incomplete::MEMBERS_MISSING);
            let solution = answer(&members, chunks.facts.members, incomplete)?;
            drop(members);
            let failed = solution.error.as_ref().map(|failure| failure.message.as_str());
            let ending = Ending::of(solution.status, failed, is_dismissed && solution.status == Status::Stopped);
            let results = Results::of_members(backing, index, Skeleton::of(&solution)?, limit)?;
            Ok(Some(Made { ending, solution, results }))
        };
        spawn_blocking(make).await.unwrap_or_else(|error| Err(Unmade::from(io::Error::other(error))))
    }
}

/// Whether `bytes` encode `rows` rows of consecutive members of a sweep, the first of which is `first`.
pub(super) fn are_rows(bytes: &[u8], first: usize, rows: usize) -> bool {
    let Ok(table) = Table::of_bytes(bytes) else { return false };
    let Some(members) = table.column("member") else { return false };
    table.rows() == rows && (0..rows).all(|row| members.number(row) == Some((first + row) as f64))
}

/// Writes all rows in the log of a sweep, in the order of members, as the parts of a table to `spool`; returns `None`
/// if there are no rows.
fn parts(chunks: &Chunks, mut spool: Spool) -> io::Result<Option<(Backing, PartsIndex)>> {
    let (log, mut writer) = (chunks.log(), PartsWriter::default());
    for (_, rows) in log.in_order() {
        writer.add(Table::of_bytes(&rows?)?, &mut spool)?;
    }
    Ok(writer.end(&mut spool)?.map(|index| (spool.end(), index)))
}

impl From<io::Error> for Unmade {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::FileTooLarge => Self::TooLarge,
            _ => Self::Unread(error),
        }
    }
}
