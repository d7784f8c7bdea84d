//! Worker processes for checks of specification documents that take too long to be parsed by the process serving
//! HTTP. They are few, and separate from the workers that solve, so that a check does not wait for a solve to end.

use super::Death;
use super::launcher::Launcher;
use super::link::{Finished, Task, Watch};
use super::message::{Facts, Finding, Limits, Origin};
use super::supervisor::{Notice, Supervisor};
use crate::context::Context;
use problem::Control;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::Notify;
use tracing::Instrument;

/// The outcome of the check of a specification document.
#[derive(Debug)]
pub enum Checked {
    /// The specification is correct: its main properties, and its summary as JSON.
    Correct(Facts, Vec<u8>),
    /// The specification has errors, which are listed.
    Wrong(Vec<Finding>),
    /// The check of the specification exceeded its time limit, or was stopped.
    Interrupted,
    /// The worker process died during the check of the specification.
    Died(Death),
}

/// The idle worker processes that check specifications; each is started when a check first needs it.
pub struct Checkers {
    resting: Mutex<Vec<Supervisor>>,
    launcher: Launcher,
    keep: u64,
    notice: Notice,
}

impl Checkers {
    /// Creates a pool of worker processes for checks, none of which is started yet. A worker that holds more than
    /// `keep` bytes of memory between checks is replaced.
    pub fn new(launcher: Launcher, keep: u64, notice: Notice) -> Arc<Self> {
        Arc::new(Self { resting: Mutex::default(), launcher, keep, notice })
    }

    /// Checks a specification document, concurrently with other checks, whose number the caller limits. Dropping the
    /// future stops the check. `turn`, the caller's permit for a check, is dropped when the worker is free again.
    pub async fn check(self: &Arc<Self>, document: Arc<[u8]>, limits: Limits, turn: impl Send + 'static) -> Checked {
        let waits = Waits(Arc::default());
        let (checkers, asked) = (Arc::clone(self), Arc::clone(&waits.0));
        let mut origin = Origin::of(None, &Context::current());
        let span = origin.span();
        origin.join(&span);
        let checking = async move {
            let mut supervisor = checkers.take();
            let (control, is_unwanted) = (Control::new(), || asked.is_unwanted.load(Relaxed));
            let watch = Watch { origin: &origin, control: &control, halted: &asked.halted, is_unwanted: &is_unwanted };
            let (document, long) = (&*document, &mut io::sink());
            let finished = supervisor
                .perform(&mut Task {
                    solve: false,
                    members: None,
                    document,
                    limits,
                    watch: &watch,
                    long,
                    yields: true,
                    slice: None,
                })
                .await;
            checkers.resting().push(supervisor);
            drop(turn);
            finished
        };
        let finished =
            tokio::spawn(checking.instrument(span)).await.unwrap_or_else(|error| Err(Death::Defect(error.to_string())));
        match finished {
            Ok(Finished::Checked(facts, summary)) => Checked::Correct(facts, summary),
            Ok(Finished::Refused(_, true)) | Err(Death::Overran) => Checked::Interrupted,
            Ok(Finished::Refused(findings, false)) => match serde_json::from_slice(&findings) {
                Ok(findings) => Checked::Wrong(findings),
                Err(error) => Checked::Died(Death::Defect(error.to_string())),
            },
            Ok(Finished::Solved(..) | Finished::TooMuchMemory(_) | Finished::TooLarge) => {
                Checked::Died(Death::Defect("a solve".to_owned()))
            }
            Err(death) => Checked::Died(death),
        }
    }

    fn take(&self) -> Supervisor {
        let rested = self.resting().pop();
        rested.unwrap_or_else(|| Supervisor::new(Arc::clone(&self.launcher), self.keep, Arc::clone(&self.notice)))
    }

    fn resting(&self) -> std::sync::MutexGuard<'_, Vec<Supervisor>> {
        self.resting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A request for the check of a specification document, shared with the task that performs the check.
#[derive(Debug, Default)]
struct CheckRequest {
    halted: Notify,
    is_unwanted: AtomicBool,
}

/// A guard of a request for the check of a specification: dropping the guard stops the check.
struct Waits(Arc<CheckRequest>);

impl Drop for Waits {
    fn drop(&mut self) {
        self.0.is_unwanted.store(true, Relaxed);
        self.0.halted.notify_one();
    }
}
