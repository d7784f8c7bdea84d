//! The worker's side of the link to the front process: one thread takes orders and answers requests for progress at
//! once, another one solves. The solver thread has a stack of fixed size, independent of the limits of the shell that
//! started the service.

use super::frame;
use super::message::{Facts, Limits, Lost, Members, Order, Origin, Prints, Progress, Report, Solved, VERSION};
use super::{Confinement, confinement};
use crate::digest::Fingerprint;
use crate::jobs::{Encoded, TooLarge};
use problem::Control;
use solution::Solution;
use solution::columnar::write_columns;
use specification::{Specification, SweepChunk};
use std::any::Any;
use std::io::{self, BufWriter, Read, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// The time limit of a part of a sweep (a range of its members) is at least this multiple of the time that it takes
/// to read the specification.
const BEGINNING: u32 = 8;

/// The function that solves a specification, called by worker processes, and by the front process for inline solves.
pub type Solver = Arc<dyn Fn(&Specification, &Control) -> Solution + Send + Sync>;

/// The stack size of the solver thread, in bytes: enough for the deepest expression that a specification may contain.
pub(super) const STACK_BYTES: usize = 8 << 20;

/// The size of the pieces in which a long result is sent, in bytes.
const PIECE: usize = 256 << 10;

/// Takes orders from `input` until it ends, and writes reports to `output`. A task that is still running at the end
/// of `input` is stopped.
///
/// # Errors
/// I/O errors of `input` and `output`, invalid input, or the system provides no thread.
pub fn serve(
    mut input: impl Read,
    output: impl Write + Send + 'static,
    solver: Solver,
    confinement: Confinement,
) -> io::Result<()> {
    let desk = Arc::new(Desk { output: Mutex::new(output), task: Mutex::default() });
    desk.report(&Report::Ready { version: VERSION, confinement }, &[])?;
    let (assign, assigned) = channel();
    let solving = Arc::clone(&desk);
    thread::Builder::new()
        .name("dvi-solver".to_owned())
        .stack_size(STACK_BYTES)
        .spawn(move || solve_all(&*solving, &solver, &assigned))?;
    let heard = desk.hear(&mut input, &assign);
    desk.abandon();
    heard
}

/// The state of a worker that is shared by the thread that takes orders and the thread that solves.
struct Desk<W> {
    output: Mutex<W>,
    task: Mutex<Option<Task>>,
}

/// The task that the worker is performing.
struct Task {
    number: u64,
    control: Arc<Control>,
    /// The number of events of the trajectory that have been reported.
    told: u64,
}

/// A specification document on its way from the thread that takes orders to the solver thread.
struct Assignment {
    task: u64,
    limits: Limits,
    origin: Origin,
    document: Vec<u8>,
    /// Whether to solve the document; otherwise it is only checked.
    solve: bool,
    /// The members of the sweep to solve, if the task is a part of a sweep.
    members: Option<Members>,
    control: Arc<Control>,
    begun: Instant,
}

impl<W: Write> Desk<W> {
    /// Takes the orders of the front process until their stream ends, and assigns solves and checks to the solver
    /// thread.
    fn hear(&self, input: &mut impl Read, assign: &Sender<Assignment>) -> io::Result<()> {
        while let Some((order, document)) = frame::read(input)? {
            match order {
                Order::Solve { task, limits, origin, members } => {
                    let assignment = self.begin(task, limits, origin, document)?;
                    assign.send(Assignment { solve: true, members, ..assignment }).map_err(io::Error::other)?;
                }
                Order::Check { task, limits, origin } => {
                    assign.send(self.begin(task, limits, origin, document)?).map_err(io::Error::other)?;
                }
                Order::Look { task } => {
                    if let Some(progress) = self.progress(task) {
                        self.report(&Report::Progress { task, progress }, &[])?;
                    }
                }
                Order::Cancel { task } => self.cancel(task),
            }
        }
        Ok(())
    }

    fn report(&self, report: &Report, bytes: &[u8]) -> io::Result<()> {
        frame::write(&mut *self.output.lock().unwrap_or_else(PoisonError::into_inner), report, bytes)
    }

    /// Begins a task of the worker with a specification document, reports the receipt of the document, and returns
    /// the assignment for the solver thread, as a check of the document.
    fn begin(&self, task: u64, limits: Limits, origin: Origin, document: Vec<u8>) -> io::Result<Assignment> {
        let begun = Instant::now();
        let control = Arc::new(within(begun, limits.wall()));
        *self.task() = Some(Task { number: task, control: Arc::clone(&control), told: 0 });
        self.report(&Report::Taken { task }, &[])?;
        Ok(Assignment { task, limits, origin, document, solve: false, members: None, control, begun })
    }

    /// Begins the solve of a task: `control` replaces the control of the check that comes before a solve, and is
    /// cancelled if the check was cancelled.
    fn begin_solve(&self, number: u64, control: &Arc<Control>) -> io::Result<()> {
        if let Some(task) = &mut *self.task() {
            if task.control.poll().is_some() {
                control.cancel();
            }
            task.control = Arc::clone(control);
        }
        self.report(&Report::Begun { task: number }, &[])
    }

    fn progress(&self, number: u64) -> Option<Progress> {
        let mut task = self.task();
        let task = task.as_mut().filter(|task| task.number == number)?;
        let progress = Progress::of(&task.control, task.told);
        task.told = progress.events.last().map_or(task.told, |(number, _)| *number);
        Some(progress)
    }

    fn cancel(&self, number: u64) {
        if let Some(task) = self.task().as_ref().filter(|task| task.number == number) {
            task.control.cancel();
        }
    }

    fn abandon(&self) {
        if let Some(task) = &*self.task() {
            task.control.cancel();
        }
    }

    fn task(&self) -> MutexGuard<'_, Option<Task>> {
        self.task.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn within(begun: Instant, time: Option<Duration>) -> Control {
    match time.and_then(|time| begun.checked_add(time)) {
        Some(deadline) => Control::with_deadline(deadline),
        None => Control::new(),
    }
}

/// Performs the assignments to the solver thread until there are no more, or until a panic, after which the state of
/// the process is not trusted.
fn solve_all<W: Write>(desk: &Desk<W>, solver: &Solver, assigned: &Receiver<Assignment>) {
    for assignment in assigned {
        let task = assignment.task;
        let span = assignment.origin.span();
        let done = span.in_scope(|| catch_unwind(AssertUnwindSafe(|| work(desk, solver, assignment))));
        let told = match done {
            Ok(told) => told,
            Err(panic) => {
                let message = message(&*panic).to_owned();
                desk.report(&Report::Defect { task, message }, &[]).and(Err(io::ErrorKind::Other.into()))
            }
        };
        if told.is_err() {
            return;
        }
    }
}

fn work<W: Write>(desk: &Desk<W>, solver: &Solver, assignment: Assignment) -> io::Result<()> {
    let Assignment { task, limits, document, solve, members, control, begun, .. } = assignment;
    let specification = match limits.read(&document, &control) {
        Ok(specification) => specification,
        Err(errors) => {
            let interrupted = control.poll().is_some();
            return desk.report(&Report::Refused { task, interrupted }, &serde_json::to_vec(&errors)?);
        }
    };
    drop(document);
    if !solve {
        let (facts, resident) = (Facts::of(&specification), confinement::resident());
        let summary = serde_json::to_vec(&specification.summary())?;
        return desk.report(&Report::Checked { task, facts, resident }, &summary);
    }
    if members.is_some() && specification.sweep().is_none() {
        // The front process (which serves HTTP) never asks for a part of a specification that is not a sweep.
        return desk.report(&Report::Refused { task, interrupted: false }, b"[]");
    }
    // The time to read the specification is to be a small fraction of the time of a part of a sweep.
    let least = BEGINNING * begun.elapsed();
    let is_part = members.is_some();
    let specification = match members {
        Some(members) => specification.with_chunk(chunk(members, least)),
        None => specification,
    };
    let estimate = specification.memory_bytes();
    if estimate > limits.memory {
        return desk.report(&Report::TooMuchMemory { task, estimate }, &[]);
    }
    if is_part {
        return solve_members(desk, solver, specification, (task, limits, begun));
    }
    let asked = specification.wall_seconds().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    let control = Arc::new(within(begun, asked.into_iter().chain(limits.wall()).min()));
    desk.begin_solve(task, &control)?;
    let solution = solver(&specification, &control);
    let encoded = match Encoded::of(&solution, limits.result_bytes) {
        Ok(encoded) => encoded,
        Err(TooLarge) => return desk.report(&Report::TooLarge { task }, &[]),
    };
    let (columns, rest) = match encoded {
        Encoded::Text(json) => (None, json),
        Encoded::Columns(json, skeleton) => {
            let mut pieces = BufWriter::with_capacity(PIECE, Pieces { desk, task });
            let (trajectory, table) = (&solution.trajectory, solution.table.as_ref());
            let index = Fingerprint::of(&write_columns(trajectory, table, &skeleton, &mut pieces)?);
            // The last bytes of the results, which remain in the buffer, are sent with the final report.
            (Some(Prints { json, index }), pieces.into_parts().1.map_err(io::Error::other)?)
        }
    };
    let solved = Box::new(Solved::of(specification.problem(), &solution));
    let progress = desk.progress(task).unwrap_or_default();
    drop((solution, specification));
    let resident = confinement::resident();
    desk.report(&Report::Solved { task, columns, rows: None, solved, progress, resident }, &rest)
}

/// Converts an order to solve a part of a sweep (a range of its members); the time limit of the part is at least
/// `least`.
fn chunk(members: Members, least: Duration) -> SweepChunk {
    let Members { first, end, lost, seconds } = members;
    let within = Duration::try_from_secs_f64(seconds).unwrap_or_default().max(least);
    SweepChunk { members: first..end, lost: lost.map(|Lost { code, message }| (code, message)), within: Some(within) }
}

/// Solves a part of a sweep (a range of its members), and sends the rows of its members. The wall-clock time that the
/// client allows is that of the whole sweep, which the front process enforces.
fn solve_members<W: Write>(
    desk: &Desk<W>,
    solver: &Solver,
    specification: Specification,
    (task, limits, begun): (u64, Limits, Instant),
) -> io::Result<()> {
    let control = Arc::new(within(begun, limits.wall()));
    desk.begin_solve(task, &control)?;
    let solution = solver(&specification, &control);
    let solved = Box::new(Solved::of(specification.problem(), &solution));
    let Some(table) = solution.table else {
        let message = "a sweep without a table".to_owned();
        return desk.report(&Report::Defect { task, message }, &[]);
    };
    let (rows, bytes) = (Some(table.rows()), table.to_bytes()?);
    let progress = desk.progress(task).unwrap_or_default();
    drop((table, specification));
    let resident = confinement::resident();
    desk.report(&Report::Solved { task, columns: None, rows, solved, progress, resident }, &bytes)
}

/// A writer that sends a long result to the front process in pieces.
struct Pieces<'a, W> {
    desk: &'a Desk<W>,
    task: u64,
}

impl<W: Write> Write for Pieces<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.desk.report(&Report::Piece { task: self.task }, bytes)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Returns the message of a panic of the solver.
fn message(panic: &(dyn Any + Send)) -> &str {
    match (panic.downcast_ref::<&str>(), panic.downcast_ref::<String>()) {
        (Some(text), _) => text,
        (None, Some(text)) => text,
        (None, None) => "no message",
    }
}
