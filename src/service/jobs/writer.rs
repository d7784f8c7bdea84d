//! Group commit: one thread takes all pending changes of the database, makes them in one transaction, and then
//! reports the outcome to all who wait (Gray & Reuter 1993, "Transaction processing", section 9.4). While it syncs,
//! the next group gathers.
//!
//! If a group cannot be written, for instance on a full disk, the reserve is freed for those of its changes that
//! delete or end jobs, and the others are refused. Each later group is tried again, and the failure is over when the
//! reserve has been restored and a group has been written. While the database file is missing from its path, nothing
//! is written, since it would be lost.

use super::change::Change;
use super::database::Database;
use super::files::Files;
use super::reserve::Reserve;
use prometheus_client::metrics::histogram::Histogram;
use std::io;
use std::mem::take;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread;
use std::time::Instant;
use thiserror::Error;
use tokio::sync::mpsc::{OwnedPermit, Receiver, Sender, channel};
use tokio::sync::oneshot;

/// The largest number of changes to the database that may wait, and that are made in one transaction. Short results are
/// at most 64 KiB each, which bounds the size of the waiting changes as well.
const WAITING: usize = 1024;

/// The error that the job store refused a change, for instance on a full disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("the store cannot be written")]
pub struct Unwritable;

/// A callback with the outcome of a change to the database.
pub type Then = Box<dyn FnOnce(Result<(), Unwritable>) + Send>;

/// A slot for one change in the queue of changes to the database.
pub struct WriteSlot(OwnedPermit<(Change, Then)>);

impl WriteSlot {
    /// Sends a change to the thread that writes the database, without waiting for it. Changes are made in the order in
    /// which they are sent.
    pub fn take(self, change: Change, then: impl FnOnce(Result<(), Unwritable>) + Send + 'static) {
        self.0.send((change, Box::new(then)));
    }

    /// Sends a change to the thread that writes the database, and returns a handle on its outcome, available after
    /// `then` has run.
    pub fn send(self, change: Change, then: impl FnOnce(Result<(), Unwritable>) + Send + 'static) -> Written {
        let (answer, answered) = oneshot::channel();
        self.take(change, move |written| {
            then(written);
            // Sending the outcome fails if its receiver has been dropped, which is harmless.
            let _ = answer.send(written);
        });
        Written(answered)
    }
}

/// The pending outcome of a change to the database.
pub struct Written(oneshot::Receiver<Result<(), Unwritable>>);

impl Written {
    /// Waits until the change has been made.
    ///
    /// # Errors
    /// The change could not be made.
    pub async fn written(self) -> Result<(), Unwritable> {
        self.0.await.unwrap_or(Err(Unwritable))
    }
}

/// A handle of the thread that writes the database. When it is dropped, the thread makes all pending changes and
/// ends.
#[derive(Debug)]
pub struct Writer {
    changes: Sender<(Change, Then)>,
    failed: Arc<AtomicBool>,
    database: Arc<Database>,
}

impl Writer {
    /// Starts the writer thread, which adds the duration of each of its writes to `seconds`.
    ///
    /// # Errors
    /// The system provides no thread.
    pub fn start(database: Arc<Database>, files: Arc<Files>, reserve: Reserve, seconds: Histogram) -> io::Result<Self> {
        let (sender, changes) = channel(WAITING);
        let failed = Arc::new(AtomicBool::new(reserve.hold().is_err()));
        let (told, freed) = (Arc::clone(&failed), false);
        let mut scribe =
            Scribe { database: Arc::clone(&database), files, reserve, seconds, failed: told, freed, wanted: 0 };
        thread::Builder::new().name("dvi-store".to_owned()).spawn(move || scribe.write(changes))?;
        Ok(Self { changes: sender, failed, database })
    }

    /// Waits for a slot in the queue of changes.
    ///
    /// # Errors
    /// The writer thread has ended.
    pub async fn place(&self) -> Result<WriteSlot, Unwritable> {
        self.changes.clone().reserve_owned().await.map(WriteSlot).map_err(|_| Unwritable)
    }

    /// Whether the latest change to the database failed, or the next one is bound to fail.
    pub fn has_failed(&self) -> bool {
        self.failed.load(Relaxed) || self.changes.is_closed() || !self.database.is_in_place()
    }
}

/// The state of the thread that writes the database.
struct Scribe {
    database: Arc<Database>,
    files: Arc<Files>,
    reserve: Reserve,
    seconds: Histogram,
    failed: Arc<AtomicBool>,
    /// Whether jobs have been deleted since the reserved disk space was freed.
    freed: bool,
    /// The number of bytes that the latest refused group of changes was to add to the database.
    wanted: usize,
}

impl Scribe {
    fn write(&mut self, mut changes: Receiver<(Change, Then)>) {
        let mut group = Vec::with_capacity(WAITING + 1);
        let mut discarded = Vec::new();
        while changes.blocking_recv_many(&mut group, WAITING) > 0 {
            let told = Change { discarded: take(&mut discarded), ..Change::default() };
            group.push((told, Box::new(drop)));
            let (changes, then): (Vec<_>, Vec<_>) = group.drain(..).unzip();
            let written = self.make(&changes);
            for (change, written) in changes.iter().zip(&written) {
                if written.is_ok() {
                    change.forgotten.iter().for_each(|id| self.files.discard(*id));
                    discarded.extend_from_slice(&change.forgotten);
                }
            }
            for (then, written) in then.into_iter().zip(written) {
                then(written);
            }
        }
    }

    /// Makes all of the changes to the database, or if that fails those that need hardly any disk space; returns the
    /// outcome of each.
    fn make(&mut self, changes: &[Change]) -> Vec<Result<(), Unwritable>> {
        if !self.database.is_in_place() {
            if !self.failed.swap(true, Relaxed) {
                tracing::error!("jobs.redb was removed or replaced; nothing is accepted for later until it is back");
            }
            return vec![Err(Unwritable); changes.len()];
        }
        let had_failed = self.failed.load(Relaxed);
        if !had_failed || self.hold() {
            match self.apply(changes) {
                Ok(()) => {
                    if self.failed.swap(false, Relaxed) {
                        tracing::info!("the store can be written again");
                    }
                    return vec![Ok(()); changes.len()];
                }
                Err(error) => {
                    self.failed.store(true, Relaxed);
                    self.wanted = changes.iter().map(Change::bytes).sum();
                    tracing::error!(%error, changes = changes.len(), "the store cannot be written");
                }
            }
        }
        let small: Vec<_> = changes.iter().filter(|change| change.is_small()).collect();
        let written = !small.is_empty() && {
            self.reserve.release();
            let written = self.apply(small.iter().copied());
            if let Err(error) = &written {
                tracing::error!(%error, "nor can jobs be deleted");
            }
            written.is_ok()
        };
        self.freed |= written && small.iter().any(|change| !change.forgotten.is_empty());
        let made = |change: &Change| if written && change.is_small() { Ok(()) } else { Err(Unwritable) };
        changes.iter().map(made).collect()
    }

    /// Makes the changes to the database in one transaction, and adds its duration to the metrics.
    fn apply<'a>(&self, changes: impl IntoIterator<Item = &'a Change> + Clone) -> io::Result<()> {
        let begun = Instant::now();
        let written = self.database.apply(changes);
        self.seconds.observe(begun.elapsed().as_secs_f64());
        written
    }

    /// Restores the reserved disk space, for which the database may have to be compacted; returns whether there is
    /// space for the reserve and for the changes refused last.
    fn hold(&mut self) -> bool {
        if self.is_room() {
            return true;
        }
        if !std::mem::take(&mut self.freed) {
            return false;
        }
        if let Err(error) = self.database.shrink() {
            tracing::error!(%error, "the database cannot be made smaller");
        }
        self.is_room()
    }

    fn is_room(&self) -> bool {
        self.reserve.hold().is_ok() && self.reserve.is_beside(self.wanted)
    }
}
