//! Solves with a limit on the computing time of the solving thread, which does not depend on other work on the
//! machine as the wall-clock time does. If the system does not report computing times, the wall-clock time is used.

use dvi::problem::Control;
use dvi::solution::Solution;
use dvi::specification::{Specification, SpecificationError};
use std::path::Path;
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};
use std::{fs, thread};

/// Interval at which the computing time of a running solve is checked.
const TICK: Duration = Duration::from_millis(20);

/// Factor by which the wall-clock time of a solve may exceed the limit of its computing time.
const CLOCK: u32 = 60;

/// How a solve with a limited computing time has ended.
pub enum Ended {
    Solved(Box<Solution>),
    Refused(Vec<SpecificationError>),
    /// The solve did not return although it was asked to stop.
    Deaf,
}

/// Solves a specification on a thread of its own. After the computing time `allowed` the thread is asked to stop, and
/// after twice that time it is abandoned.
///
/// # Panics
/// If the solve panics.
pub fn solve(specification: &str, allowed: Duration) -> Ended {
    let began = Instant::now();
    let control = Arc::new(Control::with_deadline(began + CLOCK * allowed));
    let (thread, text) = (Arc::clone(&control), specification.to_owned());
    let (starts, started) = mpsc::channel();
    let (ends, ended) = mpsc::channel();
    thread::spawn(move || {
        // Errors of sending to the waiting thread are ignored: the first message, on the start of the solve, always has
        // a receiver; the second, with the result, has none if the run has been abandoned.
        starts.send(fs::read_link("/proc/thread-self").ok()).ok();
        let outcome = match Specification::from_json(text.as_bytes()) {
            Ok(specification) => Ended::Solved(Box::new(dvi::solve(&specification, &thread))),
            Err(errors) => Ended::Refused(errors),
        };
        ends.send(outcome).ok();
    });
    let thread = started.recv().expect("a thread that starts").map(|thread| Path::new("/proc").join(thread));
    loop {
        match ended.recv_timeout(TICK) {
            Ok(outcome) => return outcome,
            Err(mpsc::RecvTimeoutError::Disconnected) => panic!("a solve panicked"),
            Err(mpsc::RecvTimeoutError::Timeout) => {}
        }
        let spent = thread.as_deref().and_then(computed).unwrap_or_else(|| began.elapsed());
        if spent > allowed {
            control.cancel();
        }
        if spent > 2 * allowed || began.elapsed() > 2 * CLOCK * allowed {
            return Ended::Deaf;
        }
    }
}

/// Returns the computing time of a thread so far: the first figure of its file `schedstat` in `/proc`, in nanoseconds.
fn computed(thread: &Path) -> Option<Duration> {
    let figures = fs::read_to_string(thread.join("schedstat")).ok()?;
    figures.split_whitespace().next()?.parse().ok().map(Duration::from_nanos)
}
