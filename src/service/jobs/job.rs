//! A job and the states that it passes through:
//!
//! ```text
//! accepted -> running -> successful | failed | dismissed
//! accepted ------------------------------> dismissed
//! ```
//!
//! A running job may have to release its worker at the end of its first time slice: until it is sure to keep the
//! worker, its reported state is accepted.
//!
//! The states are those of OGC API - Processes, part 1, `statusCode`. *Successful* means that the end time was
//! reached; the verdict says whether the solution can be trusted. A solve stopped by a limit did not reach the
//! requested end time, so that its job is *failed*, as is a job whose numerical method failed; a job stopped by its
//! client is *dismissed*. All three keep the trajectory up to the stop. A running job that is parked (stopped because
//! the service process ends) goes back to accepted, for the next process to start.

use super::chunks::Chunks;
use super::ended::{Ended, Ending, Timing};
use super::idempotency::Key;
use super::{Client, Record};
use crate::compiled::Known;
use crate::context::Context;
use crate::digest::Digest;
use crate::worker::{Facts, SweepFacts};
use jiff::Timestamp;
use problem::Control;
use serde::{Deserialize, Serialize};
use specification::Time;
use std::borrow::Cow;
use std::fmt;
use std::pin::pin;
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::Notify;
use uuid::{Uuid, Variant};

/// The id of a job; ids sort by time of creation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct JobId(Uuid);

impl JobId {
    /// Creates a new job id.
    pub(super) fn new() -> Self {
        Self(Uuid::now_v7())
    }

    /// The job id as a number, which is the key in the database.
    pub(super) fn number(self) -> u128 {
        self.0.as_u128()
    }

    /// Returns the job id that has this key in the database, if the service can have issued the id (RFC 9562, version
    /// 7).
    pub(super) fn of_key(key: [u8; 16]) -> Option<Self> {
        let id = Uuid::from_u128(u128::from_le_bytes(key));
        (id.get_version_num() == 7 && id.get_variant() == Variant::RFC4122).then_some(Self(id))
    }

    /// Returns the job id with this number.
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

/// A point in time, such as the admission of a job: calendar time to report, monotonic time to measure durations.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// The calendar time, which is reported to clients.
    pub date: Timestamp,
    /// The monotonic time, by which durations are measured.
    pub clock: Instant,
}

impl Moment {
    /// Returns the current point in time, by both clocks.
    pub fn now() -> Self {
        Self { date: Timestamp::now(), clock: Instant::now() }
    }
}

/// The state of a job.
#[derive(Clone, Debug)]
pub enum State {
    /// The job waits for a worker; the value is its specification, `None` if that is in the store and not in memory.
    Accepted(Option<Arc<[u8]>>),
    /// A worker is solving the job.
    Running {
        /// The time at which the current attempt to solve the job started.
        started: Moment,
        /// The control of the solve, which reports its progress and stops it at its next step.
        control: Arc<Control>,
        /// The reason for which the job was asked to stop, if it was; decides its next state.
        halt: Option<Halt>,
        /// Whether the job is in its first time slice: it may have to yield its worker, and is still reported as
        /// accepted.
        on_trial: bool,
    },
    /// The job has ended, and its state is final.
    Ended(Arc<Ended>),
}

/// The reason for which a running job is asked to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Halt {
    /// The client has cancelled the job, which is to end as dismissed.
    Dismiss,
    /// The service process is about to end; the next process starts the job again.
    Park,
    /// The first time slice of the job is over, and other jobs wait for theirs; the job starts again later.
    Yield,
}

/// The place where a job is stored, and whether the job outlives the process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Persistence {
    /// The job is in memory only, and is lost when the process ends.
    Memory,
    /// The job is on the disk once a pending write has completed.
    Storing,
    /// The job is on the disk and outlives the process.
    Disk,
    /// The job is stored nowhere: it is deleted.
    Forgotten,
}

/// The part of a job that changes: its state and the place where it is stored.
#[derive(Debug)]
pub(super) struct Lifecycle {
    pub state: State,
    pub persistence: Persistence,
    /// Whether the job has been stopped and left to the next process.
    pub parked: bool,
    /// Whether the end of the running job is being written to the disk, after which no other change may be written.
    pub is_ending: bool,
}

/// A job: a specification to be solved, the state of the solve, and the counts and ids that accompany it.
#[derive(Debug)]
pub struct Job {
    /// The id of the job.
    pub id: JobId,
    /// The client that posted the job.
    pub client: Client,
    /// A label chosen by the client.
    pub label: Option<String>,
    /// The time horizon of the job's problem.
    pub horizon: Time,
    /// The problem type and the estimated memory of a solve; absent from jobs stored by earlier versions.
    pub(super) estimate: Option<Estimate>,
    /// The time at which the job was accepted.
    pub created: Moment,
    /// The idempotency key under which the client may ask for the job again.
    pub(super) key: Option<Key>,
    /// The number of times that the service process, or the worker on another machine, died while the job ran.
    pub(super) crashes: AtomicU32,
    /// The number of crashes of the service process while this job ran alone.
    pub(super) crashes_alone: u32,
    /// The number of crashes of the service process while this job ran alone and the system had run out of memory.
    pub(super) shortages_alone: u32,
    /// The size of the posted specification, in bytes.
    pub(super) document_bytes: usize,
    /// The state of the members, if the job is a sweep that has not ended.
    pub(super) chunks: Option<Arc<Chunks>>,
    /// The posted specification, unless it is on the disk.
    pub(super) document: Option<Arc<[u8]>>,
    /// The digest of the specification, once the specification is to be on the disk.
    pub(super) digest: OnceLock<Digest>,
    /// The ids and the trace of the request that posted the job, if that was in this process.
    pub(super) context: Context,
    /// The compiled specification for an inline solve, if it was compiled in this process, until an attempt takes it;
    /// and whether the job is to be solved even if its solution is known.
    solve_inline: Mutex<Option<(Arc<Known>, bool)>>,
    /// Whether the job has used up its first time slice, after which it may have had to yield its worker.
    sliced: AtomicBool,
    lifecycle: Mutex<Lifecycle>,
    settled: Notify,
    /// Wakes the supervisor of the job's worker when the job is to stop.
    pub(super) halted: Notify,
}

/// The properties of a solve that are known before it runs.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Estimate {
    /// The problem type, such as `dvi` or `circuit`.
    pub problem: Cow<'static, str>,
    /// The estimated memory of the solve, in bytes.
    pub memory: usize,
    /// The properties of the sweep, if the job is one; absent from jobs stored by earlier versions, which are solved
    /// in one piece.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sweep: Option<SweepFacts>,
}

/// A client's request for a solve.
#[derive(Clone, Debug)]
pub struct Order {
    /// The client that requests the solve.
    pub client: Client,
    /// The label, time horizon, type and estimated memory of the problem.
    pub facts: Facts,
    /// The compiled specification, if it was compiled in this process.
    pub known: Option<Arc<Known>>,
    /// Whether to solve even if the solution of this specification is known.
    pub anew: bool,
    /// The specification that the client has posted.
    pub document: Arc<[u8]>,
    /// The idempotency key, if the client sent one.
    pub key: Option<Key>,
}

impl Job {
    /// Creates a job, stored on the disk if it is `durable` and otherwise in memory.
    pub(super) fn new(order: Order, durable: bool) -> Self {
        Self::named(JobId::new(), order, durable)
    }

    /// Creates the job of `order` under an id that has been issued earlier.
    pub(super) fn named(id: JobId, order: Order, durable: bool) -> Self {
        let Order { client, facts, document, key, known, anew } = order;
        let Facts { label, horizon, problem, memory, sweep } = facts;
        let persistence = if durable { Persistence::Storing } else { Persistence::Memory };
        Self {
            id,
            client,
            label,
            horizon,
            estimate: Some(Estimate { problem, memory, sweep }),
            created: Moment::now(),
            key,
            crashes: AtomicU32::new(0),
            crashes_alone: 0,
            shortages_alone: 0,
            chunks: sweep.map(|sweep| Arc::new(Chunks::new(sweep))),
            document_bytes: document.len(),
            document: (!durable).then(|| Arc::clone(&document)),
            digest: OnceLock::new(),
            context: Context::current(),
            solve_inline: Mutex::new(known.map(|known| (known, anew))),
            sliced: AtomicBool::new(false),
            lifecycle: Mutex::new(Lifecycle {
                state: State::Accepted(Some(document)),
                persistence,
                parked: false,
                is_ending: false,
            }),
            settled: Notify::new(),
            halted: Notify::new(),
        }
    }

    /// Creates a job under an id that has been issued earlier, to be solved and stored on other machines.
    pub(super) fn elsewhere(id: JobId, order: Order) -> Self {
        let job = Self::named(id, Order { known: None, ..order }, true);
        *job.lock() =
            Lifecycle { state: State::Accepted(None), persistence: Persistence::Disk, parked: false, is_ending: false };
        Self { chunks: None, ..job }
    }

    /// Creates a job that another process has admitted and this process is to solve, with its chunks if it is a
    /// sweep.
    pub(super) fn taken_on(id: JobId, record: Record, chunks: Option<Chunks>, document: Arc<[u8]>) -> Self {
        let job = Self::recovered(id, Record { ended: None, ..record }, chunks);
        let state = State::Accepted(Some(Arc::clone(&document)));
        *job.lock() = Lifecycle { state, persistence: Persistence::Memory, parked: false, is_ending: false };
        Self { document: Some(document), ..job }
    }

    /// Creates the job of a chunk of this sweep, with the sweep's id and client, which no client sees.
    pub(super) fn of_chunk(&self, document: &Arc<[u8]>) -> Self {
        let lifecycle = Lifecycle {
            state: State::Accepted(Some(Arc::clone(document))),
            persistence: Persistence::Memory,
            parked: false,
            is_ending: false,
        };
        Self {
            id: self.id,
            client: self.client,
            label: None,
            horizon: self.horizon,
            estimate: self.estimate.clone(),
            created: self.created,
            key: None,
            crashes: AtomicU32::new(self.crashes()),
            crashes_alone: 0,
            shortages_alone: 0,
            chunks: None,
            document_bytes: self.document_bytes,
            document: None,
            digest: OnceLock::new(),
            context: self.context.clone(),
            solve_inline: Mutex::default(),
            sliced: AtomicBool::new(false),
            lifecycle: Mutex::new(lifecycle),
            settled: Notify::new(),
            halted: Notify::new(),
        }
    }

    /// Restores a job that an earlier process admitted, with its chunks if it is a sweep that has not ended.
    pub(super) fn recovered(id: JobId, record: Record, chunks: Option<Chunks>) -> Self {
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
            crashes: AtomicU32::new(crashes),
            crashes_alone,
            shortages_alone,
            chunks: chunks.map(Arc::new),
            document_bytes,
            document: None,
            digest: document.map_or_else(OnceLock::new, OnceLock::from),
            context: Context::default(),
            solve_inline: Mutex::default(),
            sliced: AtomicBool::new(false),
            lifecycle: Mutex::new(Lifecycle { state, persistence: Persistence::Disk, parked: false, is_ending: false }),
            settled: Notify::new(),
            halted: Notify::new(),
        }
    }

    /// Returns the reported state: a job in its first time slice is reported as waiting.
    pub fn state(&self) -> State {
        match &self.lock().state {
            State::Running { on_trial: true, .. } => State::Accepted(None),
            state => state.clone(),
        }
    }

    /// Returns the control of the solve if a worker has the job, whatever the reported state.
    pub fn control(&self) -> Option<Arc<Control>> {
        match &self.lock().state {
            State::Running { control, .. } => Some(Arc::clone(control)),
            State::Accepted(_) | State::Ended(_) => None,
        }
    }

    /// Whether the client can find the job by an idempotency key.
    pub fn has_key(&self) -> bool {
        self.key.is_some()
    }

    /// Returns the number of the current attempt to solve the job, counted from one.
    pub fn attempt(&self) -> u32 {
        self.crashes() + 1
    }

    /// Returns the number of times that the process, or the worker on another machine, died while the job ran.
    pub(super) fn crashes(&self) -> u32 {
        self.crashes.load(Relaxed)
    }

    /// Whether the job is deleted, so that its results are not needed.
    pub(super) fn is_forgotten(&self) -> bool {
        self.lock().persistence == Persistence::Forgotten
    }

    /// Whether a worker is to take the job: it has not ended, and was not asked to stop.
    pub(super) fn is_wanted(&self) -> bool {
        match &self.lock().state {
            State::Accepted(_) => true,
            State::Running { halt, .. } => halt.is_none(),
            State::Ended(_) => false,
        }
    }

    /// Returns the number of members of a sweep that have rows, and the number of all members; `None` if the job is
    /// not a sweep.
    pub fn members(&self) -> Option<(usize, usize)> {
        let all = self.estimate.as_ref()?.sweep?.members;
        let done = match &self.lock().state {
            State::Ended(ended) => ended.rows.unwrap_or(0),
            State::Running { control, .. } if self.chunks.is_none() => {
                (control.fraction() * all as f64).round() as usize
            }
            State::Accepted(_) | State::Running { .. } => self.chunks.as_ref().map_or(0, |chunks| chunks.rows()),
        };
        Some((done, all))
    }

    /// Whether the job is on the disk, or is about to be.
    pub(super) fn is_durable(&self) -> bool {
        self.lock().is_durable()
    }

    /// Changes the state of the job from accepted to running, for at most the time `wall`; `on_trial` says whether the
    /// job is in its first time slice. Returns `None` if the job has been dismissed or parked meanwhile.
    pub(super) fn start(&self, wall: Duration, on_trial: bool) -> Option<Arc<Control>> {
        let control = match Instant::now().checked_add(wall) {
            Some(deadline) => Control::with_deadline(deadline),
            None => Control::new(),
        };
        self.start_within(control, on_trial)
    }

    /// Changes the state of the job from accepted to running, with a given `control` of the solve; see [`Job::start`].
    pub(super) fn start_within(&self, control: Control, on_trial: bool) -> Option<Arc<Control>> {
        let mut lifecycle = self.lock();
        if lifecycle.parked || !matches!(lifecycle.state, State::Accepted(_)) {
            return None;
        }
        // Consume a pending notification: a request to stop that came as the last attempt at the job ended does not
        // apply to the attempt that begins.
        pin!(self.halted.notified()).as_mut().enable();
        let (started, control) = (Moment::now(), Arc::new(control));
        lifecycle.state = State::Running { started, control: Arc::clone(&control), halt: None, on_trial };
        Some(control)
    }

    /// Ends the first time slice of a running job, which may then run to its end.
    pub(super) fn stay(&self) {
        if let State::Running { on_trial, .. } = &mut self.lock().state {
            *on_trial = false;
        }
    }

    /// Whether the job has used up its first time slice.
    pub(super) fn has_had_slice(&self) -> bool {
        self.sliced.load(Relaxed)
    }

    /// Records that the job has used up its first time slice.
    pub(super) fn use_up_slice(&self) {
        self.sliced.store(true, Relaxed);
    }

    /// Takes the compiled specification for an inline solve, if it is in memory, and whether to ignore a known
    /// solution.
    pub(super) fn solve_inline(&self) -> Option<(Arc<Known>, bool)> {
        self.solve_inline.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Changes the state of the job from running to accepted (waiting), with the specification `document`; if the job
    /// was asked to be dismissed or parked, leaves the state as it is and returns the reason.
    pub(super) fn go_back(&self, document: &Arc<[u8]>) -> Option<Halt> {
        let mut lifecycle = self.lock();
        if let State::Running { halt, .. } = &lifecycle.state {
            if let Some(Halt::Dismiss | Halt::Park) = halt {
                return *halt;
            }
            lifecycle.state = State::Accepted(Some(Arc::clone(document)));
        }
        None
    }

    /// Asks a running job to stop at its next step, and returns whether the job runs. A request of the client, or to
    /// park the job, takes precedence over a request to yield.
    pub(super) fn halt(&self, reason: Halt) -> bool {
        let mut lifecycle = self.lock();
        let State::Running { halt, .. } = &mut lifecycle.state else { return false };
        *halt = Some(halt.filter(|asked| *asked != Halt::Yield).unwrap_or(reason));
        self.halted.notify_one();
        true
    }

    /// Returns the reason for which the running job was asked to stop, if it was.
    pub(super) fn halted(&self) -> Option<Halt> {
        match &self.lock().state {
            State::Running { halt, .. } => *halt,
            State::Accepted(_) | State::Ended(_) => None,
        }
    }

    /// Creates the record of an end of the job at the current time, with the times and the progress of the running
    /// solve.
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
                rows: self.chunks.as_ref().map(|chunks| chunks.rows()),
                damaged: false,
                repeated: false,
            },
            State::Accepted(_) | State::Ended(_) => Ended::unsolved(ending),
        }
    }

    /// Ends the job, unless it has ended, and wakes all tasks that wait for its end.
    pub(super) fn finish(&self, ended: Ended) {
        self.lock().finish(ended);
        self.wake();
    }

    /// Ends the job with the end that is stored on the disk, even if another end was reported earlier, and wakes all
    /// tasks that wait for its end.
    pub(super) fn conclude(&self, ended: Ended) {
        self.lock().state = State::Ended(Arc::new(ended));
        self.wake();
    }

    /// Wakes all tasks that wait for the end of the job.
    pub(super) fn wake(&self) {
        self.settled.notify_waiters();
    }

    /// Waits until the job has ended, and returns its end, or until it has been parked, and returns `None`.
    pub async fn settled(&self) -> Option<Arc<Ended>> {
        loop {
            // The notification is registered before the state of the job is read, so that an end in between is not
            // missed.
            let settled = self.settled.notified();
            {
                let lifecycle = self.lock();
                if let State::Ended(ended) = &lifecycle.state {
                    return Some(Arc::clone(ended));
                }
                if lifecycle.parked {
                    return None;
                }
            }
            settled.await;
        }
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, Lifecycle> {
        self.lifecycle.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Lifecycle {
    pub fn is_durable(&self) -> bool {
        matches!(self.persistence, Persistence::Storing | Persistence::Disk)
    }

    /// Ends the job, unless it has ended.
    pub fn finish(&mut self, ended: Ended) {
        if !matches!(self.state, State::Ended(_)) {
            self.state = State::Ended(Arc::new(ended));
        }
    }
}
