//! A sweep that workers share. The worker that has claimed it, its divider, turns chunks into messages in the queue
//! of the client; the worker that takes such a message solves the chunk and writes its rows, and in the end the
//! divider makes the table of the rows, as a service on one machine does. Dividing occupies no solver process of the
//! divider, which takes other messages meanwhile, including chunks of the sweep.
//!
//! 1. For the time [`UNSHARED`], the divider solves chunks itself: most sweeps are over then.
//! 2. Then the rows so far are written, and chunks are put into the queue, always some more than workers have taken.
//!    Entries of chunks report their outcomes; the divider follows the entries, and fetches rows as they come.
//! 3. A divider that is lost is replaced as the worker of any job is: the next divider begins with the rows and
//!    chunks that it finds, and leaves claimed chunks to their workers.
//! 4. Chunks and rows are removed when the entry of the job says that it has ended, before its message is
//!    acknowledged.

mod here;

use self::here::Here;
use super::entry::{Entry, Versioned as _};
use super::errand::bare;
use super::parts::{Done, Part, PartId};
use super::servers::Trouble;
use super::worker::{Claimed, LAST_CALL, OTHERS, PAUSE, Place, Reply, Worker};
use crate::jobs::chunk_work::are_rows;
use crate::jobs::chunks::{Chunk, Chunks, Solved};
use crate::jobs::intake::Lane;
use crate::jobs::{Ended, Halt, Job, JobId, Jobs, Record, State};
use crate::worker::{Lost, SweepFacts};
use jiff::Timestamp;
use std::collections::HashMap;
use std::env::temp_dir;
use std::fs;
use std::future::pending;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::Duration;
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep, sleep_until};

/// The time for which the worker that took a sweep solves it alone, before it shares chunks: long compared with the
/// writes and reads of a chunk.
const UNSHARED: Duration = Duration::from_millis(100);

/// The number of workers assumed for the size of the chunks of a sweep as long as no worker has taken a chunk.
const EXPECTED: usize = 4;

/// The least number of chunks of a shared sweep that are kept waiting for workers.
const WAITING: usize = 2;

/// The largest number of sweeps that one worker divides at a time: each has its rows in a file and follows its
/// chunks. Further sweeps are given back after a chunk.
const MOST_DIVIDED: usize = 64;

/// The number of chunks that are halved after they made workers die, to find the member that does so; the members of
/// further such chunks are set aside together. Half of this number suffices to find one member in a chunk of the
/// largest size.
const HALVED: usize = 16;

/// The interval at which the worker that divides a sweep checks whether it still has the claim to the sweep, and reads
/// the entries of the chunks.
const LOOK: Duration = Duration::from_secs(5);

/// The interval at which the worker that divides a sweep checks chunks that have been asked to stop.
const STOPPING: Duration = Duration::from_millis(200);

/// The way in which the division of a sweep ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Divided {
    /// The job of the sweep has ended, or has been given back.
    Settled,
    /// The worker divides the largest number of sweeps already, so that the sweep is given back.
    Full,
    /// Another worker has claimed the sweep.
    Lost,
}

/// A sweep that this worker has claimed and divides.
struct Sweep<'w> {
    worker: &'w Arc<Worker>,
    job: Arc<Job>,
    chunks: Arc<Chunks>,
    facts: SweepFacts,
    record: Record,
    document: Arc<[u8]>,
    entry: (Entry, u64),
    attempt: u32,
    /// The number that the next chunk of the sweep gets.
    number: u32,
    /// The time up to which the client allows the sweep to run.
    until: Option<Timestamp>,
    /// The chunks of the sweep that wait or that other workers solve; the flag says whether a worker has claimed the
    /// chunk.
    out: HashMap<PartId, (Chunk, bool)>,
    /// The chunk that the divider, the worker that divides the sweep, solves itself.
    here: Option<Here>,
    /// The outcomes and rows of chunks that the divider has solved and not written to the servers.
    unwritten: Vec<(PartId, Chunk, Done, Vec<u8>)>,
    rows: RowFile,
    stopping_since: Option<Instant>,
    /// The number of chunks of the sweep that have made workers die.
    poisoned: usize,
    /// Whether chunks of the sweep have entries in the bucket of states.
    has_parts: bool,
    /// Counts this sweep among those that the worker divides for others; `None` until the sweep is shared.
    counted: Option<Counted<'w>>,
}

/// An increment by one of a counter, which is undone when this value is dropped.
struct Counted<'w>(&'w AtomicUsize);

impl<'w> Counted<'w> {
    /// Adds one to the counter `count` until this value is dropped; `None` if the counter has reached `most`.
    fn within(count: &'w AtomicUsize, most: usize) -> Option<Self> {
        let more = |count: usize| (count < most).then_some(count + 1);
        // `Self` is made only if the counter was increased: to drop a value made otherwise would decrease the
        // counter.
        count.fetch_update(Relaxed, Relaxed, more).is_ok().then(|| Self(count))
    }
}

impl Drop for Counted<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Relaxed);
    }
}

/// The path of the file with the rows of a sweep; the file is removed when this value is dropped.
struct RowFile(PathBuf);

impl Drop for RowFile {
    fn drop(&mut self) {
        // Removal fails if the rows of the sweep never needed the file, which is harmless.
        let _ = fs::remove_file(&self.0);
    }
}

impl Worker {
    /// Solves a sweep, in part by other workers. `is_new` says that no worker has had the sweep before; `place`, one
    /// of the worker's concurrent solves, is dropped when this worker solves no further chunk in it.
    pub async fn divide(
        self: &Arc<Self>,
        claimed: Claimed,
        facts: SweepFacts,
        is_new: bool,
        place: &mut Option<Place>,
    ) -> Reply {
        let Claimed { id, entry, revision, document } = claimed;
        let is_new = is_new && entry.record.crashes == 0;
        let job = self.jobs.take_charge(id, &entry.record, facts, &document);
        let Some(chunks) = job.chunks.clone() else { return self.release(id, entry, revision).await };
        let attempt = entry.record.crashes + 1;
        let mut sweep = Sweep {
            worker: self,
            job: Arc::clone(&job),
            chunks,
            facts,
            record: Record { crashes: 0, crashes_alone: 0, ..entry.record.clone() },
            document,
            entry: (entry, revision),
            attempt,
            number: 0,
            until: None,
            out: HashMap::new(),
            here: None,
            unwritten: Vec::new(),
            rows: RowFile(temp_dir().join(format!("dvi-{}-{id}.rows", std::process::id()))),
            stopping_since: None,
            poisoned: 0,
            has_parts: !is_new,
            counted: None,
        };
        if !is_new {
            sweep.adopt().await;
        }
        self.jobs.begin_sweep(&job, &sweep.chunks, Lane::Long);
        let is_dismissed = sweep.entry.0.record.dismissed;
        self.begin(&job, is_dismissed).await;
        let shared = async {
            let divided = sweep.go(place).await;
            if divided != Divided::Settled {
                self.jobs.store.park(&job).await;
            }
            divided
        };
        let (divided, (ended, is_kept)) = tokio::join!(shared, self.follow_job(&job));
        let (has_parts, (entry, revision)) = (sweep.has_parts, sweep.entry);
        let reply = match (divided, ended) {
            (Divided::Lost, _) => Reply::Nothing,
            (_, Some(ended)) => {
                let reply = self.finish(&job, (entry, revision), &ended).await;
                if has_parts && matches!(reply, Reply::Acknowledge) {
                    while self.exchange.clear_parts(id).await.is_err() {
                        sleep(PAUSE).await;
                    }
                }
                reply
            }
            (divided, None) => match self.release(id, Entry { divided: has_parts, ..entry }, revision).await {
                Reply::Later(_) if divided == Divided::Full => Reply::Later(OTHERS),
                reply => reply,
            },
        };
        self.let_go(&job, is_kept).await;
        reply
    }
}

impl Sweep<'_> {
    /// Divides the sweep until its job has ended or has been given back.
    async fn go(&mut self, place: &mut Option<Place>) -> Divided {
        let (alone_until, mut following) = (Instant::now() + UNSHARED, JoinSet::new());
        let mut told: Option<UnboundedReceiver<(PartId, Part)>> = None;
        let mut look = Instant::now() + LOOK;
        let job = Arc::clone(&self.job);
        self.until = job.control().and_then(|control| control.deadline()).map(|deadline| {
            let left = deadline.saturating_duration_since(std::time::Instant::now());
            Timestamp::now().saturating_add(left).unwrap_or(Timestamp::MAX)
        });
        loop {
            self.worker.jobs.settle(&self.job, &self.chunks).await;
            if self.is_settled() {
                return Divided::Settled;
            }
            let halted = self.job.halted();
            if halted == Some(Halt::Park) && self.here.is_none() {
                self.write().await;
                self.worker.jobs.store.park(&self.job).await;
                return Divided::Settled;
            }
            let is_late = self.job.control().is_none_or(|control| control.poll().is_some());
            let stops = halted.is_some() || is_late;
            let is_shared = told.is_some();
            let is_long = Instant::now() >= alone_until && self.chunks.has_open();
            if !is_shared && !stops && (is_long || !self.out.is_empty()) {
                self.counted = Counted::within(&self.worker.divided, MOST_DIVIDED);
                if self.counted.is_none() {
                    self.end_here().await;
                    self.write().await;
                    return Divided::Full;
                }
                told = Some(self.follow(&mut following));
                continue;
            }
            if stops && halted != Some(Halt::Park) && !self.out.is_empty() {
                self.withdraw().await;
                if self.out.is_empty() {
                    continue;
                }
            }
            if is_shared {
                self.write().await;
                if self.here.is_none() {
                    *place = None;
                }
                while !stops && self.wants_more() && self.post().await {}
            } else if !stops
                && self.here.is_none()
                && let Some(chunk) = self.chunks.take(EXPECTED)
            {
                self.begin_here(chunk).await;
            }
            let deadline = self.job.control().and_then(|control| control.deadline()).map(Instant::from_std);
            let mut wake = look;
            if stops {
                wake = wake.min(Instant::now() + STOPPING);
            } else {
                wake = deadline.map_or(wake, |deadline| wake.min(deadline));
                if !is_shared && self.chunks.has_open() {
                    wake = wake.min(alone_until);
                }
            }
            let here = self.here.as_ref().map(|here| Arc::clone(&here.job));
            tokio::select! {
                ended = settled(here) => self.count_here(ended).await,
                Some((id, part)) = next(&mut told) => self.came(id, part).await,
                () = job.halted.notified() => {}
                () = sleep_until(wake) => {}
            }
            if Instant::now() >= look {
                look = Instant::now() + LOOK;
                if !self.look().await {
                    return Divided::Lost;
                }
            }
        }
    }

    fn is_settled(&self) -> bool {
        let lifecycle = self.job.lock();
        lifecycle.parked || matches!(lifecycle.state, State::Ended(_))
    }

    /// Takes over the rows and the chunks of the workers that divided the sweep before, if any.
    async fn adopt(&mut self) {
        let id = self.job.id;
        let mut parts = loop {
            match self.worker.exchange.parts(id).await {
                Ok(parts) => break parts,
                Err(Trouble::OtherVersion) => return,
                Err(Trouble::Away) => sleep(PAUSE).await,
            }
        };
        let of_attempt = parts.iter().filter(|(part, _)| part.attempt == self.attempt);
        self.number = of_attempt.map(|(part, _)| part.number + 1).max().unwrap_or(0);
        // Finished chunks come first, in the order in which they were made, since members that they did not solve may
        // be in chunks made later.
        parts.sort_unstable_by_key(|(part, _)| (part.attempt, part.number));
        let (done, waiting): (Vec<_>, Vec<_>) = parts.into_iter().partition(|(_, part)| part.done.is_some());
        for (part_id, part) in done {
            let chunk = match part.done {
                Some(Done::Rows { rows, .. }) => Chunk { members: part.first..part.first + rows, lost: part.lost },
                Some(Done::Poisoned) => part.chunk(),
                // Chunks of workers that divided the sweep before, with other outcomes, have left no rows.
                _ => continue,
            };
            if let Some(done) = part.done
                && !chunk.members.is_empty()
                && self.chunks.adopt(&chunk.members)
            {
                self.count(part_id, &chunk, done).await;
            }
        }
        for (part_id, part) in waiting {
            let chunk = part.chunk();
            if !self.chunks.adopt(&chunk.members) {
                continue;
            }
            // The worker that made the chunk may have died before the message of the chunk was in the NATS queue.
            let client = self.job.client;
            while let Ok(false) | Err(_) = self.worker.exchange.is_queued(part_id, client).await {
                match self.worker.exchange.enqueue(part_id, client, bare(), None).await {
                    Ok(()) => break,
                    Err(_) => sleep(PAUSE).await,
                }
            }
            self.out.insert(part_id, (chunk, part.claim.is_some()));
        }
    }

    /// Starts a task that follows the entries of the sweep's chunks, and returns the channel of their changes.
    fn follow(&self, following: &mut JoinSet<()>) -> UnboundedReceiver<(PartId, Part)> {
        let (tell, told) = unbounded_channel();
        let (worker, id) = (Arc::clone(self.worker), self.job.id);
        following.spawn(async move {
            let filter = format!("part.{id}.*");
            let came = |key: &str, text: Option<&[u8]>| {
                if let (Some(part_id), Some(part)) = (PartId::of_key(id, key), text.and_then(Part::read)) {
                    // Sending a change of an entry cannot fail, since the receiver outlives this task.
                    let _ = tell.send((part_id, part));
                }
            };
            worker.exchange.follow(&filter, came).await;
        });
        told
    }

    /// Whether more chunks of the sweep are to be put into the NATS queue for other workers.
    fn wants_more(&self) -> bool {
        let claimed = self.out.values().filter(|(_, is_claimed)| *is_claimed).count();
        self.out.len() - claimed < WAITING.max(claimed)
    }

    fn next_id(&mut self) -> PartId {
        let id = PartId { sweep: self.job.id, attempt: self.attempt, number: self.number };
        self.number += 1;
        id
    }

    /// Puts the next chunk of the sweep into the NATS queue of its client; returns false if there was none.
    async fn post(&mut self) -> bool {
        let workers = self.out.len() + usize::from(self.here.is_some());
        let Some(chunk) = self.chunks.take(workers.max(EXPECTED)) else { return false };
        let id = self.next_id();
        self.enter(id, &Part::waiting(&chunk, self.until)).await;
        while self.worker.exchange.enqueue(id, self.job.client, bare(), None).await.is_err() {
            sleep(PAUSE).await;
        }
        self.out.insert(id, (chunk, false));
        true
    }

    /// Writes the first entry of a chunk of the sweep to the bucket of states.
    async fn enter(&mut self, id: PartId, part: &Part) {
        self.has_parts = true;
        // If the entry of the chunk exists already, an earlier attempt in this loop has written it, and the answer of
        // the servers was lost.
        while self.worker.exchange.create(&id.key(), part.text()).await.is_err() {
            sleep(PAUSE).await;
        }
    }

    /// Updates the state of a chunk of the sweep by its new entry in the bucket of states.
    async fn came(&mut self, id: PartId, part: Part) {
        let Some((_, is_claimed)) = self.out.get_mut(&id) else { return };
        *is_claimed = part.claim.is_some();
        if let Some(done) = part.done
            && let Some((chunk, _)) = self.out.remove(&id)
        {
            self.count(id, &chunk, done).await;
        }
    }

    /// Records the outcome of a chunk that its entry reports, and fetches its rows from the NATS servers.
    async fn count(&mut self, id: PartId, chunk: &Chunk, done: Done) {
        let first = chunk.members.start;
        let (solved, time) = match done {
            Done::Rows { rows: 0, lost, .. } => {
                self.chunks.lose(lost);
                (Solved::Nothing, Duration::ZERO)
            }
            Done::Rows { rows, lost, steps, bytes, digest, seconds, attempt } => {
                self.chunks.lose(lost);
                let name = id.rows(attempt);
                let fetched = loop {
                    match self.worker.exchange.rows(&name, digest).await {
                        Ok(fetched) => break Some(fetched),
                        Err(error) if error.kind() == io::ErrorKind::InvalidData => break None,
                        Err(_) => sleep(PAUSE).await,
                    }
                };
                match fetched.filter(|fetched| are_rows(fetched, first, rows)) {
                    Some(fetched) => {
                        self.chunks.keep(first..first + rows, steps, fetched);
                        self.chunks.save(Some(&self.rows.0));
                        self.note_progress().await;
                        (Solved::Rows { rows, steps, bytes }, Duration::try_from_secs_f64(seconds).unwrap_or_default())
                    }
                    None => {
                        tracing::warn!("the rows of chunk {id} are damaged and made again");
                        (Solved::Nothing, Duration::ZERO)
                    }
                }
            }
            Done::Broken(fault) => (Solved::Broken(fault), Duration::ZERO),
            Done::Poisoned => {
                tracing::warn!(members = ?chunk.members, "chunk {id} has taken workers down");
                self.poisoned += 1;
                let message = "workers were lost while they solved the member".to_owned();
                let lost = Lost { code: "poisoned".to_owned(), message };
                if chunk.members.len() > 1 && self.poisoned <= HALVED {
                    (Solved::Lost(lost, 0), Duration::ZERO)
                } else {
                    (Solved::SetAside(lost), Duration::ZERO)
                }
            }
            Done::Withdrawn => (Solved::Nothing, Duration::ZERO),
        };
        self.chunks.end(chunk, None, &solved, time);
        self.report();
    }

    fn report(&self) {
        if let Some(control) = self.job.control() {
            let (fraction, steps) = self.chunks.progress();
            control.report(fraction, steps);
        }
    }

    /// Clears the suspicion against the sweep: since it has progressed, it was not the cause of earlier losses of
    /// workers.
    async fn note_progress(&mut self) {
        let (entry, revision) = &self.entry;
        let claim = entry.claim.clone();
        if !claim.as_ref().is_some_and(|claim| claim.alone) {
            return;
        }
        let change = |entry: &mut Entry| {
            let is_mine = entry.claim == claim;
            if let (true, Some(claim)) = (is_mine, &mut entry.claim) {
                claim.alone = false;
                entry.record.crashes_alone = 0;
            }
            is_mine
        };
        let known = Some((entry.clone(), *revision));
        if let Ok(Some((entry, revision))) = self.worker.exchange.change(self.job.id, known, change).await
            && entry.claim.as_ref().is_some_and(|claim| claim.worker == self.worker.name)
        {
            self.entry = (entry, revision);
        }
    }

    /// Withdraws the chunks of the sweep that no worker has claimed; after a time limit all chunks, since their workers
    /// do not answer.
    async fn withdraw(&mut self) {
        let since = *self.stopping_since.get_or_insert_with(Instant::now);
        let all = since.elapsed() > self.worker.exchange.lost_after.max(LAST_CALL);
        let ids: Vec<PartId> =
            self.out.iter().filter(|(_, (_, is_claimed))| all || !is_claimed).map(|(id, _)| *id).collect();
        for id in ids {
            let key = id.key();
            let changed = self.worker.exchange.alter(&key, None, |part: &mut Part| {
                let is_open = part.done.is_none() && (all || part.claim.is_none());
                if is_open {
                    part.done = Some(Done::Withdrawn);
                }
                is_open
            });
            match changed.await {
                Ok(Some((part, _))) => {
                    if matches!(part.done, Some(Done::Withdrawn)) {
                        // If removing the message of the chunk fails, a worker that takes it finds that the chunk is
                        // withdrawn.
                        let _ = self.worker.exchange.dequeue(id, self.job.client).await;
                    }
                    self.came(id, part).await;
                }
                // The entry of the chunk is missing, since the client has deleted the job of the sweep.
                Ok(None) => {
                    if let Some((chunk, _)) = self.out.remove(&id) {
                        self.chunks.end(&chunk, None, &Solved::Nothing, Duration::ZERO);
                    }
                }
                Err(_) => return,
            }
        }
    }

    /// Reads the entries of the sweep's chunks, in case a change was missed; returns whether this worker still has the
    /// claim to the sweep.
    async fn look(&mut self) -> bool {
        let exchange = &self.worker.exchange;
        let claim = &self.entry.0.claim;
        match exchange.entry(self.job.id).await {
            Ok(Some((entry, _))) if entry.record.ended.is_some() || entry.claim != *claim => return false,
            // If the client has deleted the job of the sweep, the request to stop it arrives separately.
            Ok(_) | Err(_) => {}
        }
        let ids: Vec<PartId> = self.out.keys().copied().collect();
        for id in ids {
            match self.worker.exchange.read::<Part>(&id.key()).await {
                Ok(Some((part, _))) => self.came(id, part).await,
                Ok(None) => {
                    if let Some((chunk, _)) = self.out.remove(&id) {
                        self.chunks.end(&chunk, None, &Solved::Nothing, Duration::ZERO);
                    }
                }
                Err(_) => break,
            }
        }
        true
    }
}

impl Jobs {
    /// Creates the job of a sweep that another process has admitted, to be divided by this worker.
    fn take_charge(&self, id: JobId, record: &Record, facts: SweepFacts, document: &Arc<[u8]>) -> Arc<Job> {
        let record = Record { key: None, ..record.clone() };
        let job = Arc::new(Job::taken_on(id, record, Some(Chunks::new(facts)), Arc::clone(document)));
        // Insertion into the index succeeds, since the job has no idempotency key.
        let _ = self.store.index().insert(&job);
        job
    }
}

/// Waits until a job has ended or was parked; without a job, waits for ever.
async fn settled(job: Option<Arc<Job>>) -> Option<Arc<Ended>> {
    match job {
        Some(job) => job.settled().await,
        None => pending().await,
    }
}

/// Receives the next value of a channel; without a channel, waits for ever.
async fn next<T>(told: &mut Option<UnboundedReceiver<T>>) -> Option<T> {
    match told {
        Some(told) => told.recv().await,
        None => pending().await,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_count_that_is_full_stays_right() {
        let count = AtomicUsize::new(0);
        let two = [0; 2].map(|_| Counted::within(&count, 2).unwrap());
        for _ in 0..3 {
            assert!(Counted::within(&count, 2).is_none());
        }
        assert_eq!(count.load(Relaxed), 2);
        drop(two);
        assert_eq!(count.load(Relaxed), 0);
        assert!(Counted::within(&count, 2).is_some());
    }
}
