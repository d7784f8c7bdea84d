//! The side of the front: the pipes to one worker, and its process.

use super::Death;
use super::frame::{self, Decoder};
use super::launcher::Start;
use super::message::{Facts, Limits, Order, Origin, Prints, Report, Solved, VERSION};
use super::{Confinement, Loss};
use problem::Control;
use rustix::process::{Pid, setpriority_pgrp};
use std::fs;
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

/// The bytes that a result may take as columns for each that it may take as JSON: a number takes eight there and two here at least,
/// and the index is no longer than they are.
const COLUMNS: usize = 8;

/// The time between two looks at a task.
const LOOK: Duration = Duration::from_millis(100);

/// Between the deadline of a task, or the wish to stop it, and the end of its worker: a step of a large problem takes
/// seconds.
const OVERRUN: Duration = Duration::from_secs(10);

/// The time in which a worker starts, and in which one that has closed its pipe ends, on a busy machine.
const START: Duration = Duration::from_secs(30);
const END: Duration = Duration::from_secs(5);

/// The last words of a worker that are kept, in bytes.
const LAST_WORDS: usize = 4 << 10;

/// The time of a task, in times that its worker took to start, from which on others go before it: who is replaced afterwards
/// has been at work for several times as long as that takes. Then come, in all, not much more than nine tenths of the processors
/// to those that have just begun (each step of niceness makes a share smaller by a fifth).
pub const FAIR: u32 = 4;
const LOWERED: i32 = 10;

/// Processes that want to run, for each processor, on a crowded machine: a slice lasts no longer than that makes it.
const CROWDED: u32 = 4;

/// Farther away than any deadline.
const EVER: Duration = Duration::from_secs(1 << 30);

/// What a worker is to do.
pub struct Task<'a> {
    /// To solve the document, or only to check it.
    pub solve: bool,
    /// What was posted.
    pub document: &'a [u8],
    /// What it may take.
    pub limits: Limits,
    /// Who watches over it.
    pub watch: &'a Watch<'a>,
    /// Where the columns of a long result are written.
    pub long: &'a mut (dyn Write + Send),
    /// Others go before its worker when it takes long.
    pub yields: bool,
    /// The time that it has before it is looked after, if that is bounded.
    pub slice: Option<Slice<'a>>,
}

/// The first moments of a task.
pub struct Slice<'a> {
    /// The time that its worker runs meanwhile, whatever others have of the processors.
    pub time: Duration,
    /// Called at its end.
    pub over: &'a (dyn Fn() + Sync),
}

/// Whose a task is, and who watches over it.
pub struct Watch<'a> {
    /// For the log of the worker.
    pub origin: &'a Origin,
    /// Brought to where the solve is.
    pub control: &'a Control,
    /// Wakes when the task is to stop.
    pub halted: &'a Notify,
    /// Whether nobody wants what it has come to.
    pub is_unwanted: &'a (dyn Fn() -> bool + Sync),
}

/// What has become of a task.
#[derive(Debug)]
pub enum Finished {
    /// The solve returned.
    Solved(Box<Solved>, Left),
    /// The document is correct; its summary as JSON.
    Checked(Facts, Vec<u8>),
    /// The document has errors, as JSON; or its check was interrupted.
    Refused(Vec<u8>, bool),
    /// The solve would take so many bytes, which are more than it may.
    TooMuchMemory(usize),
    /// The result would be longer than it may be.
    TooLarge,
}

/// The result of a solve.
#[derive(Debug)]
pub enum Left {
    /// A short one, as JSON.
    Text(Vec<u8>),
    /// The columns of a long one have been written where they were to be, and are known by these.
    Columns(Prints),
}

/// A worker at the other end of two pipes.
#[derive(Debug)]
pub struct Link {
    orders: Sender,
    reports: Receiver,
    decoder: Decoder,
    process: Option<Process>,
    /// The number of its process, or zero.
    pub id: u32,
    /// The number of the latest task.
    task: u64,
    /// The limits that hold for it.
    pub confinement: Confinement,
    /// The time in which it was ready. Where nobody wants what a task has come to so far, its worker has as much to stop: to wait
    /// longer would take more than to start another.
    pub started_in: Duration,
    /// It has had a long task, and goes after others since.
    pub is_lowered: bool,
    /// The memory that it held after its latest task.
    pub resident: u64,
}

impl Link {
    /// Takes up a worker that has been started, at that time, as soon as it is ready.
    ///
    /// # Errors
    /// It does not answer, or is of another version.
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

    /// Returns when the worker, which has nothing to do, has died.
    pub async fn closed(&mut self) {
        // What comes is about a task that has ended.
        while self.receive().await.is_ok() {}
    }

    /// Has a task done.
    ///
    /// # Errors
    /// The worker is lost.
    pub async fn perform(&mut self, task: &mut Task<'_>) -> Result<Finished, Loss> {
        let Task { solve, document, limits, watch, long, yields, slice } = task;
        let (solve, limits) = (*solve, *limits);
        self.task += 1;
        let task = self.task;
        let origin = watch.origin.clone();
        let order = if solve { Order::Solve { task, limits, origin } } else { Order::Check { task, limits, origin } };
        let begun = Instant::now();
        let most = limits.wall().unwrap_or(EVER).min(EVER);
        let mut end = begun + most + OVERRUN;
        let (mut taken, mut cancelled, mut looked) = (false, false, false);
        let mut written = 0;
        let (fair, mut lowered) = (begun + self.started_in * FAIR, self.is_lowered || !*yields);
        let before = effort(self.id);
        let mut slice_end = begun + slice.as_ref().map_or(EVER, |slice| slice.time);
        let longest_slice = begun + slice.as_ref().map_or(EVER, |slice| slice.time * CROWDED);
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
                    // A worker that is gone is met below.
                    let _ = self.send(&Order::Cancel { task }, &[]).await;
                }
                report = self.receive() => match report {
                    Ok((report, _)) if report.task().is_some_and(|of| of != task) => {}
                    Ok((Report::Taken { .. }, _)) => taken = true,
                    Ok((Report::Progress { progress, .. }, _)) => {
                        looked = false;
                        progress.relay(watch.control);
                    }
                    Ok((Report::Piece { .. }, bytes)) => {
                        // It has heeded what it was to heed, and is on its way out.
                        end = end.max(Instant::now() + OVERRUN);
                        // The worker keeps to it by itself, unless something is wrong with it.
                        written += bytes.len();
                        if written > limits.result_bytes.saturating_mul(COLUMNS) {
                            return Err(Loss::Died(self.defect("a result beyond its bound").await));
                        }
                        if let Err(error) = long.write_all(&bytes) {
                            return Err(self.not_kept(&error).await);
                        }
                    }
                    Ok((Report::Solved { columns, solved, progress, resident, .. }, bytes)) => {
                        self.resident = resident;
                        progress.relay(watch.control);
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
                () = sleep_until(slice_end) => {
                    let Some(Slice { time, over }) = slice else { continue };
                    let had = effort(self.id).zip(before).map_or(*time, |(now, before)| now.saturating_sub(before));
                    slice_end = (Instant::now() + time.saturating_sub(had)).min(longest_slice);
                    if slice_end <= Instant::now() {
                        over();
                        slice_end = begun + EVER;
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

    /// Lets others go before its worker, for good: nobody but root may raise it again.
    fn lower(&mut self) {
        self.is_lowered = true;
        let group = i32::try_from(self.id).ok().and_then(Pid::from_raw);
        // Where it cannot be lowered, it goes on as it is. All threads of the worker, which is a group of its own.
        let _ = group.map(|group| setpriority_pgrp(Some(group), LOWERED));
    }

    async fn send(&mut self, order: &Order, document: &[u8]) -> io::Result<()> {
        self.orders.write_all(&frame::head(order, document.len())?).await?;
        self.orders.write_all(document).await
    }

    /// The next report. What has come in of one is kept where this is not waited for to the end.
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

    /// A long result could be kept neither on the disk nor in memory.
    async fn not_kept(&mut self, error: &io::Error) -> Loss {
        Loss::Died(self.defect(&format!("a result could not be kept: {error}")).await)
    }

    async fn overrun(&mut self) -> Loss {
        self.end(Process::kill).await;
        Loss::Died(Death::Overran)
    }

    /// Why the worker, which has closed its pipe, died.
    pub async fn death(&mut self) -> Death {
        let death = self.end(Process::death).await;
        death.unwrap_or_else(|| Death::Defect("its thread ended".to_owned()))
    }

    async fn defect(&mut self, message: &str) -> Death {
        // Where it panicked stands on standard error.
        let words = self.end(Process::kill).await.unwrap_or_default();
        Death::Defect(if words.contains(message) { words } else { format!("{message} {words}") })
    }

    /// Sees the process to its end, on a thread that may wait: to give back gigabytes takes a while.
    async fn end<T: Send + 'static>(&mut self, how: impl FnOnce(&mut Process) -> T + Send + 'static) -> Option<T> {
        let mut process = self.process.take()?;
        spawn_blocking(move || how(&mut process)).await.ok()
    }
}

/// The process of a worker, killed when it is dropped.
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

    /// Why it died; it is killed if it has not.
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

    /// Ends it, if it has not ended, and gives its last words.
    fn kill(&mut self) -> String {
        // One that has ended is not there to be killed.
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

/// The time that the threads of a process have run, if the system tells.
fn effort(id: u32) -> Option<Duration> {
    let threads = fs::read_dir(format!("/proc/{id}/task")).ok()?;
    let of_thread = |thread: fs::DirEntry| {
        let told = fs::read_to_string(thread.path().join("schedstat")).ok()?;
        told.split(' ').next()?.parse().ok().map(Duration::from_nanos)
    };
    Some(threads.flatten().filter_map(of_thread).sum())
}

/// Keeps the last that comes.
fn listen(mut stderr: ChildStderr, words: &Mutex<Vec<u8>>) {
    let mut piece = [0; 1024];
    while let Ok(count @ 1..) = stderr.read(&mut piece) {
        let mut words = words.lock().unwrap_or_else(PoisonError::into_inner);
        words.extend_from_slice(&piece[..count]);
        let surplus = words.len().saturating_sub(LAST_WORDS);
        words.drain(..surplus);
    }
}
