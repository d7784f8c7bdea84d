//! The recent worker time of each client. It decays exponentially, with the wall-clock time limit of a job as its
//! half-life, so that a client does not pay forever for a job that it was allowed to run.

use super::Client;
use std::collections::HashMap;
use std::time::{Duration, Instant};

/// The number of half-lives after which a client's worker time is negligible: minutes have decayed to less than a
/// microsecond.
const FORGOTTEN: u32 = 30;

/// The exponentially decaying worker time of each client.
#[derive(Debug)]
pub struct Spent {
    half_life: Duration,
    of: HashMap<Client, (Duration, Instant)>,
}

impl Spent {
    /// Creates the record of the worker times of clients, which has no client yet.
    pub fn new(half_life: Duration) -> Self {
        Self { half_life, of: HashMap::new() }
    }

    /// Adds the worker time `time`, used up to `now`, for `client`.
    pub fn add(&mut self, client: Client, time: Duration, now: Instant) {
        let before = self.by(client, now);
        self.of.insert(client, (before + time, now));
    }

    /// Returns the decayed worker time that `client` has used, at the time `now`.
    pub fn by(&self, client: Client, now: Instant) -> Duration {
        self.of.get(&client).map_or(Duration::ZERO, |(time, then)| {
            let halvings = now.saturating_duration_since(*then).div_duration_f64(self.half_life);
            time.mul_f64((-halvings).exp2())
        })
    }

    /// Removes clients whose worker time has decayed to nothing.
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
