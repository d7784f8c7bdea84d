//! The chunks of a parameter sweep: a member is the solve for one choice of the parameters, and a chunk is a range of
//! consecutive members that one worker solves as one task. The job of the sweep waits in the queue as long as there
//! are members that no worker has; the worker that takes the job from the queue takes the next chunk, and the job
//! returns to the end of its client's line. So a sweep has the share of one job, and as many workers as are free.
//!
//! A chunk has as many members as its share of those left (guided self-scheduling: Polychronopoulos and Kuck 1987),
//! and no more than fit in about the time [`TARGET`]; its worker begins no further member after that time, and
//! members not begun are open again. A kill of the process loses at most one chunk per worker.
//!
//! A chunk that makes its worker die is divided at the member that the worker had reached, or in the middle, until it
//! is one member: that member is lost, and its row says why. The rows of all other members do not change thereby,
//! since each depends on its member alone.
//!
//! A chunk of a sweep that several machines share is, on the machine that solves it, a sweep that has no other open
//! members and that ends with its first rows.

use super::ended::Fault;
use super::job::{Halt, Job};
use super::row_log::RowLog;
use crate::worker::{Lost, SweepFacts};
use solution::Incomplete;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The target for the duration of a chunk of a sweep: long compared with the start of a worker and a write to the disk,
/// and short for clients that wait.
pub const TARGET: Duration = Duration::from_secs(1);

/// The least duration of a chunk of a sweep as a fraction of [`TARGET`], as long as there are enough members.
const LEAST: f64 = 1.0 / 32.0;

/// The largest size of the rows of a chunk (the results of its members) in bytes, and the number of members of a chunk
/// before the size of a row is known.
const ROW_BYTES: usize = 4 << 20;
const UNMEASURED: usize = 256;

/// The largest number of members of one sweep that may make their workers die, or exceed the wall-clock time limit:
/// each costs a worker or the whole time limit.
const MOST_LOST: usize = 256;

/// A range of members of a parameter sweep, each one solve, that one worker solves as one task.
#[derive(Clone, Debug, PartialEq)]
pub struct Chunk {
    /// The range of members of the sweep that the chunk contains.
    pub members: Range<usize>,
    /// The reason why the only member of the chunk cannot be solved, if so.
    pub lost: Option<Lost>,
}

/// The outcome of a chunk of a sweep.
#[derive(Debug)]
pub enum Solved {
    /// The first members of the chunk have rows: their number, their accepted steps, and the size of the rows in
    /// bytes.
    Rows { rows: usize, steps: u64, bytes: usize },
    /// The worker was lost after it had solved about this number of members of the chunk.
    Lost(Lost, usize),
    /// The first member of the chunk exceeded the wall-clock time limit.
    Late(Lost),
    /// The chunk is not solved: all its members are to get rows with this error.
    SetAside(Lost),
    /// The chunk was stopped before any member was solved.
    Nothing,
    /// A fault that prevents the whole sweep from continuing.
    Broken(Fault),
}

/// The way in which a sweep is to end.
#[derive(Debug, PartialEq)]
pub enum Settled {
    /// The sweep ends with the table of its rows; the value says why some members have no row, and is `None` if all
    /// have one.
    Table(Option<Incomplete<'static>>),
    /// The sweep ends without a table, because of a fault.
    Broken(Fault),
    /// The sweep is set aside, for another process to continue.
    Parked,
}

/// The members of a sweep, with the state of each: open, on a worker, or with a row.
#[derive(Debug)]
pub struct Chunks {
    /// The number of members of the sweep, its time limit, and the size of its rows.
    pub facts: SweepFacts,
    /// Whether the client dismissed the job while no worker was on it, possibly before this process began.
    is_dismissed: AtomicBool,
    /// Whether this is a chunk of a sweep whose other chunks are on other machines.
    is_part: bool,
    /// Whether this process has added rows of solved members to the sweep.
    has_progressed: AtomicBool,
    division: Mutex<Division>,
    log: Mutex<RowLog>,
    /// The posted specification of the sweep, kept from the start of its first chunk on.
    document: Mutex<Option<Arc<[u8]>>>,
}

#[derive(Debug, Default)]
struct Division {
    /// The members without a row that no worker has, by the first member of each range.
    open: BTreeMap<usize, Open>,
    /// The number of chunks that workers have taken, and the jobs of those chunks that have begun.
    taken: usize,
    running: Vec<Arc<Job>>,
    rows: usize,
    steps: u64,
    lost: usize,
    /// The time per member of the sweep in the last chunk, in seconds, and the largest measured size of a row, in
    /// bytes.
    pace: Option<f64>,
    width: Option<f64>,
    broken: Option<Fault>,
    /// Whether the job of the sweep waits in the queue.
    is_queued: bool,
    /// Whether the sweep has ended, or a caller is ending it (makes its table and stores its end).
    is_settled: bool,
}

#[derive(Debug)]
struct Open {
    end: usize,
    lost: Option<Lost>,
}

impl Chunks {
    /// Creates the state of a sweep with all members open (without a row, and on no worker).
    pub fn new(facts: SweepFacts) -> Self {
        Self::restored(facts, RowLog::default(), false)
    }

    /// Restores a sweep that an earlier process began, with the rows in `log`.
    pub fn restored(facts: SweepFacts, log: RowLog, is_dismissed: bool) -> Self {
        let width = (facts.kept > 0).then_some((size_of::<f64>() * facts.kept) as f64);
        let mut division = Division { width, ..Division::default() };
        division.open(0..facts.members, None);
        for record in log.records() {
            division.close(&record.members);
            division.rows += record.members.len();
            division.steps += record.steps;
        }
        Self {
            facts,
            is_dismissed: AtomicBool::new(is_dismissed),
            is_part: false,
            has_progressed: AtomicBool::new(false),
            division: Mutex::new(division),
            log: Mutex::new(log),
            document: Mutex::default(),
        }
    }

    /// Creates the state of a chunk of a sweep whose other chunks are on other machines.
    pub fn part(facts: SweepFacts, chunk: &Chunk) -> Self {
        let mut division = Division::default();
        division.open(chunk.members.clone(), chunk.lost.clone());
        Self { is_part: true, division: Mutex::new(division), ..Self::new(facts) }
    }

    /// Whether this is a chunk of a sweep whose other chunks are on other machines.
    pub fn is_part(&self) -> bool {
        self.is_part
    }

    /// Takes the next chunk of the sweep for one of `workers` workers; returns `None` if there is none.
    pub fn take(&self, workers: usize) -> Option<Chunk> {
        let mut division = self.division();
        division.is_queued = false;
        if division.is_over() || self.is_dismissed() || self.is_part && !division.begins_part() {
            return None;
        }
        let share = division.open.iter().map(|(first, open)| open.end - first).sum::<usize>().div_ceil(2 * workers);
        let (first, Open { end, lost }) = division.open.pop_first()?;
        let within = |seconds: f64| division.pace.map(|pace| (seconds / pace).clamp(1.0, usize::MAX as f64) as usize);
        let target = TARGET.as_secs_f64();
        let fit = division.width.map_or(UNMEASURED, |width| (ROW_BYTES as f64 / width.max(1.0)) as usize);
        let most = within(target).unwrap_or(usize::MAX).min(fit);
        let count = share.max(within(LEAST * target).unwrap_or(1)).min(most).clamp(1, end - first);
        // A chunk of a sweep that machines share is taken whole: the process that divides the sweep has determined
        // its size.
        let count = if self.is_part { end - first } else { count };
        if first + count < end {
            division.open(first + count..end, lost.clone());
        }
        division.taken += 1;
        Some(Chunk { members: first..first + count, lost })
    }

    /// Whether the job of the sweep is to be put in the queue: there are open members, and it is not in the queue
    /// yet. If so, it counts as queued, and the caller must put it there.
    pub fn queues(&self) -> bool {
        let mut division = self.division();
        let begins = !self.is_part || division.begins_part();
        let queues =
            !division.is_queued && !division.is_over() && !self.is_dismissed() && begins && !division.open.is_empty();
        division.is_queued |= queues;
        queues
    }

    /// Whether the sweep has open members, which have no row and are on no worker.
    pub fn has_open(&self) -> bool {
        !self.division().open.is_empty()
    }

    /// Marks `members` as a chunk that another process has taken; returns whether all of them were open.
    pub fn adopt(&self, members: &Range<usize>) -> bool {
        let mut division = self.division();
        let are_open =
            division.open.range(..=members.start).next_back().is_some_and(|(_, open)| members.end <= open.end);
        if are_open {
            division.close(members);
            division.taken += 1;
        }
        are_open
    }

    /// Registers the job of a chunk that a worker has begun, so that it can be asked to stop.
    pub fn begin(&self, chunk: &Arc<Job>) {
        self.division().running.push(Arc::clone(chunk));
    }

    /// Adds the rows of a finished chunk to the log of the sweep, in memory.
    pub fn keep(&self, members: Range<usize>, steps: u64, bytes: Vec<u8>) {
        self.log().append(members, steps, bytes);
        self.has_progressed.store(true, Relaxed);
    }

    /// Writes the rows that are only in memory to the file `path`, if there is one.
    pub fn save(&self, path: Option<&Path>) {
        self.log().save(path);
    }

    /// Records the outcome of a chunk that a worker had taken. `time` is the duration of the chunk, or zero if it was
    /// not measured. The rows of the chunk must be in the log already.
    pub fn end(&self, chunk: &Chunk, job: Option<&Arc<Job>>, solved: &Solved, time: Duration) {
        let mut division = self.division();
        division.taken -= 1;
        if let Some(job) = job {
            division.running.retain(|running| !Arc::ptr_eq(running, job));
        }
        let Range { start, end } = chunk.members;
        match solved {
            Solved::Rows { rows, steps, bytes } => {
                let rows = (*rows).min(end - start);
                division.rows += rows;
                division.steps += steps;
                if chunk.lost.is_none() && rows > 0 && !time.is_zero() {
                    division.pace = Some((time.as_secs_f64() / rows as f64).max(f64::MIN_POSITIVE));
                    let width = *bytes as f64 / rows as f64;
                    division.width = Some(division.width.map_or(width, |widest| widest.max(width)));
                }
                division.open(start + rows..end, chunk.lost.clone());
            }
            Solved::Lost(lost, _) if end - start == 1 => {
                division.lost += 1;
                division.open(start..end, Some(lost.clone()));
            }
            Solved::Lost(_, done) => {
                let done = if (1..end - start).contains(done) { *done } else { (end - start) / 2 };
                division.open(start..start + done, None);
                division.open(start + done..end, None);
                // After the loss of a worker, the next chunks are small again, as the time per member is taken to be
                // long.
                division.pace = Some(time.as_secs_f64().max(TARGET.as_secs_f64()));
            }
            Solved::Late(lost) => {
                division.lost += 1;
                division.open(start..start + 1, Some(lost.clone()));
                division.open(start + 1..end, None);
            }
            Solved::SetAside(lost) => {
                division.lost += 1;
                division.open(start..end, Some(lost.clone()));
            }
            Solved::Nothing => division.open(start..end, chunk.lost.clone()),
            Solved::Broken(fault) => division.broken = Some(*fault),
        }
    }

    /// Counts members of the sweep that were lost in another process: they have no solution, since they made their
    /// worker die or exceeded the time limit.
    pub fn lose(&self, members: usize) {
        self.division().lost += members;
    }

    /// Returns the number of members of the sweep without a solution, because they made their worker die or exceeded
    /// the time limit.
    pub fn lost(&self) -> usize {
        self.division().lost
    }

    /// Decides whether the sweep is to end at this moment, and how; only one caller gets an answer, and must end the
    /// sweep. `halted` says why its job was asked to stop, and `is_late` that the time allowed by its client is over.
    pub fn settle(&self, halted: Option<Halt>, is_late: bool) -> Option<Settled> {
        let mut division = self.division();
        if division.is_settled || division.taken > 0 {
            return None;
        }
        let settled = if let Some(fault) = division.broken {
            Settled::Broken(fault)
        } else if division.open.is_empty() || self.is_part && division.rows > 0 {
            Settled::Table(None)
        } else {
            match halted {
                Some(Halt::Dismiss) => Settled::Table(Some(Incomplete::CANCELLED)),
                Some(Halt::Park) => Settled::Parked,
                Some(Halt::Yield) | None if is_late => Settled::Table(Some(Incomplete::WALL_TIME)),
                Some(Halt::Yield) | None if division.lost > MOST_LOST => Settled::Table(Some(Incomplete::MEMBERS_LOST)),
                Some(Halt::Yield) | None => return None,
            }
        };
        division.is_settled = true;
        Some(settled)
    }

    /// Continues a sweep that was to end: either its end could not be stored, or rows were damaged, whose members are
    /// then open again.
    pub fn resume(&self) {
        let damaged = self.log().drop_damaged();
        let mut division = self.division();
        division.is_settled = false;
        for members in damaged {
            division.rows -= members.len();
            division.open(members, None);
        }
    }

    /// Asks all chunks of the sweep that workers are solving to stop.
    pub fn halt(&self, reason: Halt) {
        let running = self.division().running.clone();
        for chunk in running {
            chunk.halt(reason);
        }
    }

    /// Returns the number of members of the sweep that have rows in the log, which means that they are solved.
    pub fn rows(&self) -> usize {
        self.division().rows
    }

    /// Returns the fraction of all members that have rows, and the total number of accepted steps of their solves.
    pub fn progress(&self) -> (f64, u64) {
        let division = self.division();
        (division.rows as f64 / self.facts.members.max(1) as f64, division.steps)
    }

    /// Whether rows have been added to the sweep since this process began; the death of an earlier process is then no
    /// evidence that the sweep makes processes die.
    pub fn has_progressed(&self) -> bool {
        self.has_progressed.load(Relaxed)
    }

    /// Whether the client dismissed the job of the sweep while no worker had a chunk of it.
    pub fn is_dismissed(&self) -> bool {
        self.is_dismissed.load(Relaxed)
    }

    /// Marks the sweep as dismissed, if it has rows, so that it ends with these rows when a worker takes it next;
    /// returns whether it has rows.
    pub fn dismiss(&self) -> bool {
        let has_rows = self.rows() > 0;
        self.is_dismissed.fetch_or(has_rows, Relaxed);
        has_rows
    }

    /// Locks and returns the log of the rows of the sweep.
    pub fn log(&self) -> MutexGuard<'_, RowLog> {
        self.log.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the posted specification of the sweep, if its first chunk has been begun.
    pub fn document(&self) -> Option<Arc<[u8]>> {
        self.document.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Keeps the posted specification for the next chunks of the sweep, or drops it.
    pub fn set_document(&self, document: Option<Arc<[u8]>>) {
        *self.document.lock().unwrap_or_else(PoisonError::into_inner) = document;
    }

    fn division(&self) -> MutexGuard<'_, Division> {
        self.division.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Division {
    /// Whether the members of this chunk of a sweep that machines share are to be solved: no worker of this process
    /// has the chunk, and no member has a row.
    fn begins_part(&self) -> bool {
        self.taken == 0 && self.rows == 0
    }

    /// Whether no further chunk of the sweep is to be begun, even if it has open members (without a row, and on no
    /// worker).
    fn is_over(&self) -> bool {
        self.is_settled || self.broken.is_some() || self.lost > MOST_LOST
    }

    fn open(&mut self, members: Range<usize>, lost: Option<Lost>) {
        if !members.is_empty() {
            self.open.insert(members.start, Open { end: members.end, lost });
        }
    }

    /// Removes `members` from the open members of the sweep, which have no row and are on no worker.
    fn close(&mut self, members: &Range<usize>) {
        let within: Vec<usize> = self
            .open
            .range(..members.end)
            .filter(|(_, open)| open.end > members.start)
            .map(|(first, _)| *first)
            .collect();
        for first in within {
            let Some(Open { end, .. }) = self.open.remove(&first) else { continue };
            self.open(first..members.start.min(end), None);
            self.open(members.end.max(first)..end, None);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunks(members: usize) -> Chunks {
        Chunks::new(SweepFacts { members, seconds: None, kept: 0 })
    }

    fn rows(rows: usize) -> Solved {
        Solved::Rows { rows, steps: 1, bytes: 50 * rows }
    }

    fn lost() -> Lost {
        Lost { code: "stack_overflow".to_owned(), message: "told".to_owned() }
    }

    /// Takes chunks until there are none, and ends each with the outcome that `solve` returns; returns the number of
    /// chunks.
    fn through(chunks: &Chunks, workers: usize, mut solve: impl FnMut(&Chunk) -> (Solved, Duration)) -> usize {
        for count in 0.. {
            let Some(chunk) = chunks.take(workers) else { return count };
            let (solved, time) = solve(&chunk);
            chunks.end(&chunk, None, &solved, time);
        }
        0
    }

    #[test]
    fn every_member_is_in_one_chunk_and_chunks_take_about_their_time() {
        for (members, seconds, most) in [(12, 1e-5, 3), (1_000_000, 2e-5, 60), (100, 0.3, 60), (40, 20.0, 40)] {
            let sweep = chunks(members);
            let mut seen = vec![0; members];
            let count = through(&sweep, 2, |chunk| {
                assert!(chunk.lost.is_none());
                seen[chunk.members.clone()].iter_mut().for_each(|times| *times += 1);
                (rows(chunk.members.len()), Duration::from_secs_f64(seconds * chunk.members.len() as f64))
            });
            assert!(seen.iter().all(|times| *times == 1) && count <= most, "{count} chunks of {members}");
            assert_eq!((sweep.rows(), sweep.settle(None, false)), (members, Some(Settled::Table(None))));
            assert_eq!(sweep.settle(None, false), None);
        }
    }

    #[test]
    fn a_part_has_its_members_alone_and_ends_with_its_first_rows() {
        let facts = SweepFacts { members: 1000, seconds: None, kept: 0 };
        let part = Chunks::part(facts, &Chunk { members: 100..400, lost: None });
        let whole = part.take(8).unwrap();
        assert_eq!((whole.members.clone(), part.take(8), part.queues()), (100..400, None, false));
        part.end(&whole, None, &Solved::Lost(lost(), 10), TARGET);
        assert!(part.queues() && part.settle(None, false).is_none());
        let first = part.take(8).unwrap();
        assert_eq!(first.members, 100..110);
        part.end(&first, None, &rows(10), TARGET);
        assert_eq!((part.take(8), part.queues(), part.lost()), (None, false, 0));
        assert_eq!(part.settle(None, false), Some(Settled::Table(None)));
    }

    #[test]
    fn chunks_of_another_process_are_not_taken_and_one_set_aside_stays_so() {
        let sweep = chunks(100);
        assert!(sweep.adopt(&(10..20)) && !sweep.adopt(&(15..25)) && !sweep.adopt(&(0..100)));
        sweep.end(&Chunk { members: 10..20, lost: None }, None, &Solved::SetAside(lost()), Duration::ZERO);
        let mut aside = Vec::new();
        through(&sweep, 4, |chunk| {
            aside.extend(chunk.members.clone().filter(|_| chunk.lost.is_some()));
            (rows(chunk.members.len()), TARGET)
        });
        assert!(aside.into_iter().eq(10..20));
        assert_eq!((sweep.rows(), sweep.lost()), (100, 1));
    }

    #[test]
    fn what_a_chunk_did_not_come_to_is_open_again() {
        let sweep = chunks(1000);
        let mut seen = vec![0; 1000];
        through(&sweep, 1, |chunk| {
            let done = chunk.members.len().div_ceil(3);
            seen[chunk.members.start..chunk.members.start + done].iter_mut().for_each(|times| *times += 1);
            (rows(done), Duration::from_millis(1))
        });
        assert!(seen.iter().all(|times| *times == 1));
    }

    #[test]
    fn a_member_that_takes_its_worker_down_is_found_and_told_and_no_other() {
        for bad in [vec![0], vec![999], vec![123, 124, 700]] {
            let sweep = chunks(1000);
            let (mut told, mut deaths) = (Vec::new(), 0);
            through(&sweep, 4, |chunk| {
                let second = Duration::from_secs(1);
                if chunk.lost.is_some() {
                    assert_eq!(chunk.members.len(), 1);
                    told.push(chunk.members.start);
                } else if bad.iter().any(|bad| chunk.members.contains(bad)) {
                    deaths += 1;
                    return (Solved::Lost(lost(), 0), second);
                }
                (rows(chunk.members.len()), second)
            });
            told.sort_unstable();
            assert!(told == bad && deaths <= 10 * bad.len(), "{told:?}, {deaths} deaths");
            assert_eq!(sweep.rows(), 1000);
        }
    }

    #[test]
    fn a_sweep_whose_members_all_take_their_workers_down_ends() {
        let sweep = chunks(100_000);
        let mut deaths = 0;
        through(&sweep, 4, |chunk| match chunk.lost {
            Some(_) => (rows(1), Duration::ZERO),
            None => {
                deaths += 1;
                (Solved::Lost(lost(), 0), Duration::from_secs(1))
            }
        });
        assert!(deaths < 2 * MOST_LOST, "{deaths}");
        assert_eq!(sweep.settle(None, false), Some(Settled::Table(Some(Incomplete::MEMBERS_LOST))));
    }

    #[test]
    fn restored_members_are_closed_and_the_rest_is_open() {
        let mut log = RowLog::default();
        for members in [10..20, 0..5, 95..100, 20..21] {
            log.append(members, 2, Vec::new());
        }
        let sweep = Chunks::restored(SweepFacts { members: 100, seconds: None, kept: 0 }, log, false);
        assert_eq!((sweep.rows(), sweep.progress()), (21, (0.21, 8)));
        let mut seen = Vec::new();
        through(&sweep, 1, |chunk| {
            seen.extend(chunk.members.clone());
            (rows(chunk.members.len()), Duration::from_millis(1))
        });
        assert_eq!(seen, (5..10).chain(21..95).collect::<Vec<_>>());
    }

    #[test]
    fn a_stopped_sweep_ends_as_it_was_asked_to_once_no_chunk_runs() {
        let sweep = chunks(10);
        let chunk = sweep.take(1).unwrap();
        assert!(sweep.queues() && !sweep.queues());
        // The sweep does not end as long as a worker has a chunk of it.
        assert_eq!(sweep.settle(Some(Halt::Dismiss), false), None);
        sweep.end(&chunk, None, &Solved::Nothing, Duration::ZERO);
        assert_eq!(sweep.settle(None, false), None);
        assert_eq!(sweep.settle(Some(Halt::Dismiss), false), Some(Settled::Table(Some(Incomplete::CANCELLED))));
        assert!(sweep.take(1).is_none());
        sweep.resume();
        assert_eq!(sweep.settle(Some(Halt::Park), false), Some(Settled::Parked));
        sweep.resume();
        assert_eq!(sweep.settle(None, true), Some(Settled::Table(Some(Incomplete::WALL_TIME))));
    }
}
