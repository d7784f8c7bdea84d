//! A sweep: every member solved, each a row of one table.
//!
//! The problem is compiled once, and the parameters of a member are bound by number. Where its values change the structure (a
//! coefficient that vanishes, an exponent), it is compiled anew. Which of both happens depends on the values of the member
//! alone, as does all else that is in its row, so that rows are the same in whatever order and by however many threads they are
//! made.

mod features;
mod rows;

pub use features::features;

use problem::{Control, Stop};
use rows::Template;
use solution::{Incomplete, Solution, Table, Unmergeable};
use specification::Specification;
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Instant;

/// The most members of which one thread makes the rows before it looks for others.
const CHUNK: usize = 256;
/// Chunks that each thread has at least, where there are so many members, so that none waits long for the last.
const CHUNKS: usize = 16;
/// Room for the deepest expression that a specification may hold.
const STACK_BYTES: usize = 8 << 20;

/// The rows of some members of a sweep.
///
/// `threads` share the work; it stops when `control` says so, or when the time of its chunk is over, and keeps the rows that are
/// done.
pub fn sweep(
    specification: &Specification,
    members: Range<usize>,
    threads: NonZeroUsize,
    control: &Control,
) -> Solution {
    let template = Template::new(specification, control);
    let count = members.len();
    let chunk = (count / (threads.get() * CHUNKS)).clamp(1, CHUNK);
    let chunks = count.div_ceil(chunk);
    let within = specification.sweep().and_then(|plan| plan.chunk().within);
    let work = Work {
        template: &template,
        until: within.and_then(|within| Instant::now().checked_add(within)),
        control,
        members: members.clone(),
        chunk,
        next: AtomicUsize::new(0),
        rows: AtomicU64::new(0),
        steps: AtomicU64::new(0),
        done: Mutex::new(Done { table: template.empty(), next: 0, waiting: BTreeMap::new() }),
    };
    work.done().table.reserve(count);
    if threads.get() == 1 || chunks <= 1 {
        work.make();
    } else {
        thread::scope(|scope| {
            // The last of them works here.
            for number in 1..threads.get().min(chunks) {
                let make = || work.make();
                let builder = thread::Builder::new().name(format!("dvi-sweep-{number}")).stack_size(STACK_BYTES);
                // Where the system gives no thread, the others do its part.
                let _ = builder.spawn_scoped(scope, make);
            }
            work.make();
        });
    }
    let Done { mut table, waiting, .. } = work.done.into_inner().unwrap_or_else(PoisonError::into_inner);
    // Behind a chunk that was not begun: the sweep was stopped.
    for part in waiting.into_values() {
        // Parts of one template have the same columns.
        let _ = table.append(part);
    }
    let incomplete = match control.poll() {
        Some(Stop::Deadline) => Incomplete::WALL_TIME,
        Some(Stop::Cancelled) | None => Incomplete::CANCELLED,
    };
    table.into_answer(count, incomplete)
}

/// The answer that parts of a sweep give together.
///
/// # Errors
/// They are not parts of one sweep, or there are none.
pub fn merge(parts: impl IntoIterator<Item = Table>) -> Result<Solution, Unmergeable> {
    let mut parts = parts.into_iter();
    let mut table = parts.next().ok_or_else(|| Unmergeable("there are no parts".to_owned()))?;
    parts.try_for_each(|part| table.append(part))?;
    table.sort()?;
    let members = usize::try_from(table.members).unwrap_or(usize::MAX);
    Ok(table.into_answer(members, Incomplete::MEMBERS_MISSING))
}

/// What threads share.
struct Work<'w> {
    template: &'w Template<'w>,
    /// When no further member is begun.
    until: Option<Instant>,
    control: &'w Control,
    members: Range<usize>,
    chunk: usize,
    next: AtomicUsize,
    rows: AtomicU64,
    steps: AtomicU64,
    done: Mutex<Done>,
}

/// Rows that are done.
struct Done {
    /// Those of all chunks before the next one.
    table: Table,
    next: usize,
    /// Those of chunks that were done before their turn.
    waiting: BTreeMap<usize, Table>,
}

impl Done {
    fn take(&mut self, number: usize, rows: Table) {
        self.waiting.insert(number, rows);
        while let Some(rows) = self.waiting.remove(&self.next) {
            // Parts of one template have the same columns.
            let _ = self.table.append(rows);
            self.next += 1;
        }
    }
}

impl Work<'_> {
    /// Makes the rows of one chunk after the other until there are no more, or the control says so.
    fn make(&self) {
        let beside = self.control.beside();
        loop {
            let number = self.next.fetch_add(1, Relaxed);
            let first = self.members.start.saturating_add(number.saturating_mul(self.chunk));
            if first >= self.members.end || self.control.poll().is_some() {
                return;
            }
            let members = first..(first + self.chunk).min(self.members.end);
            let count = members.len();
            let rows = self.template.rows(members, &beside, |steps| {
                let rows = self.rows.fetch_add(1, Relaxed) + 1;
                let steps = self.steps.fetch_add(steps, Relaxed) + steps;
                self.control.report(rows as f64 / self.members.len() as f64, steps);
                self.until.is_none_or(|until| Instant::now() < until)
            });
            let is_over = rows.rows() < count || self.until.is_some_and(|until| Instant::now() >= until);
            self.done().take(number, rows);
            if is_over {
                return;
            }
        }
    }

    fn done(&self) -> MutexGuard<'_, Done> {
        self.done.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
