//! What is known of jobs: the index in memory, and in a durable service the disk behind it.
//!
//! A job that its client waits for is kept by memory alone. It comes to the disk when it is accepted as an asynchronous one,
//! or when it outlives the wait. From then on each of its states is on the disk before anyone is told of it. All changes of
//! one job are handed to the disk under the lock of its life, so that they are made in the order in which they came about.

mod healing;

use super::change::Change;
use super::disk::{Disk, Found};
use super::ended::{Ended, Ending, Held};
use super::index::{Index, Retention};
use super::job::{Halt, Job, JobId, Lifecycle, Persistence, State};
use super::marks::Marks;
use super::shortage::Taken;
use super::spool::Spool;
use super::unsaved::Unsaved;
use super::writer::{Unwritable, WriteSlot, Written};
use super::{Record, Results};
use crate::digest::Digest;
use crate::metrics::Metrics;
use jiff::Timestamp;
use std::collections::HashSet;
use std::ffi::OsStr;
use std::io;
use std::path::Path;
use std::sync::Arc;
use tokio::task::spawn_blocking;

/// Jobs by name.
#[derive(Debug)]
pub struct Store {
    index: Arc<Index>,
    disk: Option<Arc<Disk>>,
    /// Jobs on the disk of which nothing is known, since their rows are not as they were written.
    damaged: HashSet<JobId>,
    /// What the disk has not taken yet.
    unsaved: Arc<Unsaved>,
}

impl Store {
    /// A store over `folder`, which keeps so many bytes of results in memory that the disk does not take; with the jobs of earlier processes that wait for a worker, oldest first; without a folder, an
    /// empty one in memory.
    ///
    /// # Errors
    /// The folder is in use, or those of the disk.
    pub fn open(
        folder: Option<&Path>,
        program: Option<&OsStr>,
        retention: Retention,
        unsaved: usize,
        metrics: &Metrics,
    ) -> io::Result<(Self, Vec<Arc<Job>>)> {
        let index = Arc::new(Index::new(retention));
        let unsaved = Arc::new(Unsaved::new(unsaved));
        let Some(folder) = folder else {
            return Ok((Self { index, disk: None, damaged: HashSet::new(), unsaved }, Vec::new()));
        };
        let (disk, Found { records, unreadable, damaged, orphaned }) = Disk::open(folder, program)?;
        metrics.found(unreadable, damaged.len(), orphaned);
        let (mut waiting, mut past) = (Vec::new(), Vec::new());
        for (id, mut record) in records {
            if let Some(ended) = &mut record.ended
                && ended.damaged
            {
                // They may have been put back.
                ended.damaged = ended.held.as_ref().is_some_and(|held| disk.verify(id, held).is_err());
            }
            let finished = record.ended.as_ref().map(|ended| (ended.finished, ended.bytes()));
            let job = Arc::new(Job::recovered(id, record));
            // Keys were told apart when the jobs were accepted.
            let _ = index.insert(&job);
            match finished {
                Some((finished, bytes)) => past.push((finished, bytes, job)),
                None => waiting.push(job),
            }
        }
        past.sort_by_key(|(finished, ..)| *finished);
        let mut forgotten = Vec::new();
        for (finished, bytes, job) in past {
            forgotten.extend(index.keep(job.id, finished, job.document_bytes + bytes));
        }
        forgotten.extend(index.expire(Timestamp::now()));
        disk.erase(forgotten.iter().map(|job| job.id).collect())?;
        let known = Arc::clone(&index);
        disk.remember(Box::new(move || {
            known.all().iter().filter_map(|job| job.row().map(|row| (job.id, row))).collect()
        }));
        Ok((Self { index, disk: Some(Arc::new(disk)), damaged, unsaved }, waiting))
    }

    /// The index.
    pub fn index(&self) -> &Index {
        &self.index
    }

    /// A place for a job that is to be kept by the disk; nothing without a disk.
    ///
    /// # Errors
    /// The disk takes no change.
    pub async fn place(&self) -> Result<Option<WriteSlot>, Unwritable> {
        match &self.disk {
            Some(_) if !self.is_writable() => Err(Unwritable),
            Some(disk) => disk.place().await.map(Some),
            None => Ok(None),
        }
    }

    /// A place for news of a job that the disk keeps, on a full disk too.
    async fn passage(&self) -> Result<Option<WriteSlot>, Unwritable> {
        let Some(disk) = &self.disk else { return Ok(None) };
        disk.place().await.map(Some)
    }

    /// Hands `job` to the disk.
    pub fn store(&self, job: &Arc<Job>, life: &mut Lifecycle, document: Arc<[u8]>, place: WriteSlot) -> Written {
        life.keeping = Persistence::Storing;
        job.digest.get_or_init(|| Digest::of(&document));
        let change = Change { document: Some(document), ..Change::record(job.id, &Record::of(job, life)) };
        let stored = Arc::clone(job);
        place.send(change, move |written| {
            let mut life = stored.lock();
            if life.keeping == Persistence::Storing {
                life.keeping = if written.is_ok() { Persistence::Disk } else { Persistence::Memory };
            }
        })
    }

    /// Hands a job that memory alone keeps to the disk, unless it has ended; returns when the disk has it.
    ///
    /// # Errors
    /// The disk did not take it.
    pub async fn outlive(&self, job: &Arc<Job>) -> Result<(), Unwritable> {
        if job.lock().keeping == Persistence::Disk {
            return Ok(());
        }
        let Some(place) = self.place().await? else { return Ok(()) };
        let answer = {
            let mut life = job.lock();
            match (&job.document, &life.state, life.keeping) {
                (_, State::Ended(_), _) | (_, _, Persistence::Disk | Persistence::Forgotten) => return Ok(()),
                (Some(document), _, Persistence::Memory) => self.store(job, &mut life, Arc::clone(document), place),
                // Behind the change that stores it.
                (_, _, Persistence::Storing | Persistence::Memory) => place.send(Change::default(), drop),
            }
        };
        answer.written().await
    }

    /// Marks `job`, if the disk keeps it, as the one that a worker is at.
    pub fn mark(&self, worker: usize, job: &Job) {
        if job.is_lasting() {
            self.note("the start of a job", |marks| marks.set(worker, job.id));
        }
    }

    /// Takes the mark of a worker away.
    pub fn unmark(&self, worker: usize, job: &Job) {
        if job.is_lasting() {
            self.note("the end of a job", |marks| marks.clear(worker));
        }
    }

    /// Notes what the system has ended for want of memory, up to now.
    pub fn account(&self, taken: &Taken) {
        self.note("what the system has ended", |marks| marks.account(taken));
    }

    fn note(&self, what: &str, note: impl FnOnce(&Marks) -> io::Result<()>) {
        if let Some(disk) = &self.disk
            && let Err(error) = note(disk.marks())
        {
            tracing::error!(%error, "{what} could not be noted");
        }
    }

    /// Ends a job: keeps its results, forgets others for them, and wakes whoever waits.
    pub async fn conclude(&self, job: &Arc<Job>, ended: Ended) {
        let outcome = match (self.conclude_in_memory(job, ended), &self.disk) {
            (Err(ended), Some(disk)) => {
                let forgotten = self.keep(job, &ended);
                self.conclude_on_disk(disk, job, *ended).await;
                forgotten
            }
            (Err(_), None) => Vec::new(),
            (Ok(forgotten), _) => forgotten,
        };
        self.tidy(outcome).await;
    }

    /// Gives the end back if the disk keeps the job.
    fn conclude_in_memory(&self, job: &Arc<Job>, ended: Ended) -> Result<Vec<Arc<Job>>, Box<Ended>> {
        let mut life = job.lock();
        if life.is_lasting() {
            return Err(Box::new(ended));
        }
        // Kept before anyone is woken: whoever sees the end of a job finds the store within its bounds.
        let forgotten = self.keep(job, &ended);
        life.finish(ended);
        drop(life);
        job.wake();
        Ok(forgotten)
    }

    /// Writes the end of a job, and tells it then; what the disk does not take is told all the same, and kept for later.
    async fn conclude_on_disk(&self, disk: &Disk, job: &Arc<Job>, ended: Ended) {
        let kept = ended.clone();
        let is_long = matches!(&ended.held, Some(Held::Memory(results)) if results.text().is_none());
        // No file without a row: a kill in between would leave one that nobody knows.
        if is_long && job.lock().keeping == Persistence::Storing {
            self.flush().await;
        }
        let is_forgotten = job.lock().keeping == Persistence::Forgotten;
        let put_away = if is_forgotten { Ok((ended, None)) } else { disk.put_away(job.id, ended) };
        let place = disk.place().await;
        let life = job.lock();
        if life.keeping == Persistence::Forgotten {
            drop(life);
            disk.discard(job.id);
            self.unsaved.forget(job, kept.bytes());
            return job.finish(Ended { held: None, ..kept });
        }
        let (Ok((ended, results)), Ok(place)) = (put_away, place) else {
            drop(life);
            tracing::warn!(job.id = %job.id, "the end of job {} cannot be written yet", job.id);
            return self.unsaved.keep(job, kept);
        };
        let record = Record::of(job, &life).ended(&ended);
        let (concluded, unsaved) = (Arc::clone(job), Arc::clone(&self.unsaved));
        place.take(Change { results, ..Change::record(job.id, &record) }, move |written| match written {
            Ok(()) => {
                concluded.conclude(ended);
                unsaved.forget(&concluded, kept.bytes());
            }
            Err(Unwritable) => unsaved.keep(&concluded, kept),
        });
    }

    /// Dismisses a waiting job, asks a running one to stop at its next step, leaves an ended one as it is.
    ///
    /// # Errors
    /// The disk did not take the news, so that a later process may start the job again.
    pub async fn cancel(&self, job: &Arc<Job>) -> Result<(), Unwritable> {
        let place = if job.is_lasting() { self.passage().await } else { Ok(None) };
        let (answer, forgotten) = {
            let mut life = job.lock();
            let mut record = Record::of(job, &life);
            let mut forgotten = Vec::new();
            match &mut life.state {
                State::Accepted(_) => {
                    let ended = Ended::unsolved(Ending::Dismissed);
                    forgotten = self.keep(job, &ended);
                    record = record.ended(&ended);
                    life.finish(ended);
                }
                State::Running { halt, .. } => {
                    *halt = Some(Halt::Dismiss);
                    job.halted.notify_one();
                    record.dismissed = true;
                }
                State::Ended(_) => return Ok(()),
            }
            let tell = |place: WriteSlot| place.send(Change::record(job.id, &record), drop);
            (place.map(|place| place.filter(|_| life.is_lasting()).map(tell)), forgotten)
        };
        job.wake();
        self.tidy(forgotten).await;
        written(answer?).await
    }

    /// Forgets a job.
    ///
    /// # Errors
    /// The disk did not take the news, so that a later process knows the job again.
    pub async fn forget(&self, job: &Arc<Job>) -> Result<(), Unwritable> {
        self.index.forget(job.id);
        written(self.erase(vec![Arc::clone(job)]).await?).await
    }

    /// Forgets the jobs that are too old at this time.
    pub async fn expire(&self, now: Timestamp) {
        self.tidy(self.index.expire(now)).await;
    }

    /// Leaves a job to the next process, if the disk keeps it.
    pub async fn park(&self, job: &Arc<Job>) {
        let Ok(Some(place)) = self.passage().await else { return };
        {
            let mut life = job.lock();
            if !life.is_lasting() || matches!(life.state, State::Ended(_)) {
                return;
            }
            life.parked = true;
            life.state = State::Accepted(None);
            place.take(Change::record(job.id, &Record::of(job, &life)), drop);
        }
        job.wake();
    }

    /// Returns when every change that has come in has been made.
    pub async fn flush(&self) {
        if let Ok(Some(place)) = self.passage().await {
            // What could not be written has been told to those who waited for it.
            let _ = place.send(Change::default(), drop).written().await;
        }
    }

    /// What was posted for a job.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn document(&self, job: &Job) -> io::Result<Arc<[u8]>> {
        match (&job.document, &self.disk) {
            (Some(document), _) => Ok(Arc::clone(document)),
            (None, Some(disk)) => disk.document(job.id, job.digest.get()).map(Arc::from),
            (None, None) => Err(io::ErrorKind::NotFound.into()),
        }
    }

    /// The results of a job. Those in a file are read on a thread that may wait.
    ///
    /// # Errors
    /// Those of the disk.
    pub async fn results(&self, id: JobId, held: &Held) -> io::Result<Arc<Results>> {
        match (held, &self.disk) {
            (Held::Memory(results), _) => Ok(Arc::clone(results)),
            (Held::Table(_), Some(disk)) => disk.results(id, held),
            (Held::File(_) | Held::Columns { .. }, Some(disk)) => {
                let (disk, held) = (Arc::clone(disk), held.clone());
                spawn_blocking(move || disk.results(id, &held)).await.map_err(io::Error::other)?
            }
            (_, None) => Err(io::ErrorKind::NotFound.into()),
        }
    }

    /// Takes the long results of a job as they come.
    pub fn spool(&self, id: JobId) -> Spool {
        Spool::new(self.disk.as_ref().map(|disk| disk.scratch(id)))
    }

    /// Whether that name is of a job whose row is damaged.
    pub fn is_damaged(&self, id: JobId) -> bool {
        self.damaged.contains(&id)
    }

    /// Tells the end of a job from now on as one whose results are damaged. They stay where they are.
    pub async fn set_aside(&self, job: &Job) {
        let Some(disk) = &self.disk else { return };
        let place = disk.place().await;
        let mut life = job.lock();
        let State::Ended(ended) = &life.state else { return };
        let damaged = Ended { damaged: true, ..Ended::clone(ended) };
        if let Some(place) = place.ok().filter(|_| life.is_lasting()) {
            place.take(Change::record(job.id, &Record::of(job, &life).ended(&damaged)), drop);
        }
        life.state = State::Ended(Arc::new(damaged));
    }

    fn keep(&self, job: &Job, ended: &Ended) -> Vec<Arc<Job>> {
        self.index.keep(job.id, ended.finished, job.document_bytes + ended.bytes())
    }

    /// Removes jobs, no longer in the index, from the disk.
    async fn erase(&self, jobs: Vec<Arc<Job>>) -> Result<Option<Written>, Unwritable> {
        let mut stored = Vec::new();
        for job in jobs {
            let mut life = job.lock();
            // From here on nothing about this job goes to the disk but its removal.
            if life.is_lasting() {
                stored.push(job.id);
            }
            life.keeping = Persistence::Forgotten;
        }
        if stored.is_empty() {
            return Ok(None);
        }
        Ok(self.passage().await?.map(|place| place.send(Change::forgotten(stored), drop)))
    }

    /// Removes jobs from the disk, which nobody waits for.
    async fn tidy(&self, jobs: Vec<Arc<Job>>) {
        if let Err(error) = self.erase(jobs).await {
            tracing::error!(%error, "forgotten jobs stay on the disk until the next start");
        }
    }
}

async fn written(answer: Option<Written>) -> Result<(), Unwritable> {
    match answer {
        Some(answer) => answer.written().await,
        None => Ok(()),
    }
}
