//! Group commit: one thread takes all changes that have come in, makes them in one transaction, and then tells everyone
//! who waits (Gray & Reuter 1993, "Transaction processing", section 9.4). While it syncs, the next group gathers.
//!
//! Where a group cannot be written, as on a full disk, the room held back is given up for those of its changes that delete
//! jobs or end them, and the others are refused. From then on each group tries again, and all is well when one has been
//! written and the room is held back anew. While the file of the database is not where it was, nothing is written: it would
//! be lost.

use super::change::Change;
use super::database::Database;
use super::files::Files;
use super::reserve::Reserve;
use std::io;
use std::mem::take;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread;
use thiserror::Error;
use tokio::sync::mpsc::{OwnedPermit, Receiver, Sender, channel};
use tokio::sync::oneshot;

/// Changes that may wait, and the most that one transaction makes. A small result is at most 64 KiB, so that what
/// waits is bounded too.
const WAITING: usize = 1024;

/// The store took no change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("the store cannot be written")]
pub struct Unwritable;

/// What is to be done when a change has been made, or not.
pub type Then = Box<dyn FnOnce(Result<(), Unwritable>) + Send>;

/// The place of one change among those that wait.
pub struct WriteSlot(OwnedPermit<(Change, Then)>);

impl WriteSlot {
    /// Hands over the change that the place is for. Changes are made in the order in which they are handed over.
    pub fn take(self, change: Change, then: impl FnOnce(Result<(), Unwritable>) + Send + 'static) {
        self.0.send((change, Box::new(then)));
    }

    /// Hands over the change that the place is for; what became of it comes out, after `then`.
    pub fn send(self, change: Change, then: impl FnOnce(Result<(), Unwritable>) + Send + 'static) -> Written {
        let (answer, answered) = oneshot::channel();
        self.take(change, move |written| {
            then(written);
            // Whoever asked may be gone.
            let _ = answer.send(written);
        });
        Written(answered)
    }
}

/// What becomes of a change.
pub struct Written(oneshot::Receiver<Result<(), Unwritable>>);

impl Written {
    /// Returns when the change has been made.
    ///
    /// # Errors
    /// It has not.
    pub async fn written(self) -> Result<(), Unwritable> {
        self.0.await.unwrap_or(Err(Unwritable))
    }
}

/// The way to the thread that writes. The thread leaves when it is dropped, having made every change.
#[derive(Debug)]
pub struct Writer {
    changes: Sender<(Change, Then)>,
    failed: Arc<AtomicBool>,
    database: Arc<Database>,
}

impl Writer {
    /// Starts the thread.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn start(database: Arc<Database>, files: Arc<Files>, reserve: Reserve) -> io::Result<Self> {
        let (sender, changes) = channel(WAITING);
        let failed = Arc::new(AtomicBool::new(reserve.hold().is_err()));
        let (told, freed) = (Arc::clone(&failed), false);
        let mut scribe = Scribe { database: Arc::clone(&database), files, reserve, failed: told, freed, wanted: 0 };
        thread::Builder::new().name("dvi-store".to_owned()).spawn(move || scribe.write(changes))?;
        Ok(Self { changes: sender, failed, database })
    }

    /// A place for a change, as soon as there is one.
    ///
    /// # Errors
    /// The thread is gone.
    pub async fn place(&self) -> Result<WriteSlot, Unwritable> {
        self.changes.clone().reserve_owned().await.map(WriteSlot).map_err(|_| Unwritable)
    }

    /// Whether the latest change could not be made, or the next one cannot be.
    pub fn has_failed(&self) -> bool {
        self.failed.load(Relaxed) || self.changes.is_closed() || !self.database.is_in_place()
    }
}

/// Who writes.
struct Scribe {
    database: Arc<Database>,
    files: Arc<Files>,
    reserve: Reserve,
    failed: Arc<AtomicBool>,
    /// Jobs have been deleted since the room held back was given up.
    freed: bool,
    /// The bytes that the latest group was to add which could not be written.
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

    /// Makes all of the changes, or those that need hardly any room; says which.
    fn make(&mut self, changes: &[Change]) -> Vec<Result<(), Unwritable>> {
        if !self.database.is_in_place() {
            if !self.failed.swap(true, Relaxed) {
                tracing::error!("jobs.redb was removed or replaced; nothing is accepted for later until it is back");
            }
            return vec![Err(Unwritable); changes.len()];
        }
        let had_failed = self.failed.load(Relaxed);
        if !had_failed || self.hold() {
            match self.database.apply(changes) {
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
            let written = self.database.apply(small.iter().copied());
            if let Err(error) = &written {
                tracing::error!(%error, "nor can jobs be deleted");
            }
            written.is_ok()
        };
        self.freed |= written && small.iter().any(|change| !change.forgotten.is_empty());
        let made = |change: &Change| if written && change.is_small() { Ok(()) } else { Err(Unwritable) };
        changes.iter().map(made).collect()
    }

    /// Holds room back again, for which the database may have to give some up; says whether there is enough, also for what
    /// could not be written.
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
