//! The store of jobs: the index in memory, and in a durable service the disk behind it.
//!
//! A job that its client waits for is kept in memory only. It is written to the disk if it is admitted
//! asynchronously, or when its solve outlives the wait. From then on each of its states is on the disk before it is
//! reported. All changes of one job are handed to the disk under the lock of its [`Lifecycle`], so that they are made
//! in the order in which they happened.

mod healing;

use super::change::Change;
use super::chunks::Chunks;
use super::disk::{Disk, Found};
use super::ended::{Ended, Ending, Held};
use super::index::{Index, Retention, Size};
use super::job::{Halt, Job, JobId, Lifecycle, Persistence, State};
use super::marks::Marks;
use super::row_log::RowLog;
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
use tokio::sync::mpsc::UnboundedSender;
use tokio::task::spawn_blocking;

/// The fraction `1/RESIDENT` of the size limit of ended jobs is available to those in memory if there is a disk: such
/// jobs have been sent to their clients, and are kept in case a client asks again.
const RESIDENT: usize = 8;

/// The store of all jobs of the service, in memory and on the disk.
#[derive(Debug)]
pub struct Store {
    index: Arc<Index>,
    disk: Option<Arc<Disk>>,
    /// The jobs on the disk whose rows are damaged.
    damaged: HashSet<JobId>,
    /// The ends of jobs that the disk has not accepted yet.
    unsaved: Arc<Unsaved>,
    /// Receives the durable jobs that are deleted, if they are stored on other machines.
    elsewhere: Option<UnboundedSender<Arc<Job>>>,
}

impl Store {
    /// Opens a store over `folder`, and returns it with the waiting jobs of earlier processes, oldest first. Without
    /// a folder, the store is empty and in memory. Ends of jobs that the disk refuses are kept in memory, up to
    /// `unsaved` bytes of results.
    ///
    /// # Errors
    /// The folder is in use, or the disk reports an I/O error.
    pub fn open(
        folder: Option<&Path>,
        program: Option<&OsStr>,
        retention: Retention,
        unsaved: usize,
        metrics: &Metrics,
    ) -> io::Result<(Self, Vec<Arc<Job>>)> {
        let most_resident = if folder.is_some() { retention.bytes / RESIDENT } else { retention.bytes };
        let index = Arc::new(Index::new(retention, most_resident));
        let unsaved = Arc::new(Unsaved::new(unsaved));
        let Some(folder) = folder else {
            return Ok((Self { index, disk: None, damaged: HashSet::new(), unsaved, elsewhere: None }, Vec::new()));
        };
        let (disk, Found { records, unreadable, damaged, orphaned }) = Disk::open(folder, program, metrics)?;
        metrics.found(unreadable, damaged.len(), orphaned);
        let (mut waiting, mut past) = (Vec::new(), Vec::new());
        for (id, mut record) in records {
            if let Some(ended) = &mut record.ended
                && ended.damaged
            {
                // Results that were found damaged earlier are verified again, since the data folder may have been
                // restored from a backup.
                ended.damaged = ended.held.as_ref().is_some_and(|held| disk.verify(id, held).is_err());
            }
            let finished = record.ended.as_ref().map(|ended| (ended.finished, ended.bytes()));
            let chunks = match record.sweep() {
                Some(facts) if record.ended.is_none() => {
                    let log = RowLog::open(&disk.rows(id)).unwrap_or_else(|error| {
                        tracing::error!(job.id = %id, %error, "the rows of job {id} cannot be read and are made again");
                        RowLog::default()
                    });
                    Some(Chunks::restored(facts, log, record.dismissed))
                }
                Some(_) => {
                    // The last process of the service ended before it had removed the rows of this sweep, which has
                    // ended.
                    disk.remove_rows(id);
                    None
                }
                None => None,
            };
            let job = Arc::new(Job::recovered(id, record, chunks));
            // Insertion into the index succeeds: idempotency keys were checked to be distinct when the jobs were
            // admitted.
            let _ = index.insert(&job);
            match finished {
                Some((finished, bytes)) => past.push((finished, bytes, job)),
                None => waiting.push(job),
            }
        }
        past.sort_by_key(|(finished, ..)| *finished);
        let mut forgotten = Vec::new();
        for (finished, bytes, job) in past {
            forgotten.extend(index.keep(job.id, finished, Size { bytes: job.document_bytes + bytes, resident: 0 }));
        }
        forgotten.extend(index.expire(Timestamp::now()));
        disk.erase(forgotten.iter().map(|job| job.id).collect())?;
        let known = Arc::clone(&index);
        disk.remember(Box::new(move || {
            known.all().iter().filter_map(|job| job.row().map(|row| (job.id, row))).collect()
        }));
        Ok((Self { index, disk: Some(Arc::new(disk)), damaged, unsaved, elsewhere: None }, waiting))
    }

    /// Makes the store send durable jobs that are deleted to `elsewhere`, for removal from other machines.
    pub fn elsewhere(self, elsewhere: UnboundedSender<Arc<Job>>) -> Self {
        Self { elsewhere: Some(elsewhere), ..self }
    }

    /// Reports that a job is deleted to the task that removes it from other machines, if there is such a task.
    pub fn let_go(&self, job: &Arc<Job>) {
        if let Some(elsewhere) = &self.elsewhere {
            // Sending fails only if the task that receives deleted jobs has ended, at the end of the process.
            let _ = elsewhere.send(Arc::clone(job));
        }
    }

    /// The index of the jobs in memory.
    pub fn index(&self) -> &Index {
        &self.index
    }

    /// Waits for a slot for the insertion of a job on the disk; `None` without a disk.
    ///
    /// # Errors
    /// The disk refuses changes.
    pub async fn place(&self) -> Result<Option<WriteSlot>, Unwritable> {
        match &self.disk {
            Some(_) if !self.is_writable() => Err(Unwritable),
            Some(disk) => disk.place().await.map(Some),
            None => Ok(None),
        }
    }

    /// Waits for a slot in the queue of changes to the database, for an update of a stored job, which is possible on a
    /// full disk too; `None` without a disk.
    async fn passage(&self) -> Result<Option<WriteSlot>, Unwritable> {
        let Some(disk) = &self.disk else { return Ok(None) };
        disk.place().await.map(Some)
    }

    /// Sends the insertion of `job` to the database on the disk, through the slot `place` of its queue of changes.
    pub fn store(&self, job: &Arc<Job>, lifecycle: &mut Lifecycle, document: Arc<[u8]>, place: WriteSlot) -> Written {
        lifecycle.persistence = Persistence::Storing;
        job.digest.get_or_init(|| Digest::of(&document));
        let change = Change { document: Some(document), ..Change::record(job.id, &Record::of(job, lifecycle)) };
        let stored = Arc::clone(job);
        place.send(change, move |written| {
            let mut lifecycle = stored.lock();
            if lifecycle.persistence == Persistence::Storing {
                lifecycle.persistence = if written.is_ok() { Persistence::Disk } else { Persistence::Memory };
            }
        })
    }

    /// Writes an unfinished job that is only in memory to the disk, including its rows if it is a sweep, and waits
    /// until the write is done.
    ///
    /// # Errors
    /// The disk did not accept the job.
    pub async fn outlive(&self, job: &Arc<Job>) -> Result<(), Unwritable> {
        self.write_job(job).await?;
        self.save_rows(job).await;
        Ok(())
    }

    async fn write_job(&self, job: &Arc<Job>) -> Result<(), Unwritable> {
        if job.lock().persistence == Persistence::Disk {
            return Ok(());
        }
        let Some(place) = self.place().await? else { return Ok(()) };
        let answer = {
            let mut lifecycle = job.lock();
            match (&job.document, &lifecycle.state, lifecycle.persistence) {
                (_, State::Ended(_), _) | (_, _, Persistence::Disk | Persistence::Forgotten) => return Ok(()),
                (Some(document), _, Persistence::Memory) => {
                    self.store(job, &mut lifecycle, Arc::clone(document), place)
                }
                // An empty change is made after the pending change that stores the job, so that the outcome of that
                // change can be awaited.
                (_, _, Persistence::Storing | Persistence::Memory) => place.send(Change::default(), drop),
            }
        };
        answer.written().await
    }

    /// Marks `job`, if it is durable, on the disk as the running job of a worker.
    pub fn mark(&self, worker: usize, job: &Job) {
        if job.is_durable() {
            self.note("the start of a job", |marks| marks.set(worker, job.id));
        }
    }

    /// Clears the mark of a worker's running job on the disk, if `job` is durable.
    pub fn unmark(&self, worker: usize, job: &Job) {
        if job.is_durable() {
            self.note("the end of a job", |marks| marks.clear(worker));
        }
    }

    /// Records on the disk the number of kills for lack of memory that this process has attributed.
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

    /// Ends a job: stores its results, deletes the oldest ended jobs to make room, and wakes all tasks that wait for
    /// the end.
    pub async fn conclude(&self, job: &Arc<Job>, ended: Ended) {
        let outcome = match (self.conclude_in_memory(job, ended), &self.disk) {
            (Err(ended), Some(disk)) => {
                let forgotten = self.keep(job, &ended, 0);
                self.conclude_on_disk(disk, job, *ended).await;
                forgotten
            }
            (Err(_), None) => Vec::new(),
            (Ok(forgotten), _) => forgotten,
        };
        self.tidy(outcome).await;
    }

    /// Ends a job that is only in memory; returns the end as an error if the job is durable.
    fn conclude_in_memory(&self, job: &Arc<Job>, ended: Ended) -> Result<Vec<Arc<Job>>, Box<Ended>> {
        let mut lifecycle = job.lock();
        if lifecycle.is_durable() {
            return Err(Box::new(ended));
        }
        // The end of the job is counted before anyone is woken, so that the store is within its limits when the end is
        // seen.
        let forgotten = self.keep(job, &ended, job.document_bytes + ended.resident());
        lifecycle.finish(ended);
        drop(lifecycle);
        job.wake();
        Ok(forgotten)
    }

    /// Writes the end of a job to the disk, and reports it afterwards; an end that the disk refuses is reported too,
    /// and kept in memory to be written later.
    async fn conclude_on_disk(&self, disk: &Disk, job: &Arc<Job>, ended: Ended) {
        let kept = ended.clone();
        let is_long = matches!(&ended.held, Some(Held::Memory(results)) if results.text().is_none());
        // The row of the job is stored before the file of its results: a kill in between would leave a file without a
        // row.
        if is_long && job.lock().persistence == Persistence::Storing {
            self.flush().await;
        }
        let is_forgotten = job.lock().persistence == Persistence::Forgotten;
        let put_away = if is_forgotten { Ok((ended, None)) } else { disk.put_away(job.id, ended) };
        let place = disk.place().await;
        let mut lifecycle = job.lock();
        if lifecycle.persistence == Persistence::Forgotten {
            drop(lifecycle);
            disk.discard(job.id);
            self.unsaved.forget(job, kept.bytes());
            return job.finish(Ended { held: None, ..kept });
        }
        let (Ok((ended, results)), Ok(place)) = (put_away, place) else {
            drop(lifecycle);
            tracing::warn!(job.id = %job.id, "the end of job {} cannot be written yet", job.id);
            return self.unsaved.keep(job, kept);
        };
        let record = Record::of(job, &lifecycle).ended(&ended);
        lifecycle.is_ending = true;
        let (concluded, unsaved) = (Arc::clone(job), Arc::clone(&self.unsaved));
        place.take(Change { results, ..Change::record(job.id, &record) }, move |written| match written {
            Ok(()) => {
                concluded.conclude(ended);
                unsaved.forget(&concluded, kept.bytes());
            }
            Err(Unwritable) => unsaved.keep(&concluded, kept),
        });
    }

    /// Dismisses a waiting job, asks a running job to stop at its next step, and leaves an ended job unchanged. A
    /// waiting sweep with rows is only marked as dismissed, and is to be ended with its rows.
    ///
    /// # Errors
    /// The disk did not accept the change, so that a later process may start the job again.
    pub async fn cancel(&self, job: &Arc<Job>) -> Result<(), Unwritable> {
        if job.lock().is_ending {
            // The result of the job is being written to the disk: wait for it. If the disk refuses the result, the job
            // is queued again, and can then be dismissed.
            self.flush().await;
        }
        let place = if job.is_durable() { self.passage().await } else { Ok(None) };
        let (answer, forgotten) = {
            let mut lifecycle = job.lock();
            let mut record = Record::of(job, &lifecycle);
            let mut forgotten = Vec::new();
            if lifecycle.is_ending {
                return Ok(());
            }
            match &mut lifecycle.state {
                State::Accepted(_) if job.chunks.as_ref().is_some_and(|chunks| chunks.dismiss()) => {
                    record.dismissed = true
                }
                State::Accepted(_) => {
                    let ended = Ended::unsolved(Ending::Dismissed);
                    forgotten = self.keep(job, &ended, 0);
                    record = record.ended(&ended);
                    lifecycle.finish(ended);
                }
                State::Running { halt, .. } => {
                    *halt = Some(Halt::Dismiss);
                    job.halted.notify_one();
                    record.dismissed = true;
                }
                State::Ended(_) => return Ok(()),
            }
            let tell = |place: WriteSlot| place.send(Change::record(job.id, &record), drop);
            (place.map(|place| place.filter(|_| lifecycle.is_durable()).map(tell)), forgotten)
        };
        job.wake();
        self.tidy(forgotten).await;
        written(answer?).await
    }

    /// Deletes a job from the index and the disk.
    ///
    /// # Errors
    /// The disk did not accept the change, so that a later process will list the job again.
    pub async fn forget(&self, job: &Arc<Job>) -> Result<(), Unwritable> {
        self.index.forget(job.id);
        written(self.erase(vec![Arc::clone(job)]).await?).await
    }

    /// Deletes the jobs whose retention time has passed at `now`.
    pub async fn expire(&self, now: Timestamp) {
        self.tidy(self.index.expire(now)).await;
    }

    /// Leaves a stopped job to the next process, if it is durable, or to the machine that shares it.
    pub async fn park(&self, job: &Arc<Job>) {
        let Ok(place) = self.passage().await else { return };
        {
            let mut lifecycle = job.lock();
            let is_over = lifecycle.is_ending || matches!(lifecycle.state, State::Ended(_));
            if lifecycle.is_durable() != place.is_some() || is_over {
                return;
            }
            lifecycle.parked = true;
            lifecycle.state = State::Accepted(None);
            if let Some(place) = place {
                place.take(Change::record(job.id, &Record::of(job, &lifecycle)), drop);
            }
        }
        job.wake();
    }

    /// Waits until all changes that have been sent to the database so far are on the disk.
    pub async fn flush(&self) {
        if let Ok(Some(place)) = self.passage().await {
            // A failure is ignored here, since it has been reported to the sender of the failed change.
            let _ = place.send(Change::default(), drop).written().await;
        }
    }

    /// Returns the posted specification of a job.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn document(&self, job: &Job) -> io::Result<Arc<[u8]>> {
        match (&job.document, &self.disk) {
            (Some(document), _) => Ok(Arc::clone(document)),
            (None, Some(disk)) => disk.document(job.id, job.digest.get()).map(Arc::from),
            (None, None) => Err(io::ErrorKind::NotFound.into()),
        }
    }

    /// Returns the results of a job. Files are opened on a thread for blocking calls.
    ///
    /// # Errors
    /// I/O errors of the disk.
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

    /// Creates a spool (memory, then a scratch file) for the long results of a job.
    pub fn spool(&self, id: JobId) -> Spool {
        Spool::new(self.disk.as_ref().map(|disk| disk.scratch(id)))
    }

    /// Writes the rows of a sweep that are only in memory to the disk, if its job is on the disk.
    pub async fn save_rows(&self, job: &Job) {
        let (Some(disk), Some(chunks)) = (&self.disk, &job.chunks) else { return };
        // The row of the job is stored before the file of the sweep's rows: a kill in between would leave a file
        // without a row.
        if job.lock().persistence == Persistence::Storing {
            self.flush().await;
        }
        if job.lock().persistence == Persistence::Disk {
            chunks.save(Some(&disk.rows(job.id)));
        }
    }

    /// Removes the stored rows of a sweep that has ended.
    pub fn remove_rows(&self, id: JobId) {
        if let Some(disk) = &self.disk {
            disk.remove_rows(id);
        }
    }

    /// Writes the database row of an unfinished job again, with its current state.
    pub async fn note_progress(&self, job: &Job) {
        let Ok(Some(place)) = self.passage().await else { return };
        let lifecycle = job.lock();
        if lifecycle.is_durable() && !lifecycle.is_ending && !matches!(lifecycle.state, State::Ended(_)) {
            place.take(Change::record(job.id, &Record::of(job, &lifecycle)), drop);
        }
    }

    /// Whether the database row of the job `id` is damaged.
    pub fn is_damaged(&self, id: JobId) -> bool {
        self.damaged.contains(&id)
    }

    /// Records that the results of an ended job are damaged, so that they are not served again. The data stay on the
    /// disk.
    pub async fn set_aside(&self, job: &Job) {
        let Some(disk) = &self.disk else { return };
        let place = disk.place().await;
        let mut lifecycle = job.lock();
        let State::Ended(ended) = &lifecycle.state else { return };
        let damaged = Ended { damaged: true, ..Ended::clone(ended) };
        if let Some(place) = place.ok().filter(|_| lifecycle.is_durable()) {
            place.take(Change::record(job.id, &Record::of(job, &lifecycle).ended(&damaged)), drop);
        }
        lifecycle.state = State::Ended(Arc::new(damaged));
    }

    /// Counts a job as ended, with `resident` bytes in memory; returns the ended jobs that were deleted to make room.
    pub fn keep(&self, job: &Job, ended: &Ended, resident: usize) -> Vec<Arc<Job>> {
        self.index.keep(job.id, ended.finished, Size { bytes: job.document_bytes + ended.bytes(), resident })
    }

    /// Removes jobs, which must not be in the index of jobs any more, from the disk.
    async fn erase(&self, jobs: Vec<Arc<Job>>) -> Result<Option<Written>, Unwritable> {
        let mut stored = Vec::new();
        for job in jobs {
            let mut lifecycle = job.lock();
            // Under this lock, the job becomes one that is not durable: its removal is the last change of the job
            // that is sent to the disk.
            if lifecycle.is_durable() {
                stored.push(job.id);
                self.let_go(&job);
            }
            lifecycle.persistence = Persistence::Forgotten;
        }
        if stored.is_empty() {
            return Ok(None);
        }
        Ok(self.passage().await?.map(|place| place.send(Change::forgotten(stored), drop)))
    }

    /// Removes jobs that were deleted from the disk, without waiting for the write.
    pub async fn tidy(&self, jobs: Vec<Arc<Job>>) {
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
