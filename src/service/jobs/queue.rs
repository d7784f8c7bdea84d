//! A bounded queue in which no client can starve another: one first-in-first-out line per client, with the clients
//! taking turns (round robin: Nagle 1987, "On packet switches with infinite storage"). Since jobs take different
//! times, the client with the least load goes first, so that the workers and their time are shared evenly (max-min
//! fairness: Bertsekas & Gallager 1992, "Data networks", section 6.5.2).

use super::Client;
use std::collections::{HashMap, VecDeque};

/// The limit of a fair queue that a further item would exceed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Full {
    /// The largest number of items that may wait in the queue is reached.
    Queue,
    /// The total size of the waiting items, with the item to be added, would exceed its limit.
    Bytes,
    /// The largest number of items of one client that may wait in the queue is reached.
    Share,
}

/// The limits of a fair queue of waiting items, with one line of items per client.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    /// The largest number of items that may wait in the queue.
    pub places: usize,
    /// The largest number of items of one client that may wait in the queue.
    pub share: usize,
    /// The largest total size of all waiting items, in bytes; an item that waits alone may be larger.
    pub bytes: usize,
}

/// An item of a fair queue, which takes memory while it waits.
pub trait Heavy {
    /// Returns the size of the item in memory, in bytes.
    fn bytes(&self) -> usize;
}

/// A fair queue of items, with one line per client.
#[derive(Debug)]
pub struct FairQueue<T> {
    lines: HashMap<Client, VecDeque<T>>,
    /// The clients with waiting items, in order of their turns.
    turns: VecDeque<Client>,
    waiting: usize,
    bytes: usize,
    room: Room,
}

impl<T: Heavy> FairQueue<T> {
    /// Creates an empty fair queue with the limits `room`.
    pub fn new(room: Room) -> Self {
        Self { lines: HashMap::new(), turns: VecDeque::new(), waiting: 0, bytes: 0, room }
    }

    /// Returns the total size of the waiting items, in bytes.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Returns the number of waiting items.
    pub fn len(&self) -> usize {
        self.waiting
    }

    /// Whether no item waits in the queue.
    pub fn is_empty(&self) -> bool {
        self.waiting == 0
    }

    /// Whether an item that satisfies `is_sought` waits in the queue.
    pub fn any(&self, is_sought: impl Fn(Client, &T) -> bool) -> bool {
        self.lines.iter().any(|(client, line)| line.iter().any(|item| is_sought(*client, item)))
    }

    /// Returns the number of clients with waiting items.
    pub fn clients(&self) -> usize {
        self.turns.len()
    }

    /// Returns the clients with waiting items, in the order of their turns in the queue.
    pub fn in_turn(&self) -> impl Iterator<Item = Client> {
        self.turns.iter().copied()
    }

    /// Checks whether `client` may add another item of size `bytes`.
    ///
    /// # Errors
    /// The limit that is reached.
    pub fn admits(&self, client: Client, bytes: usize) -> Result<(), Full> {
        if self.waiting >= self.room.places {
            return Err(Full::Queue);
        }
        if self.lines.get(&client).is_some_and(|line| line.len() >= self.room.share) {
            return Err(Full::Share);
        }
        if self.waiting > 0 && self.bytes.saturating_add(bytes) > self.room.bytes {
            return Err(Full::Bytes);
        }
        Ok(())
    }

    /// Appends `item` to the client's line, without regard to the limits, which [`FairQueue::admits`] checks.
    pub fn push(&mut self, client: Client, item: T) {
        let line = self.lines.entry(client).or_default();
        if line.is_empty() {
            self.turns.push_back(client);
        }
        self.waiting += 1;
        self.bytes += item.bytes();
        line.push_back(item);
    }

    /// Removes and returns the next item that satisfies `may`. Among clients with such an item, the client with the
    /// least `load` goes first, then the order of turns decides; a client whose load is `None` is skipped.
    pub fn pop<L: Ord>(&mut self, load: impl Fn(Client) -> Option<L>, may: impl Fn(&T) -> bool) -> Option<T> {
        let of_client = |(turn, client): (usize, &Client)| {
            let index = self.lines.get(client)?.iter().position(&may)?;
            Some((load(*client)?, turn, index))
        };
        let firsts = self.turns.iter().enumerate().filter_map(of_client);
        let (_, turn, index) = firsts.min_by(|(one, ..), (other, ..)| one.cmp(other))?;
        let client = self.turns.remove(turn)?;
        let line = self.lines.get_mut(&client)?;
        let item = line.remove(index)?;
        self.waiting -= 1;
        self.bytes -= item.bytes();
        if line.is_empty() {
            self.lines.remove(&client);
        } else {
            self.turns.push_back(client);
        }
        Some(item)
    }

    /// Removes from the queue the client's first item that satisfies `is_sought`, at any position of the client's line.
    pub fn remove(&mut self, client: Client, is_sought: impl FnMut(&T) -> bool) -> Option<T> {
        let line = self.lines.get_mut(&client)?;
        let index = line.iter().position(is_sought)?;
        let item = line.remove(index)?;
        self.waiting -= 1;
        self.bytes -= item.bytes();
        if line.is_empty() {
            self.lines.remove(&client);
            self.turns.retain(|turn| *turn != client);
        }
        Some(item)
    }

    /// Removes the items that do not satisfy `stays` from the queue; the others keep their order.
    pub fn retain(&mut self, mut stays: impl FnMut(&T) -> bool) {
        self.lines.retain(|_, line| {
            line.retain(&mut stays);
            !line.is_empty()
        });
        self.turns.retain(|client| self.lines.contains_key(client));
        self.waiting = self.lines.values().map(VecDeque::len).sum();
        self.bytes = self.lines.values().flatten().map(Heavy::bytes).sum();
    }

    /// Returns the number of items that will be taken from the queue before the client's first item that satisfies
    /// `is_sought`, if no item is added.
    pub fn position(&self, client: Client, is_sought: impl FnMut(&T) -> bool) -> Option<usize> {
        let own = self.lines.get(&client)?.iter().position(is_sought)?;
        let turn = self.turns.iter().position(|turn| *turn == client)?;
        let others = self.turns.iter().enumerate().filter(|(_, other)| **other != client).map(|(index, other)| {
            let rounds = if index < turn { own + 1 } else { own };
            self.lines.get(other).map_or(0, |line| line.len().min(rounds))
        });
        Some(own + others.sum::<usize>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::IpAddr;

    impl Heavy for &str {
        fn bytes(&self) -> usize {
            self.len()
        }
    }

    const WIDE: Room = Room { places: 100, share: 100, bytes: 100 };

    fn client(last: u8) -> Client {
        Client::at(IpAddr::from([10, 0, 0, last]))
    }

    fn any(_: &&str) -> bool {
        true
    }

    /// Takes the next item of the queue, with equal loads of all clients.
    fn take(queue: &mut FairQueue<&'static str>) -> Option<&'static str> {
        queue.pop(|_| Some(0), any)
    }

    fn queue_of(arrivals: &[(u8, &'static str)]) -> FairQueue<&'static str> {
        let mut queue = FairQueue::new(WIDE);
        for (from, item) in arrivals {
            queue.push(client(*from), *item);
        }
        queue
    }

    #[test]
    fn a_late_client_is_served_after_one_job_of_a_busy_one() {
        let mut queue = queue_of(&[(1, "a1"), (1, "a2"), (1, "a3"), (2, "b1"), (3, "c1"), (2, "b2")]);
        let order: Vec<_> = std::iter::from_fn(|| take(&mut queue)).collect();
        assert_eq!(order, ["a1", "b1", "c1", "a2", "b2", "a3"]);
        assert!(queue.is_empty() && queue.lines.is_empty() && queue.turns.is_empty());
    }

    #[test]
    fn a_client_for_whom_less_runs_goes_first() {
        let mut queue = queue_of(&[(1, "a1"), (1, "a2"), (2, "b1"), (2, "b2"), (3, "c1")]);
        let load =
            |of: [usize; 3]| move |who: Client| (1..=3).find(|k| client(*k) == who).map_or(0, |k| of[k as usize - 1]);
        let below =
            |most: usize, of: [usize; 3]| move |who: Client| Some(load(of)(who)).filter(|running| *running < most);
        assert_eq!(queue.pop(below(9, [2, 1, 1]), any), Some("b1"));
        assert_eq!(queue.pop(below(9, [2, 2, 1]), any), Some("c1"));
        assert_eq!(queue.pop(below(1, [2, 2, 2]), any), None);
        assert_eq!(queue.pop(below(1, [2, 0, 2]), any), Some("b2"));
        assert_eq!((take(&mut queue), take(&mut queue), queue.len()), (Some("a1"), Some("a2"), 0));
    }

    #[test]
    fn what_may_not_be_taken_yet_is_passed_over_and_keeps_its_place() {
        let mut queue = queue_of(&[(1, "a1"), (1, "a2"), (2, "b1"), (1, "a3")]);
        let is_late = |item: &&str| !item.ends_with('1');
        assert_eq!(queue.pop(|_| Some(0), is_late), Some("a2"));
        assert_eq!((queue.waiting, queue.bytes), (3, 6));
        assert!(queue.any(|who, item| who == client(1) && *item == "a3") && !queue.any(|_, item| *item == "a2"));
        let order: Vec<_> = std::iter::from_fn(|| take(&mut queue)).collect();
        assert_eq!(order, ["b1", "a1", "a3"]);
    }

    #[test]
    fn positions_foretell_the_order_of_service() {
        let arrivals = [(1, "a1"), (1, "a2"), (1, "a3"), (2, "b1"), (3, "c1"), (2, "b2")];
        let mut queue = queue_of(&arrivals);
        take(&mut queue);
        let foretold: Vec<_> = arrivals
            .iter()
            .map(|(from, sought)| (queue.position(client(*from), |item| item == sought), *sought))
            .collect();
        for (position, item) in std::iter::from_fn(|| take(&mut queue)).enumerate() {
            assert!(foretold.contains(&(Some(position), item)), "{item} came at {position}: {foretold:?}");
        }
    }

    #[test]
    fn each_bound_is_named_and_a_freed_place_is_given_again() {
        let mut queue = FairQueue::new(Room { places: 3, share: 2, bytes: 10 });
        queue.push(client(1), "a1");
        assert_eq!(queue.admits(client(1), 2), Ok(()));
        queue.push(client(1), "a2");
        assert_eq!(queue.admits(client(1), 2), Err(Full::Share));
        assert_eq!(queue.admits(client(2), 6), Ok(()));
        assert_eq!(queue.admits(client(2), 7), Err(Full::Bytes));
        queue.push(client(2), "b1");
        assert_eq!(queue.admits(client(3), 2), Err(Full::Queue));
        take(&mut queue);
        assert_eq!(queue.admits(client(1), 2), Ok(()));
        assert_eq!((queue.waiting, queue.bytes), (2, 4));
    }

    #[test]
    fn what_is_larger_than_all_that_may_wait_waits_alone() {
        let mut queue = FairQueue::new(Room { bytes: 3, ..WIDE });
        assert_eq!(queue.admits(client(1), 8), Ok(()));
        queue.push(client(1), "enormous");
        assert_eq!(queue.admits(client(2), 1), Err(Full::Bytes));
        assert_eq!(queue.remove(client(1), |_| true), Some("enormous"));
        assert_eq!((queue.admits(client(2), 1), queue.bytes), (Ok(()), 0));
    }

    #[test]
    fn a_removed_item_leaves_the_turns_of_the_others_alone() {
        let mut queue = queue_of(&[(1, "a1"), (2, "b1"), (3, "c1")]);
        assert_eq!(queue.remove(client(2), |item| *item == "b1"), Some("b1"));
        assert_eq!(queue.remove(client(2), |item| *item == "b1"), None);
        assert_eq!((take(&mut queue), take(&mut queue), take(&mut queue)), (Some("a1"), Some("c1"), None));
    }

    #[test]
    fn what_stays_keeps_its_order_and_what_leaves_gives_its_place() {
        let mut queue = queue_of(&[(1, "a1"), (1, "a2"), (2, "b1"), (3, "c1")]);
        queue.retain(|item| !["a1", "b1"].contains(item));
        assert_eq!((queue.waiting, queue.bytes, queue.clients()), (2, 4, 2));
        assert_eq!((take(&mut queue), take(&mut queue), take(&mut queue)), (Some("a2"), Some("c1"), None));
    }
}
