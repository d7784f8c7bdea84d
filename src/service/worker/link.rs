//! The link of the front process (which serves HTTP) to one worker: the pipes, and the worker's process.

use super::Death;
use super::frame::{self, Decoder};
use super::launcher::Start;
use super::message::{Facts, Limits, Members, Order, Origin, Prints, Report, Solved, VERSION};
use super::slice::{Slice, SliceClock};
use super::{Confinement, Loss};
use problem::Control;
use rustix::process::{Pid, setpriority_pgrp};
use std::io::{self, Read, Write};
use std::process::{Child, ChildStderr};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::unix::pipe::{Receiver, Sender};
use tokio::select;
use tokio::sync::Notify;
use tokio::task::spawn_blocking;
use tokio::time::{Instant, MissedTickBehavior, interval_at, sleep_until, timeout, timeout_at};

/// The size limit of a result as columns, as a multiple of its limit as JSON: a number takes eight bytes in columns
/// and at least two in JSON, and the index is no longer than the columns.
const COLUMNS: usize = 8;

/// The interval between two requests to a worker for the progress of its task.
const LOOK: Duration = Duration::from_millis(100);

/// The time from the deadline of a task, or from a request to stop it, until its worker is killed: one step of a
/// large problem may take seconds.
const OVERRUN: Duration = Duration::from_secs(10);

/// The time limits for the start of a worker, and for its end after it has closed its pipe, generous for a busy
/// machine.
const START: Duration = Duration::from_secs(30);
const END: Duration = Duration::from_secs(5);

/// The number of bytes kept of the end of a worker's standard error.
const LAST_WORDS: usize = 4 << 10;

/// The duration of a task, as a multiple of the start-up time of its worker, after which the worker is lowered in
/// priority. A lowered worker is replaced after its task; the replacement costs a fraction of the work done. New
/// tasks then get, in all, up to nine tenths of the processors: each step of niceness reduces a share by about a
/// fifth.
pub const FAIR: u32 = 4;
const LOWERED: i32 = 10;

/// A duration that stands for the time limit of a task that has none.
const EVER: Duration = Duration::from_secs(1 << 30);

/// A task for a worker: to solve or to check a specification document.
pub struct Task<'a> {
    /// Whether to solve the document; otherwise the worker only checks it.
    pub solve: bool,
    /// The members of the sweep to solve, if the task is a part of a sweep.
    pub members: Option<&'a Members>,
    /// The specification document as it was posted.
    pub document: &'a [u8],
    /// The limits of steps, memory, time and result size of the task.
    pub limits: Limits,
    /// The control and the observers of the task.
    pub watch: &'a Watch<'a>,
    /// The destination of a long result in the columnar format.
    pub long: &'a mut (dyn Write + Send),
    /// Whether the worker is lowered in priority during a long task.
    pub yields: bool,
    /// The first time slice of the task, if it has one.
    pub slice: Option<Slice<'a>>,
}

/// The control and the observers of a task of a worker.
pub struct Watch<'a> {
    /// The ids of job, request and trace under which the worker logs the task.
    pub origin: &'a Origin,
    /// The control of the solve, to which the worker's reports of progress and events are passed.
    pub control: &'a Control,
    /// Notified when the task is to stop.
    pub halted: &'a Notify,
    /// Whether the results that the task has so far are unwanted, when it is to stop.
    pub is_unwanted: &'a (dyn Fn() -> bool + Sync),
}

/// The outcome of a task of a worker.
#[derive(Debug)]
pub enum Finished {
    /// The solve returned, with a solution or a failure.
    Solved(Box<Solved>, Left),
    /// The specification is correct: its main properties, and its summary as JSON.
    Checked(Facts, Vec<u8>),
    /// The specification has errors, given as JSON; the flag is true if its check was interrupted.
    Refused(Vec<u8>, bool),
    /// The solve was not begun: its estimated memory in bytes exceeds the limit.
    TooMuchMemory(usize),
    /// The results of the solve exceed their size limit.
    TooLarge,
}

/// The results of a solve, as the worker sends them.
#[derive(Debug)]
pub enum Left {
    /// Short results of the solve, sent as JSON.
    Text(Vec<u8>),
    /// Long results, written in the columnar format to [`Task::long`], with their fingerprints.
    Columns(Prints),
    /// The rows of the members of a sweep that the task has solved, from its first member on: their number, and the
    /// rows as bytes.
    Rows(usize, Vec<u8>),
}

/// The link to a worker at the other end of two pipes.
#[derive(Debug)]
pub struct Link {
    orders: Sender,
    reports: Receiver,
    decoder: Decoder,
    process: Option<Process>,
    /// The process id of the worker, or zero if it has no process of its own.
    pub id: u32,
    /// The number of the latest task that the worker was given.
    task: u64,
    /// The resource and access limits in force on the worker process.
    pub confinement: Confinement,
    /// The start-up time of the worker. It is also the time that a worker has to stop a task whose results are
    /// unwanted: to wait longer would cost more than to start another worker.
    pub started_in: Duration,
    /// Whether the worker has had a long task, during which its priority was lowered.
    pub is_lowered: bool,
    /// The memory that the worker held after its latest task, in bytes.
    pub resident: u64,
}

impl Link {
    /// Opens the link to a worker whose start began at `begun`, and waits until it is ready.
    ///
    /// # Errors
    /// The worker does not answer, or is of another version.
    pub async fn open(start: Start, begun: Instant) -> io::Result<Self> {
        let process = start.process.map(Process::new).transpose()?;
        let (orders, reports) = (Sender::from_owned_fd(start.orders)?, Receiver::from_owned_fd(start.reports)?);
        let id = process.as_ref().map_or(0, |process| process.child.id());
        let (decoder, confinement) = (Decoder::default(), Confinement::default());
        let started_in = Duration::ZERO;
        let mut link = Self {
            orders,
            reports,
            decoder,
            process,
            id,
            task: 0,
            confinement,
            started_in,
            is_lowered: false,
            resident: 0,
        };
        match timeout(START, link.receive()).await.map_err(io::Error::from).flatten() {
            Ok((Report::Ready { version: VERSION, confinement }, _)) => {
                Ok(Self { confinement, started_in: begun.elapsed(), ..link })
            }
            Ok((report, _)) => Err(io::Error::other(format!("{report:?} from a worker in place of version {VERSION}"))),
            Err(error) => Err(io::Error::other(format!("{error}: {:?}", link.death().await))),
        }
    }

    /// Waits until the idle worker has closed its pipe, which means that it has died.
    pub async fn closed(&mut self) {
        // Reports that come late, about earlier tasks of the worker, are ignored.
        while self.receive().await.is_ok() {}
    }

    /// Has the worker perform a task, and follows its progress.
    ///
    /// # Errors
    /// The worker died or was killed.
    pub async fn perform(&mut self, task: &mut Task<'_>) -> Result<Finished, Loss> {
        let Task { solve, members, document, limits, watch, long, yields, slice } = task;
        let (solve, limits) = (*solve, *limits);
        self.task += 1;
        let task = self.task;
        let origin = watch.origin.clone();
        let members = members.cloned();
        let order =
            if solve { Order::Solve { task, limits, origin, members } } else { Order::Check { task, limits, origin } };
        let begun = Instant::now();
        let most = limits.wall().unwrap_or(EVER).min(EVER);
        let mut end = begun + most + OVERRUN;
        let (mut taken, mut cancelled, mut looked) = (false, false, false);
        let mut written = 0;
        let (fair, mut lowered) = (begun + self.started_in * FAIR, self.is_lowered || !*yields);
        let mut clock = SliceClock::new(slice.as_ref().map(|slice| slice.time), self.id);
        match timeout_at(end, self.send(&order, document)).await {
            Ok(Ok(())) => {}
            Ok(Err(_)) => return Err(Loss::NotTaken(self.death().await)),
            Err(_) => return Err(self.overrun().await),
        }
        let mut looks = interval_at(begun + LOOK, LOOK);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            select! {
                biased;
                () = watch.halted.notified(), if !cancelled => {
                    cancelled = true;
                    let grace = if (watch.is_unwanted)() { self.started_in } else { OVERRUN };
                    end = end.min(Instant::now() + grace);
                    // If the worker has died, sending fails here, and reading its reports fails next.
                    let _ = self.send(&Order::Cancel { task }, &[]).await;
                }
                report = self.receive() => match report {
                    Ok((report, _)) if report.task().is_some_and(|of| of != task) => {}
                    Ok((Report::Taken { .. }, _)) => taken = true,
                    Ok((Report::Begun { .. }, _)) => clock.begin(),
                    Ok((Report::Progress { progress, .. }, _)) => {
                        looked = false;
                        progress.relay(watch.control);
                    }
                    Ok((Report::Piece { .. }, bytes)) => {
                        // The worker sends results, so that its solve has stopped in time; to send the results may
                        // take longer than the deadline.
                        end = end.max(Instant::now() + OVERRUN);
                        // A worker checks the size limit of results itself, so that exceeding it is a defect of the
                        // worker.
                        written += bytes.len();
                        if written > limits.result_bytes.saturating_mul(COLUMNS) {
                            return Err(Loss::Died(self.defect("a result beyond its bound").await));
                        }
                        if let Err(error) = long.write_all(&bytes) {
                            return Err(self.not_kept(&error).await);
                        }
                    }
                    Ok((Report::Solved { columns, rows, solved, progress, resident, .. }, bytes)) => {
                        self.resident = resident;
                        progress.relay(watch.control);
                        if let Some(rows) = rows {
                            return Ok(Finished::Solved(solved, Left::Rows(rows, bytes)));
                        }
                        let Some(prints) = columns else { return Ok(Finished::Solved(solved, Left::Text(bytes))) };
                        if let Err(error) = long.write_all(&bytes) {
                            return Err(self.not_kept(&error).await);
                        }
                        return Ok(Finished::Solved(solved, Left::Columns(prints)));
                    }
                    Ok((Report::Checked { facts, resident, .. }, bytes)) => {
                        self.resident = resident;
                        return Ok(Finished::Checked(facts, bytes));
                    }
                    Ok((Report::Refused { interrupted, .. }, bytes)) => {
                        return Ok(Finished::Refused(bytes, interrupted));
                    }
                    Ok((Report::TooMuchMemory { estimate, .. }, _)) => return Ok(Finished::TooMuchMemory(estimate)),
                    Ok((Report::TooLarge { .. }, _)) => return Ok(Finished::TooLarge),
                    Ok((Report::Defect { message, .. }, _)) => return Err(Loss::Died(self.defect(&message).await)),
                    Ok((Report::Ready { .. }, _)) => return Err(Loss::Died(self.defect("ready twice").await)),
                    Err(_) if taken => return Err(Loss::Died(self.death().await)),
                    Err(_) => return Err(Loss::NotTaken(self.death().await)),
                },
                _ = looks.tick() => {
                    if cancelled && (watch.is_unwanted)() {
                        end = end.min(Instant::now() + self.started_in);
                    }
                    if !looked {
                        looked = true;
                        let _ = timeout_at(end, self.send(&Order::Look { task }, &[])).await;
                    }
                }
                () = clock.rings() => {
                    if clock.is_over() && let Some(Slice { over, .. }) = slice {
                        over();
                    }
                }
                () = sleep_until(fair), if !lowered => {
                    lowered = true;
                    self.lower();
                }
                () = sleep_until(end) => return Err(self.overrun().await),
            }
        }
    }

    /// Lowers the priority of the worker for good: only root may raise it again.
    fn lower(&mut self) {
        self.is_lowered = true;
        let group = i32::try_from(self.id).ok().and_then(Pid::from_raw);
        // If `setpriority` fails, the worker goes on unchanged. The process group contains all threads of the worker.
        let _ = group.map(|group| setpriority_pgrp(Some(group), LOWERED));
    }

    async fn send(&mut self, order: &Order, document: &[u8]) -> io::Result<()> {
        self.orders.write_all(&frame::head(order, document.len())?).await?;
        self.orders.write_all(document).await
    }

    /// Receives the next report of the worker. Cancelling the future loses nothing: partial input stays in the
    /// decoder.
    async fn receive(&mut self) -> io::Result<(Report, Vec<u8>)> {
        loop {
            if let Some(frame) = self.decoder.take()? {
                return Ok(frame);
            }
            self.decoder.buffer.reserve(64 << 10);
            if self.reports.read_buf(&mut self.decoder.buffer).await? == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
        }
    }

    /// Kills a worker whose long results could be stored neither on the disk nor in memory, and returns its loss.
    async fn not_kept(&mut self, error: &io::Error) -> Loss {
        Loss::Died(self.defect(&format!("a result could not be kept: {error}")).await)
    }

    async fn overrun(&mut self) -> Loss {
        self.end(Process::kill).await;
        Loss::Died(Death::Overran)
    }

    /// Waits for the end of the worker, which has closed its pipe, and returns the cause of its death.
    pub async fn death(&mut self) -> Death {
        let death = self.end(Process::death).await;
        death.unwrap_or_else(|| Death::Defect("its thread ended".to_owned()))
    }

    async fn defect(&mut self, message: &str) -> Death {
        // The worker's standard error contains the source location of a panic.
        let words = self.end(Process::kill).await.unwrap_or_default();
        Death::Defect(if words.contains(message) { words } else { format!("{message} {words}") })
    }

    /// Ends the process of the worker by calling `how`, on a thread for blocking calls, since to free gigabytes of
    /// memory takes a while.
    async fn end<T: Send + 'static>(&mut self, how: impl FnOnce(&mut Process) -> T + Send + 'static) -> Option<T> {
        let mut process = self.process.take()?;
        spawn_blocking(move || how(&mut process)).await.ok()
    }
}

/// The process of a worker; dropping it kills the process.
#[derive(Debug)]
struct Process {
    child: Child,
    words: Arc<Mutex<Vec<u8>>>,
    listener: Option<thread::JoinHandle<()>>,
}

impl Process {
    fn new(mut child: Child) -> io::Result<Self> {
        let words = Arc::new(Mutex::default());
        let (stderr, heard) = (child.stderr.take(), Arc::clone(&words));
        let listen = move || stderr.map_or((), |stderr| listen(stderr, &heard));
        let listener = thread::Builder::new().name("dvi-listener".to_owned()).spawn(listen)?;
        Ok(Self { child, words, listener: Some(listener) })
    }

    /// Waits a limited time for the end of the worker's process, then kills it; returns the cause of its death.
    fn death(&mut self) -> Death {
        let start = std::time::Instant::now();
        while start.elapsed() < END && matches!(self.child.try_wait(), Ok(None)) {
            thread::sleep(Duration::from_millis(1));
        }
        let words = self.kill();
        match self.child.wait() {
            Ok(status) => Death::of(status, &words),
            Err(error) => Death::Defect(error.to_string()),
        }
    }

    /// Kills the process of the worker, if it has not ended, and returns its last output on standard error.
    fn kill(&mut self) -> String {
        // `kill` fails if the process of the worker has ended, which is harmless.
        let _ = self.child.kill();
        let _ = self.child.wait();
        if let Some(listener) = self.listener.take() {
            let _ = listener.join();
        }
        String::from_utf8_lossy(&self.words.lock().unwrap_or_else(PoisonError::into_inner)).into_owned()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Reads the standard error of a worker to its end, and keeps the last bytes in `words`.
fn listen(mut stderr: ChildStderr, words: &Mutex<Vec<u8>>) {
    let mut piece = [0; 1024];
    while let Ok(count @ 1..) = stderr.read(&mut piece) {
        let mut words = words.lock().unwrap_or_else(PoisonError::into_inner);
        words.extend_from_slice(&piece[..count]);
        let surplus = words.len().saturating_sub(LAST_WORDS);
        words.drain(..surplus);
    }
}
