//! Runs of a parameter sweep: every member is solved and gives one row of a table.
//!
//! The problem is compiled once, and the parameters of a member are bound by number. If the values of a member change
//! the structure (a coefficient that vanishes, an exponent), the problem is compiled anew for that member. Which of
//! the two happens depends on the values of the member alone, as does all else in its row, so that rows are the same
//! for any order of the members and any number of threads.

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

/// Largest number of members of a sweep in a chunk, which one thread solves before it takes the next chunk.
const CHUNK: usize = 256;
/// Smallest number of chunks of members per thread, if there are enough members, so that no thread waits long for the
/// last chunk.
const CHUNKS: usize = 16;
/// Stack size of a thread in bytes: room for the deepest expression that a specification may hold.
const STACK_BYTES: usize = 8 << 20;

/// Solves some members of a sweep and returns their rows.
///
/// The work is shared by `threads` threads. It stops when `control` asks for it, or when the time limit of the
/// sweep's chunk is over; rows that are done are kept.
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
            // The calling thread is one of the threads that solve the members.
            for number in 1..threads.get().min(chunks) {
                let make = || work.make();
                let builder = thread::Builder::new().name(format!("dvi-sweep-{number}")).stack_size(STACK_BYTES);
                // If the system cannot start a thread, the other threads solve its part of the members.
                let _ = builder.spawn_scoped(scope, make);
            }
            work.make();
        });
    }
    let Done { mut table, waiting, .. } = work.done.into_inner().unwrap_or_else(PoisonError::into_inner);
    // The sweep may have been stopped with a chunk of members unsolved: append the rows of the chunks that follow it.
    for part in waiting.into_values() {
        // The tables of the chunks are made from one template and have equal columns, so `append` cannot fail.
        let _ = table.append(part);
    }
    let incomplete = match control.poll() {
        Some(Stop::Deadline) => Incomplete::WALL_TIME,
        Some(Stop::Cancelled) | None => Incomplete::CANCELLED,
    };
    table.into_answer(count, incomplete)
}

/// Merges the tables of parts of a sweep into one answer.
///
/// # Errors
/// The tables are not parts of one sweep, or there are none.
pub fn merge(parts: impl IntoIterator<Item = Table>) -> Result<Solution, Unmergeable> {
    let mut parts = parts.into_iter();
    let mut table = parts.next().ok_or_else(|| Unmergeable("there are no parts".to_owned()))?;
    parts.try_for_each(|part| table.append(part))?;
    table.sort()?;
    let members = usize::try_from(table.members).unwrap_or(usize::MAX);
    Ok(table.into_answer(members, Incomplete::MEMBERS_MISSING))
}

/// The data that the threads of a sweep share.
struct Work<'w> {
    template: &'w Template<'w>,
    /// The time after which no further member of the sweep is started.
    until: Option<Instant>,
    control: &'w Control,
    members: Range<usize>,
    chunk: usize,
    next: AtomicUsize,
    rows: AtomicU64,
    steps: AtomicU64,
    done: Mutex<Done>,
}

/// The rows of finished members of a sweep.
struct Done {
    /// Rows of all chunks of members before the chunk `next`, in the order of the members.
    table: Table,
    next: usize,
    /// Rows of chunks of members that were finished before an earlier chunk, by the number of the chunk.
    waiting: BTreeMap<usize, Table>,
}

impl Done {
    fn take(&mut self, number: usize, rows: Table) {
        self.waiting.insert(number, rows);
        while let Some(rows) = self.waiting.remove(&self.next) {
            // The tables of the chunks are made from one template and have equal columns, so `append` cannot fail.
            let _ = self.table.append(rows);
            self.next += 1;
        }
    }
}

impl Work<'_> {
    /// Solves one chunk of members after the other until no chunk is left, the time limit is over, or the control
    /// asks to stop.
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
