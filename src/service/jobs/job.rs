//! One job and the states it passes through:
//!
//! ```text
//! accepted -> running -> successful | failed | dismissed
//! accepted ------------------------------> dismissed
//! ```
//!
//! A worker that takes up a job may have to put it back: until it is sure to stay, the job is told as accepted.
//!
//! The words are those of OGC API - Processes, part 1, `statusCode`. *Successful* says that the end time was reached;
//! whether the answer is trusted, its verdict says.
//! A solve that a limit stopped did not do what it was asked, so its job is *failed*, as is one whose numerics
//! failed; one stopped by its client is *dismissed*. All three keep the trajectory so far. A running job that is
//! parked goes back to accepted, for the next process to take up.

use super::ended::{Ended, Ending, Timing};
use super::idempotency::Key;
use super::{Client, Record};
use crate::compiled::Known;
use crate::context::Context;
use crate::digest::Digest;
use crate::worker::Facts;
use jiff::Timestamp;
use problem::Control;
use serde::{Deserialize, Serialize};
use specification::Time;
use std::borrow::Cow;
use std::fmt;
use std::pin::pin;
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::Notify;
use uuid::{Uuid, Variant};

/// The name of a job, sorting by time of birth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct JobId(Uuid);

impl JobId {
    /// The number by which the database knows it.
    pub(super) fn number(self) -> u128 {
        self.0.as_u128()
    }

    /// The name with that key in the database, if it is one that was given here (RFC 9562, version 7).
    pub(super) fn of_key(key: [u8; 16]) -> Option<Self> {
        let id = Uuid::from_u128(u128::from_le_bytes(key));
        (id.get_version_num() == 7 && id.get_variant() == Variant::RFC4122).then_some(Self(id))
    }

    /// The name of that number.
    pub(super) fn of_number(number: u128) -> Self {
        Self(Uuid::from_u128(number))
    }
}

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
    /// This one.
    pub fn now() -> Self {
        Self { date: Timestamp::now(), clock: Instant::now() }
    }
}

/// Where a job stands.
#[derive(Clone, Debug)]
pub enum State {
    /// It waits for a worker; what was posted is in the store where it is not in hand.
    Accepted(Option<Arc<[u8]>>),
    /// A worker is at it.
    Running {
        /// Since when.
        started: Moment,
        /// How to follow it and to stop it.
        control: Arc<Control>,
        /// What it is to become when it stops, if it was asked to.
        halt: Option<Halt>,
        /// It may have to make room for others, and is told as one that waits until it is sure to stay.
        on_trial: bool,
    },
    /// It will not change any more.
    Ended(Arc<Ended>),
}

/// Why a running job is asked to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Halt {
    /// Its client does not want it any more.
    Dismiss,
    /// The process is about to end; the next one starts it again.
    Park,
    /// It has had its first slice, and others have not had theirs; it begins again later.
    Yield,
}

/// What keeps a job when the process ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Persistence {
    /// Nothing.
    Memory,
    /// The disk, as soon as it has been written.
    Storing,
    /// The disk.
    Disk,
    /// Nothing ever again.
    Forgotten,
}

/// What changes in the life of a job.
#[derive(Debug)]
pub(super) struct Lifecycle {
    pub state: State,
    pub keeping: Persistence,
    /// It is left to the next process.
    pub parked: bool,
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
    /// The type of its problem, and the bytes that a solve was estimated to take; not known of what earlier versions stored.
    pub(super) estimate: Option<Estimate>,
    /// When it was accepted.
    pub created: Moment,
    /// Under which the client may ask for it again.
    pub(super) key: Option<Key>,
    /// How often the process ended while it ran.
    pub(super) crashes: u32,
    /// How often it was the only one that ran.
    pub(super) crashes_alone: u32,
    /// How often memory had run out then.
    pub(super) shortages_alone: u32,
    /// The bytes of what was posted.
    pub(super) document_bytes: usize,
    /// What was posted, where the disk does not have it.
    pub(super) document: Option<Arc<[u8]>>,
    /// The digest of that, once it is to be on the disk.
    pub(super) digest: OnceLock<Digest>,
    /// The request that posted it, in this process.
    pub(super) context: Context,
    /// What it is of, until it starts, where that was read here; and whether it is to be solved though the answer may be known.
    solve_inline: Mutex<Option<(Arc<Known>, bool)>>,
    /// It has had its first slice.
    sliced: AtomicBool,
    life: Mutex<Lifecycle>,
    settled: Notify,
    /// Wakes whoever supervises its worker when it is to stop.
    pub(super) halted: Notify,
}

/// What is known of a solve before it runs.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Estimate {
    /// The type of the problem.
    pub problem: Cow<'static, str>,
    /// Bytes.
    pub memory: usize,
}

/// What a client asks for.
#[derive(Clone, Debug)]
pub struct Order {
    /// Whose it is.
    pub client: Client,
    /// What is to be solved.
    pub facts: Facts,
    /// The same, where it has been read here.
    pub known: Option<Arc<Known>>,
    /// It is to be solved though the answer to it may be known.
    pub anew: bool,
    /// What was posted.
    pub document: Arc<[u8]>,
    /// Under which it may be asked for again.
    pub key: Option<Key>,
}

impl Job {
    /// A job that has been accepted this moment, to be kept by memory or by the disk.
    pub(super) fn new(order: Order, lasting: bool) -> Self {
        let Order { client, facts: Facts { label, horizon, problem, memory }, document, key, known, anew } = order;
        let keeping = if lasting { Persistence::Storing } else { Persistence::Memory };
        Self {
            id: JobId(Uuid::now_v7()),
            client,
            label,
            horizon,
            estimate: Some(Estimate { problem, memory }),
            created: Moment::now(),
            key,
            crashes: 0,
            crashes_alone: 0,
            shortages_alone: 0,
            document_bytes: document.len(),
            document: (!lasting).then(|| Arc::clone(&document)),
            digest: OnceLock::new(),
            context: Context::current(),
            solve_inline: Mutex::new(known.map(|known| (known, anew))),
            sliced: AtomicBool::new(false),
            life: Mutex::new(Lifecycle { state: State::Accepted(Some(document)), keeping, parked: false }),
            settled: Notify::new(),
            halted: Notify::new(),
        }
    }

    /// A job that an earlier process accepted.
    pub(super) fn recovered(id: JobId, record: Record) -> Self {
        let Record { client, label, horizon, estimate, created, document_bytes, document, key, ended, .. } = record;
        let Record { crashes, crashes_alone, shortages_alone, .. } = record;
        let state = ended.map_or(State::Accepted(None), |ended| State::Ended(Arc::new(ended)));
        Self {
            id,
            client,
            label,
            horizon,
            estimate,
            created: Moment { date: created, clock: Instant::now() },
            key,
            crashes,
            crashes_alone,
            shortages_alone,
            document_bytes,
            document: None,
            digest: document.map_or_else(OnceLock::new, OnceLock::from),
            context: Context::default(),
            solve_inline: Mutex::default(),
            sliced: AtomicBool::new(false),
            life: Mutex::new(Lifecycle { state, keeping: Persistence::Disk, parked: false }),
            settled: Notify::new(),
            halted: Notify::new(),
        }
    }

    /// Where it stands now, as it is told: a job that may have to make room still waits.
    pub fn state(&self) -> State {
        match &self.lock().state {
            State::Running { on_trial: true, .. } => State::Accepted(None),
            state => state.clone(),
        }
    }

    /// How to follow it, if a worker is at it, told or not.
    pub fn control(&self) -> Option<Arc<Control>> {
        match &self.lock().state {
            State::Running { control, .. } => Some(Arc::clone(control)),
            State::Accepted(_) | State::Ended(_) => None,
        }
    }

    /// Whether the client can find it without its name.
    pub fn has_key(&self) -> bool {
        self.key.is_some()
    }

    /// Which attempt at it this is, from one.
    pub fn attempt(&self) -> u32 {
        self.crashes + 1
    }

    /// Whether nobody wants what it comes to.
    pub(super) fn is_forgotten(&self) -> bool {
        self.lock().keeping == Persistence::Forgotten
    }

    /// Whether the disk keeps it, or is about to.
    pub(super) fn is_lasting(&self) -> bool {
        self.lock().is_lasting()
    }

    /// Accepted to running, at most `wall` long, at first on trial or to stay. Nothing if it has been dismissed or parked
    /// meanwhile.
    pub(super) fn start(&self, wall: Duration, on_trial: bool) -> Option<Arc<Control>> {
        let control = match Instant::now().checked_add(wall) {
            Some(deadline) => Control::with_deadline(deadline),
            None => Control::new(),
        };
        self.start_within(control, on_trial)
    }

    /// The same, as long as `control` lets it.
    pub(super) fn start_within(&self, control: Control, on_trial: bool) -> Option<Arc<Control>> {
        let mut life = self.lock();
        if life.parked || !matches!(life.state, State::Accepted(_)) {
            return None;
        }
        // A wish to stop that came as the last attempt ended is not one for this.
        pin!(self.halted.notified()).as_mut().enable();
        let (started, control) = (Moment::now(), Arc::new(control));
        life.state = State::Running { started, control: Arc::clone(&control), halt: None, on_trial };
        Some(control)
    }

    /// Its trial is over, and it goes on.
    pub(super) fn stay(&self) {
        if let State::Running { on_trial, .. } = &mut self.lock().state {
            *on_trial = false;
        }
    }

    /// Whether it has had its first slice.
    pub(super) fn has_had_slice(&self) -> bool {
        self.sliced.load(Relaxed)
    }

    /// Its first slice is over.
    pub(super) fn use_up_slice(&self) {
        self.sliced.store(true, Relaxed);
    }

    /// What it is of, once, where that is in hand.
    pub(super) fn solve_inline(&self) -> Option<(Arc<Known>, bool)> {
        self.solve_inline.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Running to accepted, with what was posted, unless it was asked to stop meanwhile; what it is to become then.
    pub(super) fn go_back(&self, document: &Arc<[u8]>) -> Option<Halt> {
        let mut life = self.lock();
        if let State::Running { halt, .. } = &life.state {
            if let Some(Halt::Dismiss | Halt::Park) = halt {
                return *halt;
            }
            life.state = State::Accepted(Some(Arc::clone(document)));
        }
        None
    }

    /// Asks a running job to stop at its next step, and says whether it runs. What its client wants goes before.
    pub(super) fn halt(&self, reason: Halt) -> bool {
        let mut life = self.lock();
        let State::Running { halt, .. } = &mut life.state else { return false };
        *halt = Some(halt.filter(|asked| *asked != Halt::Yield).unwrap_or(reason));
        self.halted.notify_one();
        true
    }

    /// Why it was asked to stop, if it was.
    pub(super) fn halted(&self) -> Option<Halt> {
        match &self.lock().state {
            State::Running { halt, .. } => *halt,
            State::Accepted(_) | State::Ended(_) => None,
        }
    }

    /// The end, now, of what has been started.
    pub(super) fn ended(&self, ending: Ending) -> Ended {
        let finished = Moment::now();
        match &self.lock().state {
            State::Running { started, control, .. } => Ended {
                started: Some(started.date),
                finished: finished.date,
                timing: Some(Timing {
                    queue: started.clock.saturating_duration_since(self.created.clock),
                    solve: finished.clock.saturating_duration_since(started.clock),
                }),
                fraction: control.fraction(),
                steps: control.steps(),
                ending,
                verdict: None,
                held: None,
                damaged: false,
                repeated: false,
            },
            State::Accepted(_) | State::Ended(_) => Ended::unsolved(ending),
        }
    }

    /// To its end; wakes whoever waits.
    pub(super) fn finish(&self, ended: Ended) {
        self.lock().finish(ended);
        self.wake();
    }

    /// To its end as it is on the disk, whether it was told before or not; wakes whoever waits.
    pub(super) fn conclude(&self, ended: Ended) {
        self.lock().state = State::Ended(Arc::new(ended));
        self.wake();
    }

    /// Wakes whoever waits for the end.
    pub(super) fn wake(&self) {
        self.settled.notify_waiters();
    }

    /// Returns when the job has ended, with how, or when it has been parked, with nothing.
    pub async fn settled(&self) -> Option<Arc<Ended>> {
        loop {
            // Taken before the look at the state: a job that ends in between wakes it all the same.
            let settled = self.settled.notified();
            {
                let life = self.lock();
                if let State::Ended(ended) = &life.state {
                    return Some(Arc::clone(ended));
                }
                if life.parked {
                    return None;
                }
            }
            settled.await;
        }
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, Lifecycle> {
        self.life.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Lifecycle {
    pub fn is_lasting(&self) -> bool {
        matches!(self.keeping, Persistence::Storing | Persistence::Disk)
    }

    /// Ends what has not ended.
    pub fn finish(&mut self, ended: Ended) {
        if !matches!(self.state, State::Ended(_)) {
            self.state = State::Ended(Arc::new(ended));
        }
    }
}
