//! A sweep that workers share. The worker that has claimed it *divides* it: chunks become messages in the line of the client,
//! whoever takes one writes its rows, and in the end the divider makes the table of them, as a service on one machine does.
//! Dividing takes no place of the worker, which takes other messages meanwhile, chunks of the same sweep included.
//!
//! 1. Chunks are solved in the place that took the sweep for [`UNSHARED`]: most sweeps are over then.
//! 2. Then the rows so far are written, and chunks are put into the queue, always some more than workers have taken. Entries
//!    of chunks say what has become of them; the divider follows them, and fetches rows as they come.
//! 3. A divider that is lost is replaced as the worker of any job is: the next begins with the rows and the chunks that it
//!    finds, and lets who solves a chunk go on.
//! 4. Chunks and rows are removed when the entry of the job says that it has ended, before its message is acknowledged.

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

/// The time for which the worker that took a sweep is alone with it: long beside the writes and reads of a chunk.
const UNSHARED: Duration = Duration::from_millis(100);

/// The number of workers that a sweep is divided for as long as none has taken a chunk.
const EXPECTED: usize = 4;

/// The least number of chunks that wait for workers.
const WAITING: usize = 2;

/// The largest number of sweeps that one worker divides at a time: each has its rows in a file and follows its chunks. Others
/// are given back after a chunk.
const MOST_DIVIDED: usize = 64;

/// The number of chunks that are halved when they have taken workers down, to find the member that does; the members of
/// further ones are set aside together. One member in a chunk of the largest size is found by half of these.
const HALVED: usize = 16;

/// The interval at which the divider looks whether the sweep is still its own, and the chunks as it was told.
const LOOK: Duration = Duration::from_secs(5);

/// The interval at which it looks after chunks that are to stop.
const STOPPING: Duration = Duration::from_millis(200);

/// How the division of a sweep ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Divided {
    /// The job has ended, or has been left.
    Settled,
    /// There is no room for another divided sweep.
    Full,
    /// Another worker divides it.
    Lost,
}

/// A sweep that this worker divides.
struct Sweep<'w> {
    worker: &'w Arc<Worker>,
    job: Arc<Job>,
    chunks: Arc<Chunks>,
    facts: SweepFacts,
    record: Record,
    document: Arc<[u8]>,
    entry: (Entry, u64),
    attempt: u32,
    /// The number of the next chunk.
    number: u32,
    /// When the time that the client allows is over.
    until: Option<Timestamp>,
    /// The chunks that others solve, or that wait, with whether a worker has claimed them.
    out: HashMap<PartId, (Chunk, bool)>,
    /// The chunk that is solved here.
    here: Option<Here>,
    /// What was solved here, and is not written yet.
    unwritten: Vec<(PartId, Chunk, Done, Vec<u8>)>,
    rows: RowFile,
    stopping_since: Option<Instant>,
    /// The number of chunks that have taken workers down.
    poisoned: usize,
    /// Chunks have entries.
    has_parts: bool,
    /// The sweep is one of those that the worker divides for others.
    counted: Option<Counted<'w>>,
}

/// A count of one until it is dropped.
struct Counted<'w>(&'w AtomicUsize);

impl<'w> Counted<'w> {
    /// Counts one more, up to `most`.
    fn within(count: &'w AtomicUsize, most: usize) -> Option<Self> {
        let more = |count: usize| (count < most).then_some(count + 1);
        // Only then: one that is made and dropped would count one less.
        count.fetch_update(Relaxed, Relaxed, more).is_ok().then(|| Self(count))
    }
}

impl Drop for Counted<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Relaxed);
    }
}

/// The file of the rows, which is removed with it.
struct RowFile(PathBuf);

impl Drop for RowFile {
    fn drop(&mut self) {
        // It may not have been needed.
        let _ = fs::remove_file(&self.0);
    }
}

impl Worker {
    /// Has a sweep solved, in part by others. `is_new` says that no worker has had it before; `place` is freed when nothing of
    /// it is solved there any more.
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
    /// Divides the sweep until its job has ended or has been left.
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

    /// Takes over the rows and the chunks of those who divided the sweep before.
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
        // First those that are done, as they were made: members that they did not come to may be in later ones.
        parts.sort_unstable_by_key(|(part, _)| (part.attempt, part.number));
        let (done, waiting): (Vec<_>, Vec<_>) = parts.into_iter().partition(|(_, part)| part.done.is_some());
        for (part_id, part) in done {
            let chunk = match part.done {
                Some(Done::Rows { rows, .. }) => Chunk { members: part.first..part.first + rows, lost: part.lost },
                Some(Done::Poisoned) => part.chunk(),
                // Of others, nothing is left.
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
            // Who made it may have died before it was in the queue.
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

    /// Follows the entries of the chunks from now on.
    fn follow(&self, following: &mut JoinSet<()>) -> UnboundedReceiver<(PartId, Part)> {
        let (tell, told) = unbounded_channel();
        let (worker, id) = (Arc::clone(self.worker), self.job.id);
        following.spawn(async move {
            let filter = format!("part.{id}.*");
            let came = |key: &str, text: Option<&[u8]>| {
                if let (Some(part_id), Some(part)) = (PartId::of_key(id, key), text.and_then(Part::read)) {
                    // Its receiver outlives this.
                    let _ = tell.send((part_id, part));
                }
            };
            worker.exchange.follow(&filter, came).await;
        });
        told
    }

    /// Whether more chunks are to wait for workers.
    fn wants_more(&self) -> bool {
        let claimed = self.out.values().filter(|(_, is_claimed)| *is_claimed).count();
        self.out.len() - claimed < WAITING.max(claimed)
    }

    fn next_id(&mut self) -> PartId {
        let id = PartId { sweep: self.job.id, attempt: self.attempt, number: self.number };
        self.number += 1;
        id
    }

    /// Puts the next chunk into the queue; returns whether there was one.
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

    /// Writes the entry of a chunk that has none.
    async fn enter(&mut self, id: PartId, part: &Part) {
        self.has_parts = true;
        // One that is there already was written by an attempt at this whose answer was lost.
        while self.worker.exchange.create(&id.key(), part.text()).await.is_err() {
            sleep(PAUSE).await;
        }
    }

    /// An entry of a chunk has changed.
    async fn came(&mut self, id: PartId, part: Part) {
        let Some((_, is_claimed)) = self.out.get_mut(&id) else { return };
        *is_claimed = part.claim.is_some();
        if let Some(done) = part.done
            && let Some((chunk, _)) = self.out.remove(&id)
        {
            self.count(id, &chunk, done).await;
        }
    }

    /// Counts out what has become of a chunk, and fetches its rows.
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

    /// A sweep that goes on is not what earlier workers were lost by.
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

    /// Takes back the chunks that no worker has claimed; in the end, all: those whose workers do not answer any more.
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
                        // A worker that takes it finds that it is not wanted.
                        let _ = self.worker.exchange.dequeue(id, self.job.client).await;
                    }
                    self.came(id, part).await;
                }
                // The client has deleted the job.
                Ok(None) => {
                    if let Some((chunk, _)) = self.out.remove(&id) {
                        self.chunks.end(&chunk, None, &Solved::Nothing, Duration::ZERO);
                    }
                }
                Err(_) => return,
            }
        }
    }

    /// Looks at the chunks, of which news may have been lost; returns whether the sweep is still this worker's.
    async fn look(&mut self) -> bool {
        let exchange = &self.worker.exchange;
        let claim = &self.entry.0.claim;
        match exchange.entry(self.job.id).await {
            Ok(Some((entry, _))) if entry.record.ended.is_some() || entry.claim != *claim => return false,
            // The client has deleted it, which is told as a wish to stop.
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
    /// Takes a sweep on that another process has admitted, to be divided here.
    fn take_charge(&self, id: JobId, record: &Record, facts: SweepFacts, document: &Arc<[u8]>) -> Arc<Job> {
        let record = Record { key: None, ..record.clone() };
        let job = Arc::new(Job::taken_on(id, record, Some(Chunks::new(facts)), Arc::clone(document)));
        // Without a key, nothing is in its way.
        let _ = self.store.index().insert(&job);
        job
    }
}

/// Waits until a job has settled, if there is one.
async fn settled(job: Option<Arc<Job>>) -> Option<Arc<Ended>> {
    match job {
        Some(job) => job.settled().await,
        None => pending().await,
    }
}

/// The next of what is told, if anything is.
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
