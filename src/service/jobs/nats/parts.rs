//! The chunks of a sweep that workers share: each is a message of its own, with an entry that says which members it has, who
//! has claimed it, and what has become of it. A worker that takes it claims it by a compare-and-set, writes its rows, and
//! only then the end, by a compare-and-set that fails if the chunk has been withdrawn or claimed by another since; it
//! acknowledges last. So a chunk counts once, however often its message comes.

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

/// What a message of the queue stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Work {
    /// A job; of a sweep, the division into chunks and the table.
    Job(JobId),
    /// A chunk of a sweep.
    Part(PartId),
}

/// The name of a chunk of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PartId {
    /// The job of the sweep.
    pub sweep: JobId,
    /// The attempt at the sweep in which the chunk was made, and its number within.
    pub attempt: u32,
    /// The number.
    pub number: u32,
}

/// The entry of a chunk.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Part {
    /// [`FORMAT`].
    pub format: u32,
    /// The first of its members, and the one behind the last.
    pub first: usize,
    pub end: usize,
    /// Why its members cannot be solved, if that is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lost: Option<Lost>,
    /// When the time is over that the client allows for the sweep.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<Timestamp>,
    /// The worker that has it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub claim: Option<Claim>,
    /// The number of workers that were lost while they had it, and of those on which it ran alone.
    pub crashes: u32,
    pub crashes_alone: u32,
    /// What has become of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub done: Option<Done>,
}

/// What has become of a chunk.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Done {
    /// So many of its first members have rows, in so many bytes; none has if the solve was stopped.
    Rows {
        rows: usize,
        /// The members that took processes down.
        lost: usize,
        steps: u64,
        bytes: usize,
        digest: Digest,
        /// The time of the solve, zero if it says nothing of other members.
        seconds: f64,
        /// The attempt that made the rows.
        attempt: u32,
    },
    /// The sweep cannot go on.
    Broken(Fault),
    /// It took workers down.
    Poisoned,
    /// It is not wanted any more.
    Withdrawn,
}

impl fmt::Display for PartId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { sweep, attempt, number } = self;
        write!(f, "{sweep}_{attempt}_{number}")
    }
}

impl PartId {
    /// The chunk of this sweep in whose number a key ends.
    pub fn of_key(sweep: JobId, key: &str) -> Option<Self> {
        let (attempt, number) = key.rsplit('.').next()?.split_once('_')?;
        Some(Self { sweep, attempt: attempt.parse().ok()?, number: number.parse().ok()? })
    }

    /// The chunk whose entry has this key.
    pub fn of(key: &str) -> Option<Self> {
        let (sweep, _) = key.strip_prefix("part.")?.split_once('.')?;
        Self::of_key(sweep.parse().ok()?, key)
    }

    /// The key of its entry.
    pub fn key(self) -> String {
        let Self { sweep, attempt, number } = self;
        format!("part.{sweep}.{attempt}_{number}")
    }

    /// The name of the rows of an attempt at it.
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

/// A text that names nothing which this version knows.
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
    /// What a message with this subject stands for.
    pub fn of(subject: &str) -> Option<Self> {
        subject.rsplit('.').next()?.parse().ok()
    }

    /// The job that it belongs to.
    pub fn job(self) -> JobId {
        match self {
            Self::Job(id) | Self::Part(PartId { sweep: id, .. }) => id,
        }
    }
}

impl Versioned for Part {}

impl Part {
    /// A chunk that waits for a worker.
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

    /// The members.
    pub fn chunk(&self) -> Chunk {
        Chunk { members: self.first..self.end, lost: self.lost.clone() }
    }
}

impl Exchange {
    /// The chunks of a sweep that have entries.
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

    /// Removes the chunks of a sweep and their rows.
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
        // Last: what is long is found by the entries. A worker that takes the message of a chunk without one acknowledges it.
        self.clear(&format!("part.{sweep}.*")).await
    }
}

impl Worker {
    /// Solves the chunk that a message stands for.
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

    /// Has a chunk stop if its sweep is to.
    pub async fn begin_part(&self, id: PartId, job: &Arc<Job>) {
        self.mine().insert(Work::Part(id), Some(Arc::clone(job)));
        let is_cancelled = self.cancelled().contains(&id.sweep);
        if is_cancelled {
            // Nothing on a disk is to be changed.
            let _ = self.jobs.cancel(job).await;
        }
    }

    /// The specification of a sweep, which is kept for its next chunk.
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

    /// Gives a chunk back that was claimed.
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
            // The next worker finds that this one does not have it.
            Err(_) => Reply::Later(PAUSE),
        }
    }

    /// Writes rows and end of a chunk, however long it takes.
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
                // The claim stays, so that an answer that was lost on its way is found here as well.
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

    /// Writes the rows of a chunk, however long it takes.
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
    /// Takes a chunk of a sweep on, as a job that no client sees.
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
        // Under a name of its own: a worker may have several chunks of a sweep.
        let job = Arc::new(Job::taken_on(JobId::new(), record, Some(chunks), document));
        // Without a key, nothing is in its way.
        let _ = self.store.index().insert(&job);
        self.lock().queue.push(job.client, Arc::clone(&job));
        self.arrival.notify_one();
        job
    }
}

/// What has become of a chunk that ended after `time`, and its rows.
pub fn outcome(job: &Job, ended: &Ended, time: Duration) -> (Done, Vec<u8>) {
    if let Ending::Broken(fault) = ended.ending {
        return (Done::Broken(fault), Vec::new());
    }
    let Some(chunks) = &job.chunks else { return (Done::Broken(Fault::Defect), Vec::new()) };
    let (lost, log) = (chunks.lost(), chunks.log());
    // There is one record at most.
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
