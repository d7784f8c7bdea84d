//! Group commit: one thread takes all changes that have come in, makes them in one transaction, and then tells everyone
//! who waits (Gray & Reuter 1993, "Transaction processing", section 9.4). While it syncs, the next group gathers.

use super::database::{Change, Database};
use super::files::Files;
use std::io;
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
pub struct Place(OwnedPermit<(Change, Then)>);

impl Place {
    /// Hands over the change that the place is for. Changes are made in the order in which they are handed over.
    pub fn take(self, change: Change, then: impl FnOnce(Result<(), Unwritable>) + Send + 'static) {
        self.0.send((change, Box::new(then)));
    }

    /// Hands over the change that the place is for; what became of it comes out, after `then`.
    pub fn send(self, change: Change, then: impl FnOnce(Result<(), Unwritable>) + Send + 'static) -> Answer {
        let (answer, answered) = oneshot::channel();
        self.take(change, move |written| {
            then(written);
            // Whoever asked may be gone.
            let _ = answer.send(written);
        });
        Answer(answered)
    }
}

/// What becomes of a change.
pub struct Answer(oneshot::Receiver<Result<(), Unwritable>>);

impl Answer {
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
}

impl Writer {
    /// Starts the thread.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn start(database: Arc<Database>, files: Arc<Files>) -> io::Result<Self> {
        let (sender, changes) = channel(WAITING);
        let failed = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&failed);
        thread::Builder::new().name("dvi-store".to_owned()).spawn(move || write(&database, &files, changes, &told))?;
        Ok(Self { changes: sender, failed })
    }

    /// A place for a change, as soon as there is one.
    ///
    /// # Errors
    /// The thread is gone.
    pub async fn place(&self) -> Result<Place, Unwritable> {
        self.changes.clone().reserve_owned().await.map(Place).map_err(|_| Unwritable)
    }

    /// Whether the latest change could not be made.
    pub fn has_failed(&self) -> bool {
        self.failed.load(Relaxed) || self.changes.is_closed()
    }
}

fn write(database: &Database, files: &Files, mut changes: Receiver<(Change, Then)>, failed: &AtomicBool) {
    let mut group = Vec::with_capacity(WAITING);
    while changes.blocking_recv_many(&mut group, WAITING) > 0 {
        let (changes, then): (Vec<_>, Vec<_>) = group.drain(..).unzip();
        let written = database.apply(&changes).map_err(|error| {
            tracing::error!(%error, changes = changes.len(), "the store cannot be written");
            Unwritable
        });
        failed.store(written.is_err(), Relaxed);
        if written.is_ok() {
            for id in changes.iter().flat_map(|change| &change.forgotten) {
                if let Err(error) = files.remove(*id) {
                    tracing::warn!(job.id = %id, %error, "a file of results is left behind until the next start");
                }
            }
        }
        for then in then {
            then(written);
        }
    }
}
