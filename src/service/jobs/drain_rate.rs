//! The rate at which jobs leave the queue: the number of the latest departures, divided by the time since the first
//! of them. It gives the waiting time that is reported to a refused client.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// The number of departures from the queue that are counted: enough for a steady rate, few enough to follow a change of
/// load.
const WINDOW: usize = 64;

/// The times of the latest departures from the queue.
#[derive(Debug, Default)]
pub struct DrainRate {
    departures: VecDeque<Instant>,
}

impl DrainRate {
    /// Counts a job that left the queue or its worker at `now`.
    pub fn departed(&mut self, now: Instant) {
        if self.departures.len() == WINDOW {
            self.departures.pop_front();
        }
        self.departures.push_back(now);
    }

    /// Returns the time in which `jobs` jobs will leave the queue at the current rate. The window of departures ends
    /// at `now`, not at the latest departure, so that a stall lowers the rate. `None` before the first departure.
    pub fn time_for(&self, jobs: usize, now: Instant) -> Option<Duration> {
        let window = now.saturating_duration_since(*self.departures.front()?);
        let seconds = jobs as f64 * window.as_secs_f64() / self.departures.len() as f64;
        Some(Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jobs_that_leave_every_two_seconds_take_two_seconds_each() {
        let start = Instant::now();
        let mut rate = DrainRate::default();
        assert_eq!(rate.time_for(1, start), None);
        for k in 0..200 {
            rate.departed(start + Duration::from_secs(2 * k));
        }
        let last = start + Duration::from_secs(2 * 200);
        assert_eq!(rate.time_for(10, last), Some(Duration::from_secs(20)));
    }

    #[test]
    fn a_stall_lengthens_the_estimate() {
        let start = Instant::now();
        let mut rate = DrainRate::default();
        rate.departed(start);
        assert_eq!(rate.time_for(1, start + Duration::from_secs(90)), Some(Duration::from_secs(90)));
    }
}
