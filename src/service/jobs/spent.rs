//! The time of workers that each client has had lately: half of it is forgotten in the longest time that a job may run, so that
//! nobody pays for ever for a job that he was allowed.

use super::Client;
use std::collections::HashMap;
use std::time::{Duration, Instant};

/// What is left after so many halvings is nothing: a job of minutes has become less than a glance.
const FORGOTTEN: u32 = 30;

/// What each client has had.
#[derive(Debug)]
pub struct Spent {
    half_life: Duration,
    of: HashMap<Client, (Duration, Instant)>,
}

impl Spent {
    /// Nothing yet.
    pub fn new(half_life: Duration) -> Self {
        Self { half_life, of: HashMap::new() }
    }

    /// Counts a worker's `time` for `client`, up to `now`.
    pub fn add(&mut self, client: Client, time: Duration, now: Instant) {
        let before = self.by(client, now);
        self.of.insert(client, (before + time, now));
    }

    /// What `client` has had.
    pub fn by(&self, client: Client, now: Instant) -> Duration {
        self.of.get(&client).map_or(Duration::ZERO, |(time, then)| {
            let halvings = now.saturating_duration_since(*then).div_duration_f64(self.half_life);
            time.mul_f64((-halvings).exp2())
        })
    }

    /// Lets go of clients that have not come back for long.
    pub fn forget(&mut self, now: Instant) {
        let most = self.half_life.saturating_mul(FORGOTTEN);
        self.of.retain(|_, (_, then)| now.saturating_duration_since(*then) < most);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::IpAddr;

    #[test]
    fn half_is_forgotten_in_its_time_and_all_in_the_end() {
        let (one, other) = (Client::at(IpAddr::from([10, 0, 0, 1])), Client::at(IpAddr::from([10, 0, 0, 2])));
        let (second, start) = (Duration::from_secs(1), Instant::now());
        let mut spent = Spent::new(10 * second);
        spent.add(one, 8 * second, start);
        spent.add(one, second, start + 10 * second);
        assert_eq!(spent.by(one, start + 10 * second), 5 * second);
        assert_eq!(spent.by(one, start + 30 * second), 5 * second / 4);
        assert_eq!(spent.by(other, start), Duration::ZERO);
        spent.forget(start + 309 * second);
        assert_eq!(spent.of.len(), 1);
        spent.forget(start + 311 * second);
        assert!(spent.of.is_empty());
    }
}
