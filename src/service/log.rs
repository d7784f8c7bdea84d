//! The log of the process, written by a thread of its own. Whoever logs leaves a line in memory and goes on: a reader that has
//! stopped reading holds up nothing. Lines for which there is no room are lost, and counted.
//!
//! What has come while the thread wrote goes out in one piece, so that a busy service makes one system call for many lines.

use std::io::{self, Write};
use std::mem::{replace, swap};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// The bytes of lines that may wait: some thousand requests.
const ROOM: usize = 1 << 20;

/// The pause after each piece, in which the next gathers: to wake the thread for every line costs more than the line. Nobody who
/// reads a log as it is written notices.
const GATHER: Duration = Duration::from_millis(2);

/// A log; its clones write to the same output.
#[derive(Clone, Debug)]
pub struct Log(Arc<Shared>);

/// One line on its way to the log, given in one piece.
#[derive(Debug)]
pub struct Line(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    waiting: Mutex<Waiting>,
    /// Wakes the thread.
    arrived: Condvar,
    /// Wakes whoever waits for the end.
    written: Condvar,
    lost: AtomicU64,
}

#[derive(Debug, Default)]
struct Waiting {
    lines: Vec<u8>,
    /// The thread is at the output, or pauses after it, and looks for more by itself.
    is_writing: bool,
    is_closed: bool,
}

impl Log {
    /// Starts the thread that writes to `output`.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn start(output: impl Write + Send + 'static) -> io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let writer = Arc::clone(&shared);
        thread::Builder::new().name("dvi-log".to_owned()).spawn(move || writer.write_all(output))?;
        Ok(Self(shared))
    }

    /// The next line.
    pub fn line(&self) -> Line {
        Line(Arc::clone(&self.0))
    }

    /// Lines that were lost for want of room.
    pub fn lost(&self) -> u64 {
        self.0.lost.load(Relaxed)
    }

    /// Takes no more lines, and waits until those it has are written, at most for `time`. False if some are not.
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
    /// Writes what comes, until the log is closed and empty.
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
            // A log that nobody reads any more is no reason to stop.
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
        // What waits, and at most as much again that the thread has in hand.
        let kept = 10_000 - log.lost();
        assert!((1000..=2100).contains(&kept), "{kept} lines are kept");
        let start = Instant::now();
        assert!(!log.close(Duration::from_millis(50)));
        assert!(start.elapsed() < Duration::from_secs(5));
    }
}
