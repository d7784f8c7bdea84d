//! Communication with a running solve: cancellation, deadline, progress and events.

use super::Event;
use std::collections::VecDeque;
use std::fmt;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// The maximum number of events of a running solve that are kept for its observers, the latest ones; the trajectory
/// contains all events.
const MOST_EVENTS: usize = 256;

/// The reason why a running solve was asked to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The solve was cancelled by a call of [`Control::cancel`].
    Cancelled,
    /// The deadline of the solve has passed.
    Deadline,
}

/// The error returned by a long computation that was cancelled or exceeded its deadline; see [`Control::go_on`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped from outside")]
pub struct Interrupted;

/// The control of a solve, shared between the solve and its caller. The solve polls the control in every step; no
/// call blocks.
pub struct Control {
    cancelled: Arc<AtomicBool>,
    deadline: Option<Instant>,
    /// A function that is called once the deadline has passed: returns whether the solve may continue.
    reprieve: Option<Arc<Reprieve>>,
    fraction: AtomicU64,
    steps: AtomicU64,
    /// The start of the current part of the solve, as a fraction of the whole solve (bits of an `f64`).
    begin: AtomicU64,
    /// The length of the current part of the solve, as a fraction of the whole solve (bits of an `f64`).
    share: AtomicU64,
    happened: Mutex<Happened>,
}

type Reprieve = dyn Fn() -> bool + Send + Sync;

/// The latest events of a solve, and the total number of its events.
#[derive(Debug, Default)]
struct Happened {
    latest: VecDeque<Event>,
    count: u64,
}

impl Happened {
    fn push(&mut self, event: Event) {
        if self.latest.len() == MOST_EVENTS {
            self.latest.pop_front();
        }
        self.latest.push_back(event);
    }
}

impl fmt::Debug for Control {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (fraction, steps) = (self.fraction(), self.steps());
        f.debug_struct("Control").field("fraction", &fraction).field("steps", &steps).finish_non_exhaustive()
    }
}

impl Default for Control {
    fn default() -> Self {
        Self {
            cancelled: Arc::default(),
            deadline: None,
            reprieve: None,
            fraction: AtomicU64::new(0),
            steps: AtomicU64::new(0),
            begin: AtomicU64::new(0.0_f64.to_bits()),
            share: AtomicU64::new(1.0_f64.to_bits()),
            happened: Mutex::default(),
        }
    }
}

impl Control {
    /// Creates a control for a solve without a deadline.
    pub fn new() -> Self {
        Self::default()
    }

    /// Creates a control that stops the solve at the time `deadline`.
    pub fn with_deadline(deadline: Instant) -> Self {
        Self { deadline: Some(deadline), ..Self::default() }
    }

    /// Creates a control for a part of a solve that runs in parallel: it has the cancellation flag and the deadline of
    /// `self`, but its progress and events are not recorded in `self`.
    #[must_use]
    pub fn beside(&self) -> Self {
        let (cancelled, reprieve) = (Arc::clone(&self.cancelled), self.reprieve.clone());
        Self { cancelled, deadline: self.deadline, reprieve, ..Self::default() }
    }

    /// Sets a function that is called once the deadline has passed; the solve continues as long as the function returns
    /// true.
    #[must_use]
    pub fn with_reprieve(self, reprieve: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self { reprieve: Some(Arc::new(reprieve)), ..self }
    }

    /// Returns the deadline, the time at which the solve stops; `None` without a deadline.
    pub fn deadline(&self) -> Option<Instant> {
        self.deadline
    }

    /// Cancels the solve: asks it to stop at its next step; the trajectory up to that step is kept.
    pub fn cancel(&self) {
        self.cancelled.store(true, Relaxed);
    }

    /// Returns why the solve should stop (cancelled, or deadline passed), or `None` if it should continue.
    pub fn poll(&self) -> Option<Stop> {
        if self.cancelled.load(Relaxed) {
            return Some(Stop::Cancelled);
        }
        let passed = self.deadline.is_some_and(|deadline| Instant::now() >= deadline);
        let is_over = passed && !self.reprieve.as_ref().is_some_and(|reprieve| reprieve());
        is_over.then_some(Stop::Deadline)
    }

    /// Polls for cancellation and the deadline within a long computation that is not divided into steps.
    ///
    /// # Errors
    /// If the computation should stop.
    pub fn go_on(&self) -> Result<(), Interrupted> {
        self.poll().map_or(Ok(()), |_| Err(Interrupted))
    }

    /// Runs one part of a solve, such as `0.0..0.5` for its first half: progress that `run` reports is relative to that
    /// part. Parts can be nested.
    pub fn part<T>(&self, part: Range<f64>, run: impl FnOnce() -> T) -> T {
        let [begin, share] = [&self.begin, &self.share].map(|x| f64::from_bits(x.load(Relaxed)));
        self.begin.store((begin + share * part.start).to_bits(), Relaxed);
        self.share.store((share * (part.end - part.start)).to_bits(), Relaxed);
        let done = run();
        self.begin.store(begin.to_bits(), Relaxed);
        self.share.store(share.to_bits(), Relaxed);
        done
    }

    /// Records the progress of the current part of the solve: the completed fraction of its time horizon, in `[0, 1]`,
    /// and the number of accepted steps.
    pub fn report(&self, fraction: f64, steps: u64) {
        let [begin, share] = [&self.begin, &self.share].map(|x| f64::from_bits(x.load(Relaxed)));
        self.fraction.store((begin + share * fraction).to_bits(), Relaxed);
        self.steps.store(steps, Relaxed);
    }

    /// Returns the completed fraction of the whole solve, from 0 to 1.
    pub fn fraction(&self) -> f64 {
        f64::from_bits(self.fraction.load(Relaxed))
    }

    /// Returns the number of accepted steps of the solve so far.
    pub fn steps(&self) -> u64 {
        self.steps.load(Relaxed)
    }

    /// Records the events of the last step of the solve. Events are recorded in the first part of a solve only, since
    /// runs of later parts repeat them.
    pub fn tell(&self, events: &[Event]) {
        if events.is_empty() || f64::from_bits(self.begin.load(Relaxed)) > 0.0 {
            return;
        }
        let mut happened = self.happened();
        happened.count += events.len() as u64;
        for event in &events[events.len().saturating_sub(MOST_EVENTS)..] {
            happened.push(event.clone());
        }
    }

    /// Records numbered events that [`Control::events_after`] has returned for the same solve in another process.
    pub fn relay(&self, events: Vec<(u64, Event)>) {
        let mut happened = self.happened();
        for (number, event) in events {
            if number > happened.count {
                // Event numbers are skipped if more than `MOST_EVENTS` events occurred between two calls. The new
                // events then replace the whole list of kept events, so that their numbers are contiguous.
                happened.count = number;
                happened.push(event);
            }
        }
    }

    /// Returns the kept events of the solve after the first `seen`, each with its number, counted from one. If `seen`
    /// exceeds the number of events, it stems from another solve, and all kept events are returned.
    pub fn events_after(&self, seen: u64) -> Vec<(u64, Event)> {
        let happened = self.happened();
        let seen = if seen > happened.count { 0 } else { seen };
        let before = happened.count - happened.latest.len() as u64;
        let numbered = (before + 1..).zip(happened.latest.iter().cloned());
        numbered.skip(seen.saturating_sub(before).min(MOST_EVENTS as u64) as usize).collect()
    }

    fn happened(&self) -> MutexGuard<'_, Happened> {
        self.happened.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::EventKind;

    fn events(times: std::ops::Range<u32>) -> Vec<Event> {
        times.map(|t| Event { t: f64::from(t), kind: EventKind::Stick, of: "foot".to_owned() }).collect()
    }

    #[test]
    fn the_latest_events_are_at_hand_under_their_numbers() {
        let control = Control::new();
        assert!(control.events_after(0).is_empty());
        control.tell(&events(0..3));
        control.tell(&events(3..300));
        control.tell(&events(300..1000));
        let kept = control.events_after(0);
        let numbers: Vec<(u64, f64)> = kept.iter().map(|(number, event)| (*number, event.t)).collect();
        assert_eq!(numbers, (745..=1000).map(|n| (n, (n - 1) as f64)).collect::<Vec<_>>());
        assert_eq!(control.events_after(997).first().map(|(number, _)| *number), Some(998));
        assert!(control.events_after(1000).is_empty());
        assert_eq!(control.events_after(1001), kept);
    }

    #[test]
    fn events_of_another_process_keep_their_numbers() {
        let (there, here) = (Control::new(), Control::new());
        let mut seen = 0;
        for times in [0..3, 3..4, 4..4, 4..300, 300..1000, 1000..1002] {
            there.tell(&events(times));
            let told = there.events_after(seen);
            seen = told.last().map_or(seen, |(number, _)| *number);
            here.relay(told.clone());
            here.relay(told);
            assert_eq!(here.events_after(0), there.events_after(0));
        }
        assert_eq!(here.events_after(1001).len(), 1);
    }

    #[test]
    fn only_the_first_run_of_several_is_heard() {
        let control = Control::new();
        control.part(0.0..0.5, || control.part(0.0..0.5, || control.tell(&events(0..2))));
        control.part(0.0..0.5, || control.part(0.5..1.0, || control.tell(&events(0..2))));
        control.part(0.5..1.0, || control.tell(&events(0..2)));
        assert_eq!(control.events_after(0).len(), 2);
    }
}
