//! Long computations that cannot be interrupted, because the library that makes them does not poll a stop condition:
//! each runs on its own thread, which is abandoned if its result is no longer needed.
//!
//! An abandoned thread occupies its memory until it ends. The number of threads, abandoned ones included, is
//! therefore limited; a computation waits until a thread is free.

use std::num::NonZero;
use std::sync::LazyLock;
use std::sync::atomic::{AtomicUsize, Ordering::AcqRel, Ordering::Relaxed};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread::{self, available_parallelism};
use std::time::Duration;

/// The time between two polls of the stop condition while a factorisation runs on its own thread.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// The limit on the factorisation threads of this process: one thread per core for current factorisations, and another
/// one per core for abandoned ones, whose callers have stopped waiting.
pub static THREADS: LazyLock<Threads> =
    LazyLock::new(|| Threads::new(2 * available_parallelism().map_or(1, NonZero::get)));

/// A limit on the number of factorisation threads, with the number of threads in use.
pub struct Threads {
    most: usize,
    taken: AtomicUsize,
}

impl Threads {
    /// Creates a limit of at most `most` threads at a time.
    pub const fn new(most: usize) -> Self {
        Self { most, taken: AtomicUsize::new(0) }
    }

    /// Returns the result of `work`, computed on its own thread; `None` if the system has no thread left, or if `stop`,
    /// which is polled several times a second, returns true before `work` is done.
    pub fn compute<T: Send + 'static>(
        &'static self,
        work: impl FnOnce() -> T + Send + 'static,
        stop: impl Fn() -> bool,
    ) -> Option<T> {
        let place = self.place(&stop)?;
        let (done, result) = channel();
        let computing = move || {
            let computed = work();
            drop(place);
            // Sending fails if the caller has stopped waiting for the result, which is harmless.
            let _ = done.send(computed);
        };
        thread::Builder::new().name("dvi-factors".to_owned()).spawn(computing).ok()?;
        while !stop() {
            match result.recv_timeout(POLL_INTERVAL) {
                Ok(computed) => return Some(computed),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        None
    }

    /// Waits until the limit admits another thread; returns `None` once `stop` returns true.
    fn place(&'static self, stop: impl Fn() -> bool) -> Option<Taken> {
        let one_more = |taken| (taken < self.most).then_some(taken + 1);
        while self.taken.fetch_update(AcqRel, Relaxed, one_more).is_err() {
            if stop() {
                return None;
            }
            thread::sleep(POLL_INTERVAL);
        }
        Some(Taken(self))
    }
}

/// A thread counted towards the limit, released when the thread ends, also by a panic.
struct Taken(&'static Threads);

impl Drop for Taken {
    fn drop(&mut self) {
        self.0.taken.fetch_sub(1, AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn abandoned_work_keeps_its_place_until_it_ends() {
        static ONE: Threads = Threads::new(1);
        let (release, released) = channel::<()>();
        assert_eq!(ONE.compute(|| 1, || false), Some(1));
        let abandoned = ONE.compute(move || released.recv().is_ok(), || true);
        assert_eq!(abandoned, None);
        // The thread abandoned by its caller still counts towards the limit: no other is admitted, and a caller that is
        // stopped does not wait.
        assert_eq!(ONE.compute(|| 2, || true), None);
        assert_eq!(ONE.taken.load(Relaxed), 1);
        release.send(()).expect("a thread that waits");
        assert_eq!(ONE.compute(|| 3, || false), Some(3));
        assert_eq!(ONE.taken.load(Relaxed), 0);
    }

    #[test]
    fn work_that_panics_gives_its_place_back() {
        static ONE: Threads = Threads::new(1);
        assert_eq!(ONE.compute(|| -> u8 { panic!("on purpose") }, || false), None);
        assert_eq!(ONE.compute(|| 1, || false), Some(1));
    }
}
