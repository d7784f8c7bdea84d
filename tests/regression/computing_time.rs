//! Solves within a limit on the computing time of its thread, which other work on the machine does not use up as it does
//! the time of a clock. Where the system does not count it, the clock's time has to do.

use dvi::problem::Control;
use dvi::solution::Solution;
use dvi::specification::{Specification, SpecificationError};
use std::path::Path;
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};
use std::{fs, thread};

/// How often the time of a run is looked at.
const TICK: Duration = Duration::from_millis(20);

/// How much longer than its computing time a run may take on the clock.
const CLOCK: u32 = 60;

/// How a run came back, if it did.
pub enum Ended {
    Solved(Box<Solution>),
    Refused(Vec<SpecificationError>),
    /// It did not, though it was asked to stop.
    Deaf,
}

/// Solves a specification on a thread of its own, which is asked to stop after a computing time, and left behind if it
/// goes on for as long again.
///
/// # Panics
/// If the solve does.
pub fn solve(specification: &str, allowed: Duration) -> Ended {
    let began = Instant::now();
    let control = Arc::new(Control::with_deadline(began + CLOCK * allowed));
    let (thread, text) = (Arc::clone(&control), specification.to_owned());
    let (starts, started) = mpsc::channel();
    let (ends, ended) = mpsc::channel();
    thread::spawn(move || {
        // Somebody listens to the first; nobody to the second where it comes too late.
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

/// The computing time that a thread has had: the first figure of its `schedstat`, in nanoseconds.
fn computed(thread: &Path) -> Option<Duration> {
    let figures = fs::read_to_string(thread.join("schedstat")).ok()?;
    figures.split_whitespace().next()?.parse().ok().map(Duration::from_nanos)
}
