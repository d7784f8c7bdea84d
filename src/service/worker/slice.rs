//! The first time slice of a task, which begins with the worker's report that the solve has begun.
//!
//! The time before that report (sending the order, reading the specification) is not part of the slice: on a busy
//! machine the slice would be over before the solve has begun, and the job would be stopped without having run. That
//! time is limited all the same: a specification that takes as much CPU time to read as a slice lasts ends the slice,
//! and a worker that never reports is killed at the deadline of its task.

use std::fs;
use std::future::pending;
use std::time::Duration;
use tokio::time::{Instant, sleep_until};

/// The limit of the elapsed time of a first time slice, as a multiple of its CPU time. On a machine with more
/// runnable processes per processor than this, a slice gets less CPU time.
const CROWDED: u32 = 4;

/// The first time slice of a task of a worker, after which the task may have to yield the worker.
pub struct Slice<'a> {
    /// The CPU time that the first time slice lasts.
    pub time: Duration,
    /// Function to call when the first time slice of the task is over.
    pub over: &'a (dyn Fn() + Sync),
}

/// A clock that measures the first time slice of a worker's task.
#[derive(Debug)]
pub(super) struct SliceClock {
    /// The process id of the worker that performs the task.
    worker: u32,
    /// The CPU time of the first time slice; `None` if the task has no slice, or if the slice is over.
    time: Option<Duration>,
    /// The CPU time that the worker had used when the specification was sent, or when the solve began, if the system
    /// reports it.
    before: Option<Duration>,
    /// The time at which the worker reported that the solve had begun.
    solving_since: Option<Instant>,
    /// The time of the next check whether the time slice is over; `None` if a report of the worker must come first.
    next: Option<Instant>,
}

impl SliceClock {
    /// Creates the clock of a first time slice of `time`, if the task has a slice, for a specification that is about to
    /// be sent to `worker`.
    pub fn new(time: Option<Duration>, worker: u32) -> Self {
        let next = time.map(|time| Instant::now() + time);
        Self { worker, time, before: effort(worker), solving_since: None, next }
    }

    /// Begins the first time slice, when the worker has reported that the solve has begun.
    pub fn begin(&mut self) {
        let now = Instant::now();
        self.solving_since = Some(now);
        self.before = effort(self.worker);
        self.next = self.time.map(|time| now + time);
    }

    /// Waits until the next time at which the first time slice of the task may be over.
    pub async fn rings(&self) {
        match self.next {
            Some(next) => sleep_until(next).await,
            None => pending().await,
        }
    }

    /// Whether the first time slice of the task is over; true is returned only once.
    pub fn is_over(&mut self) -> bool {
        let Some(time) = self.time else { return false };
        let now = Instant::now();
        let had = effort(self.worker).zip(self.before).map(|(now, before)| now.saturating_sub(before));
        let earliest = had.map(|had| now + time.saturating_sub(had));
        self.next = match self.solving_since {
            // If the system reports no CPU time of the worker, the elapsed time counts as the time of the time slice.
            Some(since) => Some(earliest.unwrap_or(now).min(since + time * CROWDED)),
            None => earliest,
        };
        let is_over = self.next.is_some_and(|next| next <= now);
        if is_over {
            (self.time, self.next) = (None, None);
        }
        is_over
    }
}

/// Returns the CPU time of all threads of a process, if the system reports it.
fn effort(id: u32) -> Option<Duration> {
    let threads = fs::read_dir(format!("/proc/{id}/task")).ok()?;
    let of_thread = |thread: fs::DirEntry| {
        let told = fs::read_to_string(thread.path().join("schedstat")).ok()?;
        told.split(' ').next()?.parse().ok().map(Duration::from_nanos)
    };
    Some(threads.flatten().filter_map(of_thread).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::{Child, Command};
    use std::thread::sleep;

    const TIME: Duration = Duration::from_millis(200);

    /// A process that stands for a worker, killed at the end of the test.
    struct Worker(Child);

    impl Worker {
        fn start(program: &str, arguments: &[&str]) -> Self {
            Self(Command::new(program).args(arguments).spawn().unwrap())
        }
    }

    impl Drop for Worker {
        fn drop(&mut self) {
            self.0.kill().unwrap();
            self.0.wait().unwrap();
        }
    }

    #[test]
    fn a_slice_begins_with_the_solve_and_is_over_once() {
        // A sleeping process, which uses no CPU time, stands for the worker.
        let worker = Worker::start("sleep", &["60"]);
        let mut clock = SliceClock::new(Some(TIME), worker.0.id());
        sleep((CROWDED + 1) * TIME);
        assert!(!clock.is_over(), "the solve has not begun");
        clock.begin();
        assert!(!clock.is_over());
        sleep((CROWDED + 1) * TIME);
        assert!(clock.is_over());
        assert!(!clock.is_over());
        clock.begin();
        assert!(!clock.is_over());
    }

    #[test]
    fn a_document_that_takes_long_to_read_ends_the_slice() {
        let worker = Worker::start("sh", &["-c", "while :; do :; done"]);
        let mut clock = SliceClock::new(Some(TIME), worker.0.id());
        let start = Instant::now();
        while !clock.is_over() {
            assert!(start.elapsed() < 100 * TIME, "reading is not bounded");
            sleep(TIME / 10);
        }
    }

    #[test]
    fn a_worker_without_a_process_is_measured_by_elapsed_time_from_the_solve_on() {
        let mut clock = SliceClock::new(Some(TIME), 0);
        sleep(2 * TIME);
        assert!(!clock.is_over());
        clock.begin();
        sleep(2 * TIME);
        assert!(clock.is_over());
    }
}
