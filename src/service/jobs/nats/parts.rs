//! The chunks of a sweep that workers share: each is a message of its own, with an entry that says which members it
//! has, which worker has claimed it, and its outcome. A worker that takes the message claims the chunk by a
//! compare-and-set, writes the rows, and only then the outcome, by a compare-and-set that fails if the chunk has been
//! withdrawn or claimed by another worker meanwhile; it acknowledges last. So a chunk counts once, however often its
//! message is delivered.

use super::claims::{Decision, Holder, decide_part};
use super::entry::{Claim, Entry, FORMAT, Versioned};
use super::servers::{Away, Exchange, ONE_MESSAGE, Trouble, away};
use super::worker::{PAUSE, Reply, Worker};
use crate::digest::Digest;
use crate::jobs::chunks::{Chunk, Chunks};
use crate::jobs::{Ended, Ending, Fault, Job, JobId, Jobs, Record};
use crate::worker::{Lost, SweepFacts};
use futures_util::TryStreamExt;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::io;
use std::str::FromStr;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::time::sleep;

/// The work that a message of the NATS queue stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Work {
    /// A job to solve; of a sweep, its division into chunks and its table.
    Job(JobId),
    /// A chunk to solve of a sweep that workers share.
    Part(PartId),
}

/// The identity of a chunk of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PartId {
    /// The job of the sweep that the chunk belongs to.
    pub sweep: JobId,
    /// The number of the attempt to solve the sweep in which the chunk was made.
    pub attempt: u32,
    /// The number of the chunk within the attempt to solve the sweep.
    pub number: u32,
}

/// The entry of a chunk of a sweep in the NATS bucket of states.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Part {
    /// The format version of the entry, [`FORMAT`].
    pub format: u32,
    /// The index of the first member of the chunk, and the one behind the last.
    pub first: usize,
    pub end: usize,
    /// The reason, if known, for which the members of the chunk cannot be solved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lost: Option<Lost>,
    /// The time up to which the client allows the sweep to run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<Timestamp>,
    /// The claim of the worker that is solving the chunk.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub claim: Option<Claim>,
    /// The number of workers that were lost while they had the chunk, and of those on which it ran alone.
    pub crashes: u32,
    pub crashes_alone: u32,
    /// The outcome of the chunk, once its solve is finished.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub done: Option<Done>,
}

/// The outcome of a chunk of a sweep.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Done {
    /// The number of first members of the chunk that have rows, and the size of the rows in bytes; zero rows if the
    /// solve was stopped.
    Rows {
        rows: usize,
        /// The number of members of the chunk without a solution, because they made their worker process die or
        /// exceeded the time limit.
        lost: usize,
        steps: u64,
        bytes: usize,
        digest: Digest,
        /// The time of the solves of the chunk in seconds; zero if it does not predict the time that other members of
        /// the sweep take.
        seconds: f64,
        /// The attempt at the chunk that made the rows, which is a part of their name.
        attempt: u32,
    },
    /// A fault that prevents the whole sweep from continuing.
    Broken(Fault),
    /// The chunk has made several workers die, and is not solved again.
    Poisoned,
    /// The chunk was withdrawn by the worker that divides the sweep.
    Withdrawn,
}

impl fmt::Display for PartId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { sweep, attempt, number } = self;
        write!(f, "{sweep}_{attempt}_{number}")
    }
}

impl PartId {
    /// Parses the identity of a chunk of `sweep` from a key that ends in the numbers of the attempt and the chunk.
    pub fn of_key(sweep: JobId, key: &str) -> Option<Self> {
        let (attempt, number) = key.rsplit('.').next()?.split_once('_')?;
        Some(Self { sweep, attempt: attempt.parse().ok()?, number: number.parse().ok()? })
    }

    /// Parses the identity of a chunk from the key of its entry in the bucket of states.
    pub fn of(key: &str) -> Option<Self> {
        let (sweep, _) = key.strip_prefix("part.")?.split_once('.')?;
        Self::of_key(sweep.parse().ok()?, key)
    }

    /// Returns the key of the chunk's entry in the bucket of states.
    pub fn key(self) -> String {
        let Self { sweep, attempt, number } = self;
        format!("part.{sweep}.{attempt}_{number}")
    }

    /// Returns the name under which the rows of an attempt at the chunk are stored.
    pub fn rows(self, attempt: u32) -> String {
        let Self { sweep, attempt: of_sweep, number } = self;
        format!("rows.{sweep}.{of_sweep}_{number}.{attempt}")
    }
}

impl fmt::Display for Work {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Job(id) => id.fmt(f),
            Self::Part(id) => id.fmt(f),
        }
    }
}

/// The error of a text that names neither a job nor a chunk, as far as this version knows.
#[derive(Debug)]
pub struct Unknown;

impl FromStr for Work {
    type Err = Unknown;

    fn from_str(text: &str) -> Result<Self, Unknown> {
        match text.split_once('_') {
            None => text.parse().map(Self::Job).map_err(|_| Unknown),
            Some((sweep, number)) => {
                let sweep = sweep.parse().map_err(|_| Unknown)?;
                PartId::of_key(sweep, number).map(Self::Part).ok_or(Unknown)
            }
        }
    }
}

impl Work {
    /// Parses the job or chunk that a message with this NATS subject stands for.
    pub fn of(subject: &str) -> Option<Self> {
        subject.rsplit('.').next()?.parse().ok()
    }

    /// Returns the job of this work; for a chunk of a sweep, the job of the sweep.
    pub fn job(self) -> JobId {
        match self {
            Self::Job(id) | Self::Part(PartId { sweep: id, .. }) => id,
        }
    }
}

impl Versioned for Part {}

impl Part {
    /// Creates the entry of a chunk that waits for a worker, with the time up to which the sweep may run.
    pub fn waiting(chunk: &Chunk, until: Option<Timestamp>) -> Self {
        let Chunk { members, lost } = chunk.clone();
        Self {
            format: FORMAT,
            first: members.start,
            end: members.end,
            lost,
            until,
            claim: None,
            crashes: 0,
            crashes_alone: 0,
            done: None,
        }
    }

    /// Returns the chunk that the entry describes: its range of members, and why they cannot be solved, if so.
    pub fn chunk(&self) -> Chunk {
        Chunk { members: self.first..self.end, lost: self.lost.clone() }
    }
}

impl Exchange {
    /// Returns the chunks of a sweep that have entries.
    ///
    /// # Errors
    /// See [`Trouble`].
    pub async fn parts(&self, sweep: JobId) -> Result<Vec<(PartId, Part)>, Trouble> {
        self.near()?;
        let filter = format!("{}part.{sweep}.*", self.state.prefix);
        let listed = self.state.stream.info_with_subjects(filter).await.map_err(|error| away(&error))?;
        let subjects: Vec<(String, usize)> = listed.try_collect().await.map_err(|error| away(&error))?;
        let mut parts = Vec::new();
        for (subject, _) in subjects {
            let Some(id) = PartId::of_key(sweep, &subject) else { continue };
            if let Some((part, _)) = self.read(&id.key()).await? {
                parts.push((id, part));
            }
        }
        Ok(parts)
    }

    /// Removes the entries of the chunks of a sweep and their rows.
    ///
    /// # Errors
    /// The servers do not answer.
    pub async fn clear_parts(&self, sweep: JobId) -> Result<(), Away> {
        let parts = match self.parts(sweep).await {
            Ok(parts) => parts,
            Err(Trouble::OtherVersion) => Vec::new(),
            Err(Trouble::Away) => return Err(Away),
        };
        for (id, part) in parts {
            if let Some(Done::Rows { bytes, attempt, .. }) = part.done
                && bytes > self.client.max_payload().min(ONE_MESSAGE)
            {
                self.remove(&id.rows(attempt)).await?;
            }
        }
        let rows = format!("{}rows.{sweep}.>", self.data.prefix);
        self.data.stream.purge().filter(rows).await.map_err(|error| away(&error))?;
        // The entries of the chunks are removed last, since long rows are found by them. A worker that takes the
        // message of a chunk without an entry acknowledges the message.
        self.clear(&format!("part.{sweep}.*")).await
    }
}

impl Worker {
    /// Claims and solves the chunk that a message stands for; returns how to answer the message.
    pub async fn see_to_part(&self, id: PartId, lost_after: Duration) -> Reply {
        let key = id.key();
        let (found, sweep) = tokio::join!(self.exchange.read::<Part>(&key), self.exchange.entry(id.sweep));
        let entry = match sweep {
            Ok(Some((entry, _))) if entry.record.ended.is_none() => entry,
            Ok(_) => {
                let _ = self.exchange.clear(&id.key()).await;
                return Reply::Acknowledge;
            }
            Err(trouble) => return Reply::after(trouble),
        };
        let Some(facts) = entry.record.sweep() else { return Reply::Acknowledge };
        let document = match self.document(id.sweep, &entry).await {
            Ok(document) => document,
            Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                let broken = self.alter_part(id, |part| part.done = Some(Done::Broken(Fault::Damaged)));
                return broken.await;
            }
            Err(_) => return Reply::Later(PAUSE),
        };
        let (part, revision) = match self.claim_part(id, found, lost_after).await {
            Ok(claimed) => claimed,
            Err(reply) => return reply,
        };
        let begun = Instant::now();
        let (crashes, crashes_alone) = (part.crashes, part.crashes_alone);
        let record = Record { crashes, crashes_alone, ..entry.record };
        let job = self.jobs.take_part(record, part.until, facts, &part.chunk(), document);
        self.begin_part(id, &job).await;
        let ended = job.settled().await;
        let reply = match ended {
            Some(ended) => {
                let (done, rows) = outcome(&job, &ended, begun.elapsed());
                self.finish_part(id, (part, revision), done, &rows).await
            }
            None => self.release_part(id, (part, revision)).await,
        };
        let _ = self.jobs.forget(&job).await;
        reply
    }

    /// Registers the job of a chunk that begins, and stops the job if its sweep is to stop.
    pub async fn begin_part(&self, id: PartId, job: &Arc<Job>) {
        self.mine().insert(Work::Part(id), Some(Arc::clone(job)));
        let is_cancelled = self.cancelled().contains(&id.sweep);
        if is_cancelled {
            // The job of the chunk is in memory only, so that cancelling it cannot fail.
            let _ = self.jobs.cancel(job).await;
        }
    }

    /// Returns the specification of a sweep, which is kept in memory for the next chunk of the sweep.
    async fn document(&self, sweep: JobId, entry: &Entry) -> io::Result<Arc<[u8]>> {
        let known = self.latest().clone();
        if let Some((_, document)) = known.filter(|(id, _)| *id == sweep) {
            return Ok(document);
        }
        let document: Arc<[u8]> = self.exchange.document_of(sweep, entry).await?.into();
        *self.latest() = Some((sweep, Arc::clone(&document)));
        Ok(document)
    }

    async fn claim_part(
        &self,
        id: PartId,
        mut found: Result<Option<(Part, u64)>, Trouble>,
        lost_after: Duration,
    ) -> Result<(Part, u64), Reply> {
        loop {
            let (part, revision) = match found {
                Ok(Some(found)) => found,
                Ok(None) => return Err(Reply::Acknowledge),
                Err(trouble) => return Err(Reply::after(trouble)),
            };
            let holder = match &part.claim {
                Some(claim) if claim.worker == self.name => Holder::LeftIt,
                Some(claim) if part.done.is_none() => self.ask(&claim.worker, Work::Part(id), lost_after).await,
                Some(_) | None => Holder::Unknown,
            };
            let (next, is_over) = match decide_part(&part, &self.name, holder, lost_after) {
                Decision::Drop => return Err(Reply::Acknowledge),
                Decision::Wait(time) => return Err(Reply::Later(time)),
                Decision::End(next) => (*next, true),
                Decision::Take(next) => (*next, false),
            };
            match self.exchange.state.update(id.key(), next.text().into(), revision).await {
                Ok(_) if is_over => return Err(Reply::Acknowledge),
                Ok(revision) => return Ok((next, revision)),
                Err(_) => found = self.exchange.read(&id.key()).await,
            }
        }
    }

    /// Releases the claim to a chunk, so that another worker takes it.
    async fn release_part(&self, id: PartId, (part, revision): (Part, u64)) -> Reply {
        let (key, claim) = (id.key(), part.claim.clone());
        let released = self.exchange.alter(&key, Some((part, revision)), |part: &mut Part| {
            let is_mine = part.done.is_none() && part.claim == claim;
            if is_mine {
                part.claim = None;
            }
            is_mine
        });
        match released.await {
            Ok(Some(_)) => Reply::Later(Duration::ZERO),
            Ok(None) => Reply::Acknowledge,
            // The claim to the chunk may stay in its entry: the next worker that gets the message asks this worker,
            // which answers that it does not have the chunk.
            Err(_) => Reply::Later(PAUSE),
        }
    }

    /// Writes the rows and the outcome of a chunk, with retries until the NATS servers accept them.
    async fn finish_part(&self, id: PartId, (part, revision): (Part, u64), done: Done, rows: &[u8]) -> Reply {
        let attempt = part.crashes + 1;
        let name = id.rows(attempt);
        let done = match done {
            Done::Rows { rows, lost, steps, bytes, digest, seconds, .. } => {
                Done::Rows { rows, lost, steps, bytes, digest, seconds, attempt }
            }
            other => other,
        };
        if !rows.is_empty() {
            self.write_rows(&name, rows).await;
        }
        let (key, claim) = (id.key(), part.claim.clone());
        let mut known = Some((part, revision));
        loop {
            let change = self.exchange.alter(&key, known.take(), |part: &mut Part| {
                let is_mine = part.done.is_none() && part.claim == claim;
                if is_mine {
                    part.done = Some(done.clone());
                }
                is_mine
            });
            match change.await {
                // The claim stays in the entry of the chunk: by it, an outcome that an earlier attempt has written,
                // and whose confirmation was lost, is recognized here as well.
                Ok(Some((part, _))) if part.claim == claim && !matches!(part.done, Some(Done::Withdrawn)) => {
                    return Reply::Acknowledge;
                }
                Ok(found) => {
                    tracing::debug!("chunk {id} is not wanted any more, or another worker has it");
                    let _ = self.exchange.remove(&name).await;
                    let is_over = found.is_none_or(|(part, _)| part.done.is_some());
                    return if is_over { Reply::Acknowledge } else { Reply::Nothing };
                }
                Err(Trouble::OtherVersion) => return Reply::Nothing,
                Err(Trouble::Away) => sleep(PAUSE).await,
            }
        }
    }

    /// Writes the rows of a chunk, with retries until the NATS servers accept them.
    pub async fn write_rows(&self, name: &str, rows: &[u8]) {
        while self.exchange.put_rows(name, rows).await.is_err() {
            sleep(PAUSE).await;
        }
    }

    async fn alter_part(&self, id: PartId, change: impl Fn(&mut Part)) -> Reply {
        let key = id.key();
        let altered = self.exchange.alter(&key, None, |part: &mut Part| {
            let is_open = part.done.is_none();
            if is_open {
                change(part);
            }
            is_open
        });
        altered.await.map_or_else(Reply::after, |_| Reply::Acknowledge)
    }
}

impl Jobs {
    /// Queues a chunk of a sweep in this process, as a job that no client sees.
    pub(super) fn take_part(
        &self,
        record: Record,
        until: Option<Timestamp>,
        facts: SweepFacts,
        chunk: &Chunk,
        document: Arc<[u8]>,
    ) -> Arc<Job> {
        let left = until.map(|until| until.duration_since(Timestamp::now()).as_secs_f64().max(0.0));
        let chunks = Chunks::part(SweepFacts { seconds: left, ..facts }, chunk);
        let record = Record { key: None, ..record };
        // The job of the chunk has an id of its own, since a worker may have several chunks of a sweep.
        let job = Arc::new(Job::taken_on(JobId::new(), record, Some(chunks), document));
        // Insertion into the index succeeds, since the job has no idempotency key.
        let _ = self.store.index().insert(&job);
        self.lock().queue.push(job.client, Arc::clone(&job));
        self.arrival.notify_one();
        job
    }
}

/// Returns the outcome of a chunk that ended after `time`, and its rows.
pub fn outcome(job: &Job, ended: &Ended, time: Duration) -> (Done, Vec<u8>) {
    if let Ending::Broken(fault) = ended.ending {
        return (Done::Broken(fault), Vec::new());
    }
    let Some(chunks) = &job.chunks else { return (Done::Broken(Fault::Defect), Vec::new()) };
    let (lost, log) = (chunks.lost(), chunks.log());
    // The row log of a chunk that is solved as a job of its own contains at most one record.
    let (count, steps, rows) = match log.in_order().next() {
        Some((record, Ok(rows))) => (record.members.len(), record.steps, rows),
        Some((_, Err(_))) | None => (0, 0, Vec::new()),
    };
    let seconds = if lost == 0 { time.as_secs_f64() } else { 0.0 };
    let digest = Digest::of(&rows);
    (Done::Rows { rows: count, lost, steps, bytes: rows.len(), digest, seconds, attempt: 1 }, rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_jobs_and_of_chunks_read_back_and_others_are_unknown() {
        let sweep = JobId::new();
        let part = PartId { sweep, attempt: 2, number: 31 };
        for work in [Work::Job(sweep), Work::Part(part)] {
            assert_eq!(Work::of(&format!("dvi.jobs.a0a000001.{work}")), Some(work));
            assert_eq!(work.job(), sweep);
        }
        assert_eq!(PartId::of_key(sweep, &part.key()), Some(part));
        for other in ["", "x", "dvi.jobs.a0.1_2_3", &format!("{sweep}_1"), &format!("{sweep}_1_2_3")] {
            assert_eq!(Work::of(other), None, "{other}");
        }
    }
}
