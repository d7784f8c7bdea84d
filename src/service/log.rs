//! The log of the process, written by a thread of its own. A log call leaves a line in memory and returns, so that a
//! reader of the log that has stopped reading blocks no other thread. Lines for which there is no room are dropped
//! and counted.
//!
//! Lines that arrive during a write are written together: a busy service makes one system call for many lines.

use std::fmt::{self, Write as _};
use std::io::{self, Write};
use std::mem::{replace, swap};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;
use tracing::field::{Field, Visit};
use tracing_subscriber::field::RecordFields;
use tracing_subscriber::fmt::FormatFields;
use tracing_subscriber::fmt::format::Writer;

/// The size limit of log lines that wait to be written, in bytes: enough for some thousand requests.
const ROOM: usize = 1 << 20;

/// The pause after each write of the log, in which lines gather: waking the thread for every line costs more than
/// writing it. The delay is too short for a reader to notice.
const GATHER: Duration = Duration::from_millis(2);

/// A handle of the log of the service; all its clones write to one output.
#[derive(Clone, Debug)]
pub struct Log(Arc<Shared>);

/// A writer of one log line, which must be written by one call.
#[derive(Debug)]
pub struct Line(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    waiting: Mutex<Waiting>,
    /// Wakes the thread that writes the log.
    arrived: Condvar,
    /// Wakes the threads that wait until all log lines are written.
    written: Condvar,
    lost: AtomicU64,
}

#[derive(Debug, Default)]
struct Waiting {
    lines: Vec<u8>,
    /// Whether the log thread is writing, or pausing afterwards, so that it finds new lines without being woken.
    is_writing: bool,
    is_closed: bool,
}

impl Log {
    /// Starts the log thread, which writes to `output`.
    ///
    /// # Errors
    /// The system provides no thread.
    pub fn start(output: impl Write + Send + 'static) -> io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let writer = Arc::clone(&shared);
        thread::Builder::new().name("dvi-log".to_owned()).spawn(move || writer.write_all(output))?;
        Ok(Self(shared))
    }

    /// Returns a writer for the next line of the log.
    pub fn line(&self) -> Line {
        Line(Arc::clone(&self.0))
    }

    /// The number of log lines dropped because the buffer was full.
    pub fn lost(&self) -> u64 {
        self.0.lost.load(Relaxed)
    }

    /// Closes the log to new lines, and waits until all lines are written, at most for `time`; returns false if some
    /// lines are not written.
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
    /// Writes log lines as they come, until the log is closed and all lines are written.
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
            // Errors are ignored: a closed log output does not stop the service.
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

/// Formats the fields of a log line as `tracing_subscriber` does without colours: the message as it is, the others as
/// `name=value`, control characters escaped. The library's own formatter takes several times as long, since it
/// chooses a style for every name and passes on every character by itself, twice per request.
#[derive(Clone, Copy, Debug, Default)]
pub struct PlainFields;

impl<'w> FormatFields<'w> for PlainFields {
    fn format_fields<R: RecordFields>(&self, writer: Writer<'w>, fields: R) -> fmt::Result {
        let mut line = PlainLine { writer, is_begun: false, result: Ok(()) };
        fields.record(&mut line);
        line.result
    }
}

/// A formatter of the fields of one log line, with the result of the writes so far.
struct PlainLine<'w> {
    writer: Writer<'w>,
    is_begun: bool,
    result: fmt::Result,
}

impl PlainLine<'_> {
    /// Writes a field of the log line as its name and `value`, unless an earlier write has failed.
    fn field(&mut self, field: &Field, value: impl FnOnce(&mut Writer<'_>) -> fmt::Result) {
        if self.result.is_ok() {
            self.result = self.write(field, value);
            self.is_begun = true;
        }
    }

    fn write(&mut self, field: &Field, value: impl FnOnce(&mut Writer<'_>) -> fmt::Result) -> fmt::Result {
        if self.is_begun {
            self.writer.write_char(' ')?;
        }
        if field.name() != "message" {
            self.writer.write_str(field.name())?;
            self.writer.write_char('=')?;
        }
        value(&mut self.writer)
    }
}

impl Visit for PlainLine<'_> {
    fn record_str(&mut self, field: &Field, value: &str) {
        self.field(field, |writer| {
            if field.name() == "message" {
                return Escaped(writer).write_str(value);
            }
            if !value.bytes().all(|byte| is_plain(byte) && byte != b'"' && byte != b'\\') {
                return write!(writer, "{value:?}");
            }
            writer.write_char('"')?;
            writer.write_str(value)?;
            writer.write_char('"')
        });
    }

    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        self.field(field, |writer| write!(Escaped(writer), "{value:?}"));
    }
}

/// A writer that escapes control characters, so that text from clients cannot change the state of a terminal.
struct Escaped<'a, 'w>(&'a mut Writer<'w>);

impl fmt::Write for Escaped<'_, '_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        if text.bytes().all(is_plain) {
            return self.0.write_str(text);
        }
        text.chars().try_for_each(|character| match character {
            '\n' | '\t' => self.0.write_char(character),
            _ if character.is_control() => write!(self.0, "{}", character.escape_default()),
            _ => self.0.write_char(character),
        })
    }
}

/// Whether a byte is a printable ASCII character.
fn is_plain(byte: u8) -> bool {
    matches!(byte, b' '..=b'~')
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
        // The log keeps at most the capacity of its buffer of waiting lines, and as much again in the buffer of the
        // log thread.
        let kept = 10_000 - log.lost();
        assert!((1000..=2100).contains(&kept), "{kept} lines are kept");
        let start = Instant::now();
        assert!(!log.close(Duration::from_millis(50)));
        assert!(start.elapsed() < Duration::from_secs(5));
    }

    #[test]
    fn fields_are_written_as_by_the_library_with_control_characters_escaped() {
        #[derive(Clone, Default)]
        struct Lines(Arc<Mutex<Vec<u8>>>);
        impl Write for Lines {
            fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
                self.0.lock().unwrap().write(bytes)
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let tell = |path: &str| {
            let (status, ms, error) = (200_u16, 0.125, io::Error::other("no \"room\""));
            let _in_span = tracing::info_span!("job", job.id = "7").entered();
            tracing::info!(http.path = path, status, ms, trusted = Some(true), none = None::<u8>, %error, "GET {path}");
        };
        let by = |path: &str, plain: bool| {
            let lines = Lines::default();
            let to = lines.clone();
            let layer = tracing_subscriber::fmt().without_time().with_ansi(false).with_writer(move || to.clone());
            if plain {
                tracing::subscriber::with_default(layer.fmt_fields(PlainFields).finish(), || tell(path));
            } else {
                tracing::subscriber::with_default(layer.finish(), || tell(path));
            }
            String::from_utf8(lines.0.lock().unwrap().clone()).unwrap()
        };
        for path in ["/solve", "/jobs/\"7\"\\", "/caf\u{e9}\ttab"] {
            assert_eq!(by(path, true), by(path, false));
        }
        let escaped = by("/\u{1b}[31m\u{9b}2J\r", true);
        assert!(escaped.contains("GET /\\u{1b}[31m\\u{9b}2J\\r"), "{escaped}");
        assert!(!escaped.contains(|c: char| c.is_control() && c != '\n'), "{escaped:?}");
    }
}
