//! Work that takes long and cannot be interrupted, since the library that does it does not look up: done on a thread of
//! its own, which is left to itself once nobody wants the result any more.
//!
//! Such a thread goes on with its memory until it has ended. So there are only so many, the abandoned ones among them; who
//! comes when all are taken waits until one has ended.

use std::num::NonZero;
use std::sync::LazyLock;
use std::sync::atomic::{AtomicUsize, Ordering::AcqRel, Ordering::Relaxed};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread::{self, available_parallelism};
use std::time::Duration;

/// The time between two looks at whether to go on.
const GLANCE: Duration = Duration::from_millis(20);

/// Those of the process: one a core for work that is waited for, and as many that were abandoned.
pub static THREADS: LazyLock<Threads> =
    LazyLock::new(|| Threads::new(2 * available_parallelism().map_or(1, NonZero::get)));

/// How many threads there may be, and how many there are.
pub struct Threads {
    most: usize,
    taken: AtomicUsize,
}

impl Threads {
    /// At most so many.
    pub const fn new(most: usize) -> Self {
        Self { most, taken: AtomicUsize::new(0) }
    }

    /// What `work` computes; nothing if `stop` says so before it is done, which is asked a few times a second, or if the
    /// system has no thread.
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
            // Where nobody waits any more there is nobody to tell.
            let _ = done.send(computed);
        };
        thread::Builder::new().name("dvi-factors".to_owned()).spawn(computing).ok()?;
        while !stop() {
            match result.recv_timeout(GLANCE) {
                Ok(computed) => return Some(computed),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        None
    }

    /// Waits for a place until `stop` says so.
    fn place(&'static self, stop: impl Fn() -> bool) -> Option<Taken> {
        let one_more = |taken| (taken < self.most).then_some(taken + 1);
        while self.taken.fetch_update(AcqRel, Relaxed, one_more).is_err() {
            if stop() {
                return None;
            }
            thread::sleep(GLANCE);
        }
        Some(Taken(self))
    }
}

/// A place, given back when its thread ends, in a panic too.
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
        // Its thread is still there: nobody else is let in, and who is stopped waits no longer.
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
