//! The chunks of a sweep: consecutive members that one worker solves as one piece of work. The job of the sweep waits in
//! the queue as long as there are members that no worker has; whoever takes it there takes the next chunk, and the job
//! returns to the end of its client's line. So a sweep has the share of one job, and as many workers as are free.
//!
//! A chunk has as many members as its share of what is left (guided self-scheduling: Polychronopoulos and Kuck 1987), and
//! no more than fit in about [`TARGET`]; its worker begins no further member when that time is over, and the members
//! that it has not come to are open again. What is lost in a kill is a chunk at most.
//!
//! A chunk that takes its worker down is divided where it had come to, or in the middle, until it is one member: that
//! member is lost, and has a row that says why. The rows of all other members are what they would be without it, since
//! they depend on the member alone.
//!
//! A chunk of a sweep that several machines share is, where it is solved, a sweep that has no other members open, and that
//! ends with its first rows.

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

/// The time of a chunk: long beside the start of a worker and a write to the disk, and short for clients that wait.
pub const TARGET: Duration = Duration::from_secs(1);

/// A chunk takes at least this part of [`TARGET`] where there are so many members.
const LEAST: f64 = 1.0 / 32.0;

/// The largest number of bytes of the rows of a chunk, and the members of a chunk before the size of a row is known.
const ROW_BYTES: usize = 4 << 20;
const UNMEASURED: usize = 256;

/// The largest number of members that may take their workers down, or outlast the wall-time limit, in one sweep: each
/// costs a worker or all of its time.
const MOST_LOST: usize = 256;

/// A piece of work.
#[derive(Clone, Debug, PartialEq)]
pub struct Chunk {
    /// The members.
    pub members: Range<usize>,
    /// Why the member, a single one, cannot be solved.
    pub lost: Option<Lost>,
}

/// What has become of a chunk.
#[derive(Debug)]
pub enum Solved {
    /// So many of its first members have rows, of so many bytes.
    Rows { rows: usize, steps: u64, bytes: usize },
    /// Its worker was lost after about so many members.
    Lost(Lost, usize),
    /// Its first member outlasted the wall-time limit.
    Late(Lost),
    /// All its members are to have rows that say why.
    SetAside(Lost),
    /// Nothing: it was stopped.
    Nothing,
    /// The sweep cannot go on.
    Broken(Fault),
}

/// How a sweep is to end now.
#[derive(Debug, PartialEq)]
pub enum Settled {
    /// With its table; `None` if all members have rows, or why some have none.
    Table(Option<Incomplete<'static>>),
    /// Without: there is a fault.
    Broken(Fault),
    /// In another process.
    Parked,
}

/// The members of a sweep, and where each stands.
#[derive(Debug)]
pub struct Chunks {
    /// What is known of the sweep.
    pub facts: SweepFacts,
    /// The client dismissed the job while no worker was at it, maybe before this process began.
    is_dismissed: AtomicBool,
    /// This is a chunk of a sweep whose other chunks are elsewhere.
    is_part: bool,
    /// Rows have been added by this process.
    has_progressed: AtomicBool,
    division: Mutex<Division>,
    log: Mutex<RowLog>,
    /// The posted document, from the first chunk on.
    document: Mutex<Option<Arc<[u8]>>>,
}

#[derive(Debug, Default)]
struct Division {
    /// The members that no worker has and that have no row, by the first of each range.
    open: BTreeMap<usize, Open>,
    /// The number of chunks that workers have taken, and the jobs of those that have been begun.
    taken: usize,
    running: Vec<Arc<Job>>,
    rows: usize,
    steps: u64,
    lost: usize,
    /// The seconds that a member took in the last chunk, and the bytes of the widest row.
    pace: Option<f64>,
    width: Option<f64>,
    broken: Option<Fault>,
    /// The job waits in the queue.
    is_queued: bool,
    /// The end is being made, or has been.
    is_settled: bool,
}

#[derive(Debug)]
struct Open {
    end: usize,
    lost: Option<Lost>,
}

impl Chunks {
    /// All members open.
    pub fn new(facts: SweepFacts) -> Self {
        Self::restored(facts, RowLog::default(), false)
    }

    /// The sweep that an earlier process began, with the rows in `log`.
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

    /// A chunk of a sweep whose other chunks are elsewhere.
    pub fn part(facts: SweepFacts, chunk: &Chunk) -> Self {
        let mut division = Division::default();
        division.open(chunk.members.clone(), chunk.lost.clone());
        Self { is_part: true, division: Mutex::new(division), ..Self::new(facts) }
    }

    /// Whether this is a chunk of a sweep whose other chunks are elsewhere.
    pub fn is_part(&self) -> bool {
        self.is_part
    }

    /// Takes the next chunk for one of `workers`; `None` if there is none.
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
        // That of a part was measured where the sweep is divided.
        let count = if self.is_part { end - first } else { count };
        if first + count < end {
            division.open(first + count..end, lost.clone());
        }
        division.taken += 1;
        Some(Chunk { members: first..first + count, lost })
    }

    /// Whether the job is to wait in the queue: there are members for a worker, and it does not wait yet. The caller
    /// then puts it there.
    pub fn queues(&self) -> bool {
        let mut division = self.division();
        let begins = !self.is_part || division.begins_part();
        let queues =
            !division.is_queued && !division.is_over() && !self.is_dismissed() && begins && !division.open.is_empty();
        division.is_queued |= queues;
        queues
    }

    /// Whether there are members that no worker has and that have no row.
    pub fn has_open(&self) -> bool {
        !self.division().open.is_empty()
    }

    /// Counts members as a chunk that another process has taken; returns whether all of them were open.
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

    /// Counts a chunk that has been taken as one that can be asked to stop.
    pub fn begin(&self, chunk: &Arc<Job>) {
        self.division().running.push(Arc::clone(chunk));
    }

    /// Adds the rows of a chunk to the log, in memory.
    pub fn keep(&self, members: Range<usize>, steps: u64, bytes: Vec<u8>) {
        self.log().append(members, steps, bytes);
        self.has_progressed.store(true, Relaxed);
    }

    /// Writes the rows that are in memory to the disk, if there is a `path`.
    pub fn save(&self, path: Option<&Path>) {
        self.log().save(path);
    }

    /// Counts a chunk out, after `time`, which is zero if it was not measured, as what became of it. Its rows are in the log
    /// already.
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
                // The next chunks are small again.
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

    /// Counts members that were lost in another process.
    pub fn lose(&self, members: usize) {
        self.division().lost += members;
    }

    /// The members that have been lost.
    pub fn lost(&self) -> usize {
        self.division().lost
    }

    /// How the sweep is to end, if it is to end now, in the hands of the caller alone. `halted` says why its job was
    /// asked to stop, and `is_late` that the time which its client allows is over.
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

    /// Lets the sweep go on that was to end: its end could not be kept, or rows were damaged, whose members are open again.
    pub fn resume(&self) {
        let damaged = self.log().drop_damaged();
        let mut division = self.division();
        division.is_settled = false;
        for members in damaged {
            division.rows -= members.len();
            division.open(members, None);
        }
    }

    /// Asks all chunks on workers to stop.
    pub fn halt(&self, reason: Halt) {
        let running = self.division().running.clone();
        for chunk in running {
            chunk.halt(reason);
        }
    }

    /// The members that have rows.
    pub fn rows(&self) -> usize {
        self.division().rows
    }

    /// The members that have rows, as a fraction of all, and the accepted steps of their solves.
    pub fn progress(&self) -> (f64, u64) {
        let division = self.division();
        (division.rows as f64 / self.facts.members.max(1) as f64, division.steps)
    }

    /// Whether rows have been added since the process began: an earlier death of the process says nothing any more.
    pub fn has_progressed(&self) -> bool {
        self.has_progressed.load(Relaxed)
    }

    /// Whether the client dismissed the job while no worker was at it.
    pub fn is_dismissed(&self) -> bool {
        self.is_dismissed.load(Relaxed)
    }

    /// Has the sweep end with the rows that it has when it is begun again; returns whether it has any.
    pub fn dismiss(&self) -> bool {
        let has_rows = self.rows() > 0;
        self.is_dismissed.fetch_or(has_rows, Relaxed);
        has_rows
    }

    /// The rows.
    pub fn log(&self) -> MutexGuard<'_, RowLog> {
        self.log.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The posted document, if the first chunk has been begun.
    pub fn document(&self) -> Option<Arc<[u8]>> {
        self.document.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Keeps the posted document for the next chunks, or lets it go.
    pub fn set_document(&self, document: Option<Arc<[u8]>>) {
        *self.document.lock().unwrap_or_else(PoisonError::into_inner) = document;
    }

    fn division(&self) -> MutexGuard<'_, Division> {
        self.division.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Division {
    /// Whether the members of a part, which one worker has at a time, are to be solved: none has a row yet.
    fn begins_part(&self) -> bool {
        self.taken == 0 && self.rows == 0
    }

    /// Whether no further chunk is begun, whatever is open.
    fn is_over(&self) -> bool {
        self.is_settled || self.broken.is_some() || self.lost > MOST_LOST
    }

    fn open(&mut self, members: Range<usize>, lost: Option<Lost>) {
        if !members.is_empty() {
            self.open.insert(members.start, Open { end: members.end, lost });
        }
    }

    /// Takes members out of those that are open.
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

    /// Solves until there is no chunk, with `solve` for each.
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
        // Not before the chunk that a worker has taken.
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
