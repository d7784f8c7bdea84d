//! Permits for work that is not a job and yet takes time, such as the check of a large specification: a few at a
//! time, shared so that no client can starve another.

use super::Client;
use super::queue::{FairQueue, Full, Heavy, Room};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::oneshot;

/// A number of permits to do work that is not a job, and the queue of those that wait for a permit.
#[derive(Debug)]
pub struct Turns {
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    free: usize,
    waiting: FairQueue<Waiting>,
}

#[derive(Debug)]
struct Waiting {
    bytes: usize,
    place: oneshot::Sender<Turn>,
}

impl Heavy for Waiting {
    fn bytes(&self) -> usize {
        self.bytes
    }
}

/// A permit to do work that is not a job; when it is dropped, the next client in the queue gets it.
#[derive(Debug)]
pub struct Turn {
    turns: Option<Arc<Turns>>,
}

impl Turns {
    /// Creates `places` permits, with the limits `room` of the queue of those that wait for one.
    pub fn new(places: usize, room: Room) -> Arc<Self> {
        Arc::new(Self { state: Mutex::new(State { free: places, waiting: FairQueue::new(room) }) })
    }

    /// Returns the number of permits taken, out of `places`.
    pub fn taken(&self, places: usize) -> usize {
        places.saturating_sub(self.lock().free)
    }

    /// Waits for a permit to work on `bytes` bytes. A client that disconnects (a dropped future) gives up its turn.
    ///
    /// # Errors
    /// The limit that is reached.
    pub async fn turn(self: &Arc<Self>, client: Client, bytes: usize) -> Result<Turn, Full> {
        let (place, given) = oneshot::channel();
        {
            let mut state = self.lock();
            state.waiting.admits(client, bytes)?;
            state.waiting.push(client, Waiting { bytes, place });
        }
        self.hand_out();
        // The permit is always given in the end, since the queue outlives those that wait in it, and drops none of
        // them.
        given.await.map_err(|_| Full::Queue)
    }

    /// Gives the free permits to the clients that come next in the queue for permits.
    fn hand_out(self: &Arc<Self>) {
        loop {
            let next = {
                let mut state = self.lock();
                if state.free == 0 {
                    return;
                }
                let Some(next) = state.waiting.pop(|_| Some(0), |_| true) else { return };
                state.free -= 1;
                next
            };
            if let Err(mut gone) = next.place.send(Turn { turns: Some(Arc::clone(self)) }) {
                gone.turns = None;
                self.lock().free += 1;
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        if let Some(turns) = self.turns.take() {
            turns.lock().free += 1;
            turns.hand_out();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::IpAddr;
    use tokio::sync::mpsc::unbounded_channel;

    fn client(last: u8) -> Client {
        Client::at(IpAddr::from([10, 0, 0, last]))
    }

    fn one_place() -> Arc<Turns> {
        Turns::new(1, Room { places: 4, share: 3, bytes: 100 })
    }

    #[tokio::test]
    async fn a_late_client_has_its_turn_after_one_of_a_busy_one() {
        let turns = one_place();
        let first = turns.turn(client(1), 1).await.unwrap();
        let (told, mut order) = unbounded_channel();
        for (from, name) in [(1, "a1"), (1, "a2"), (1, "a3"), (2, "b1")] {
            let (turns, told) = (Arc::clone(&turns), told.clone());
            tokio::spawn(async move {
                let _turn = turns.turn(client(from), 1).await.unwrap();
                told.send(name).unwrap();
            });
            tokio::task::yield_now().await;
        }
        assert!(matches!(turns.turn(client(3), 1).await, Err(Full::Queue)));
        drop((first, told));
        let mut names = Vec::new();
        while let Some(name) = order.recv().await {
            names.push(name);
        }
        assert_eq!(names, ["a1", "b1", "a2", "a3"]);
    }

    #[tokio::test]
    async fn the_place_of_one_who_went_away_is_given_to_the_next() {
        let turns = one_place();
        let first = turns.turn(client(1), 1).await.unwrap();
        let gone = tokio::spawn({
            let turns = Arc::clone(&turns);
            async move { turns.turn(client(1), 1).await }
        });
        tokio::task::yield_now().await;
        gone.abort();
        assert!(gone.await.unwrap_err().is_cancelled());
        drop(first);
        drop(turns.turn(client(2), 1).await.unwrap());
        assert_eq!(turns.lock().free, 1);
    }
}
