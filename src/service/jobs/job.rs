//! One job and the states it passes through:
//!
//! ```text
//! accepted -> running -> successful | failed | dismissed
//! accepted ------------------------------> dismissed
//! ```
//!
//! The words are those of OGC API - Processes, part 1, `statusCode`. *Successful* says that the end time was reached.
//! A solve that a limit stopped did not do what it was asked, so its job is *failed*, as is one whose numerics
//! failed; one stopped by its client is *dismissed*. All three keep the trajectory so far.

use super::queue::Client;
use super::results::{Fault, Results};
use crate::problem::Control;
use crate::solution::Status;
use crate::specification::{Specification, Time};
use jiff::Timestamp;
use std::fmt;
use std::str::FromStr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::Notify;
use uuid::Uuid;

/// The name of a job, sorting by time of birth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct JobId(Uuid);

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.as_hyphenated().fmt(f)
    }
}

impl FromStr for JobId {
    type Err = uuid::Error;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Uuid::try_parse(text).map(Self)
    }
}

/// A point in time: on the calendar for people, on the clock for durations.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// On the calendar.
    pub date: Timestamp,
    /// On the monotonic clock.
    pub clock: Instant,
}

impl Moment {
    fn now() -> Self {
        Self { date: Timestamp::now(), clock: Instant::now() }
    }
}

/// How a job ended.
#[derive(Clone, Debug)]
pub enum Ending {
    /// The end time was reached.
    Successful(Arc<Results>),
    /// The numerics failed or a limit stopped them; the trajectory so far is kept.
    Failed(Arc<Results>),
    /// There is no solution to show.
    Broken(Fault),
    /// Its client stopped it, after some steps or before the first.
    Dismissed(Option<Arc<Results>>),
}

impl Ending {
    /// The ending of a solve that returned, `cancelled` or not on the way.
    pub fn of(results: Results, cancelled: bool) -> Self {
        let results = Arc::new(results);
        match results.solution.status {
            Status::Completed => Self::Successful(results),
            Status::Stopped if cancelled => Self::Dismissed(Some(results)),
            Status::Stopped | Status::Failed => Self::Failed(results),
        }
    }

    /// The bytes that keeping it takes.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Successful(results) | Self::Failed(results) | Self::Dismissed(Some(results)) => results.bytes(),
            Self::Broken(_) | Self::Dismissed(None) => 0,
        }
    }
}

/// Where a job stands.
#[derive(Clone, Debug)]
pub enum State {
    /// It waits for a worker.
    Accepted(Arc<Specification>),
    /// A worker is at it.
    Running {
        /// Since when.
        started: Moment,
        /// How to follow it and to stop it.
        control: Arc<Control>,
    },
    /// It will not change any more.
    Ended {
        /// When a worker took it, if one did.
        started: Option<Moment>,
        /// When it ended.
        finished: Moment,
        /// How far it came.
        control: Option<Arc<Control>>,
        /// How it ended.
        ending: Ending,
    },
}

/// A specification on its way to a solution.
#[derive(Debug)]
pub struct Job {
    /// Its name.
    pub id: JobId,
    /// Whose it is.
    pub client: Client,
    /// The client's own words for it.
    pub label: Option<String>,
    /// The time horizon of its problem.
    pub horizon: Time,
    /// When it was accepted.
    pub created: Moment,
    state: Mutex<State>,
    ended: Notify,
}

impl Job {
    /// A job that has been accepted this moment.
    pub fn new(client: Client, specification: Arc<Specification>) -> Self {
        Self {
            id: JobId(Uuid::now_v7()),
            client,
            label: specification.label().map(str::to_owned),
            horizon: specification.time(),
            created: Moment::now(),
            state: Mutex::new(State::Accepted(specification)),
            ended: Notify::new(),
        }
    }

    /// Where it stands now.
    pub fn state(&self) -> State {
        self.lock().clone()
    }

    /// Accepted to running, at most `wall` long, or as long as the specification allows if that is less.
    /// Nothing if it has been dismissed meanwhile.
    pub fn start(&self, wall: Duration) -> Option<(Arc<Specification>, Arc<Control>)> {
        let mut state = self.lock();
        let State::Accepted(specification) = &*state else { return None };
        let specification = Arc::clone(specification);
        let started = Moment::now();
        let asked = specification.wall_seconds().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        let wall = asked.map_or(wall, |asked| asked.min(wall));
        let control = Arc::new(match started.clock.checked_add(wall) {
            Some(deadline) => Control::with_deadline(deadline),
            None => Control::new(),
        });
        *state = State::Running { started, control: Arc::clone(&control) };
        Some((specification, control))
    }

    /// Running to its end; wakes whoever waits.
    pub fn finish(&self, ending: Ending) {
        let mut state = self.lock();
        if let State::Running { started, control } = &*state {
            let (started, control) = (Some(*started), Some(Arc::clone(control)));
            *state = State::Ended { started, finished: Moment::now(), control, ending };
            drop(state);
            self.ended.notify_waiters();
        }
    }

    /// Accepted to dismissed, which is said by `true`; a running job is asked to stop at its next step; an ended one
    /// stays as it is.
    pub fn cancel(&self) -> bool {
        let mut state = self.lock();
        match &*state {
            State::Accepted(_) => {
                let ending = Ending::Dismissed(None);
                *state = State::Ended { started: None, finished: Moment::now(), control: None, ending };
                drop(state);
                self.ended.notify_waiters();
                true
            }
            State::Running { control, .. } => {
                control.cancel();
                false
            }
            State::Ended { .. } => false,
        }
    }

    /// Returns when the job has ended, with how.
    pub async fn ended(&self) -> Ending {
        loop {
            // Taken before the look at the state: a job that ends in between wakes it all the same.
            let ended = self.ended.notified();
            if let State::Ended { ending, .. } = &*self.lock() {
                return ending.clone();
            }
            ended.await;
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
