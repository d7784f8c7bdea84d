//! How the outside talks to a running solve: cancel, deadline, progress.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::Instant;

/// Why a solve was asked to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// [`Control::cancel`] was called.
    Cancelled,
    /// The deadline has passed.
    Deadline,
}

/// Shared between a solve and whoever started it. The solve polls it every step; nothing blocks.
#[derive(Debug)]
pub struct Control {
    cancelled: AtomicBool,
    deadline: Option<Instant>,
    fraction: AtomicU64,
    steps: AtomicU64,
    /// Where the part of the work that runs begins, and how much of the whole it is.
    begin: AtomicU64,
    share: AtomicU64,
}

impl Default for Control {
    fn default() -> Self {
        Self {
            cancelled: AtomicBool::new(false),
            deadline: None,
            fraction: AtomicU64::new(0),
            steps: AtomicU64::new(0),
            begin: AtomicU64::new(0.0_f64.to_bits()),
            share: AtomicU64::new(1.0_f64.to_bits()),
        }
    }
}

impl Control {
    /// A control with no deadline.
    pub fn new() -> Self {
        Self::default()
    }

    /// A control that stops the solve at `deadline`.
    pub fn with_deadline(deadline: Instant) -> Self {
        Self { deadline: Some(deadline), ..Self::default() }
    }

    /// Asks the solve to stop at its next step; the trajectory so far is kept.
    pub fn cancel(&self) {
        self.cancelled.store(true, Relaxed);
    }

    /// Whether the solve should stop, and why.
    pub fn poll(&self) -> Option<Stop> {
        if self.cancelled.load(Relaxed) {
            return Some(Stop::Cancelled);
        }
        self.deadline.filter(|deadline| Instant::now() >= *deadline).map(|_| Stop::Deadline)
    }

    /// Runs a part of all the work, such as `0.0..0.5`: what it reports is taken for this part. Parts may have parts.
    pub fn part<T>(&self, part: Range<f64>, run: impl FnOnce() -> T) -> T {
        let [begin, share] = [&self.begin, &self.share].map(|x| f64::from_bits(x.load(Relaxed)));
        self.begin.store((begin + share * part.start).to_bits(), Relaxed);
        self.share.store((share * (part.end - part.start)).to_bits(), Relaxed);
        let done = run();
        self.begin.store(begin.to_bits(), Relaxed);
        self.share.store(share.to_bits(), Relaxed);
        done
    }

    /// Records how far a solve is: the fraction of the time horizon done, in `[0, 1]`, and the accepted steps.
    pub fn report(&self, fraction: f64, steps: u64) {
        let [begin, share] = [&self.begin, &self.share].map(|x| f64::from_bits(x.load(Relaxed)));
        self.fraction.store((begin + share * fraction).to_bits(), Relaxed);
        self.steps.store(steps, Relaxed);
    }

    /// The fraction of the time horizon done, in `[0, 1]`.
    pub fn fraction(&self) -> f64 {
        f64::from_bits(self.fraction.load(Relaxed))
    }

    /// The accepted steps so far.
    pub fn steps(&self) -> u64 {
        self.steps.load(Relaxed)
    }
}
