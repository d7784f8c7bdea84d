//! The log of the process, written by a thread of its own. A log call leaves a line in memory and returns: a reader of
//! the log that has stopped reading blocks nothing. Lines for which there is no room are lost, and counted.
//!
//! The lines that arrive during a write are written together, so that a busy service makes one system call for many
//! lines.

use std::io::{self, Write};
use std::mem::{replace, swap};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// The room for waiting lines, in bytes: enough for some thousand requests.
const ROOM: usize = 1 << 20;

/// The pause after each write, in which lines gather: to wake the thread for every line costs more than the line. The
/// delay is too short for a reader to notice.
const GATHER: Duration = Duration::from_millis(2);

/// A handle of the log; clones write to the same output.
#[derive(Clone, Debug)]
pub struct Log(Arc<Shared>);

/// A writer of one line, which must be written by one call.
#[derive(Debug)]
pub struct Line(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    waiting: Mutex<Waiting>,
    /// Wakes the writer thread.
    arrived: Condvar,
    /// Wakes those who wait until all lines are written.
    written: Condvar,
    lost: AtomicU64,
}

#[derive(Debug, Default)]
struct Waiting {
    lines: Vec<u8>,
    /// The thread is writing, or pauses afterwards, and will look for more lines without being woken.
    is_writing: bool,
    is_closed: bool,
}

impl Log {
    /// Starts the thread that writes to `output`.
    ///
    /// # Errors
    /// The system provides no thread.
    pub fn start(output: impl Write + Send + 'static) -> io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let writer = Arc::clone(&shared);
        thread::Builder::new().name("dvi-log".to_owned()).spawn(move || writer.write_all(output))?;
        Ok(Self(shared))
    }

    /// A writer for the next line.
    pub fn line(&self) -> Line {
        Line(Arc::clone(&self.0))
    }

    /// The number of lines lost for want of room.
    pub fn lost(&self) -> u64 {
        self.0.lost.load(Relaxed)
    }

    /// Accepts no more lines, and waits until all are written, at most for `time`; returns false if some are not.
    pub fn close(&self, time: Duration) -> bool {
        let mut waiting = self.0.waiting();
        waiting.is_closed = true;
        self.0.arrived.notify_one();
        let is_behind = |waiting: &mut Waiting| waiting.is_writing || !waiting.lines.is_empty();
        let ended = self.0.written.wait_timeout_while(waiting, time, is_behind);
        !ended.unwrap_or_else(PoisonError::into_inner).1.timed_out()
    }
}

impl Write for Line {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        let mut waiting = self.0.waiting();
        if waiting.is_closed || waiting.lines.len() + line.len() > ROOM {
            self.0.lost.fetch_add(1, Relaxed);
            return Ok(line.len());
        }
        let is_first = waiting.lines.is_empty() && !waiting.is_writing;
        waiting.lines.extend_from_slice(line);
        drop(waiting);
        if is_first {
            self.0.arrived.notify_one();
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Shared {
    /// Writes lines as they come, until the log is closed and empty.
    fn write_all(&self, mut output: impl Write) {
        let (mut piece, mut told) = (Vec::new(), 0);
        loop {
            let mut waiting = self.waiting();
            waiting.is_writing = false;
            if waiting.lines.is_empty() {
                self.written.notify_all();
                if waiting.is_closed {
                    return;
                }
                let empty = |waiting: &mut Waiting| waiting.lines.is_empty() && !waiting.is_closed;
                waiting = self.arrived.wait_while(waiting, empty).unwrap_or_else(PoisonError::into_inner);
            }
            waiting.is_writing = true;
            swap(&mut piece, &mut waiting.lines);
            drop(waiting);
            // A closed output does not stop the service.
            let _ = output.write_all(&piece).and_then(|()| output.flush());
            piece.clear();
            thread::sleep(GATHER);
            let lost = self.lost.load(Relaxed);
            if lost > told {
                let since = lost - replace(&mut told, lost);
                tracing::warn!(lost, "{since} lines of the log were lost: they came faster than they were read");
            }
        }
    }

    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{BufRead, BufReader};
    use std::time::Instant;

    #[test]
    fn lines_come_whole_and_in_their_order() {
        let (reader, writer) = io::pipe().unwrap();
        let log = Log::start(writer).unwrap();
        let reading = thread::spawn(move || BufReader::new(reader).lines().map(Result::unwrap).collect::<Vec<_>>());
        let threads: Vec<_> = (0..4)
            .map(|thread| {
                let log = log.clone();
                let write = move |k| log.line().write_all(format!("{thread} {k}\n").as_bytes()).unwrap();
                thread::spawn(move || (0..1000).for_each(write))
            })
            .collect();
        threads.into_iter().for_each(|thread| thread.join().unwrap());
        assert!(log.close(Duration::from_secs(20)));
        let lines = reading.join().unwrap();
        assert_eq!(log.lost(), 0);
        for thread in 0..4 {
            let name = format!("{thread} ");
            let of_thread: Vec<_> = lines.iter().filter_map(|line| line.strip_prefix(&name)).collect();
            assert_eq!(of_thread, (0..1000).map(|k| k.to_string()).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_reader_that_does_not_read_holds_up_nobody() {
        let (_reader, writer) = io::pipe().unwrap();
        let log = Log::start(writer).unwrap();
        let (start, line) = (Instant::now(), [b'x'; 1000]);
        for _ in 0..10_000 {
            assert_eq!(log.line().write(&line).unwrap(), line.len());
        }
        assert!(start.elapsed() < Duration::from_secs(5), "{:?}", start.elapsed());
        // The waiting lines, and at most as much again in the buffer of the thread.
        let kept = 10_000 - log.lost();
        assert!((1000..=2100).contains(&kept), "{kept} lines are kept");
        let start = Instant::now();
        assert!(!log.close(Duration::from_millis(50)));
        assert!(start.elapsed() < Duration::from_secs(5));
    }
}
