//! A bounded queue in which no client can starve another: one line a client, first in first out, and the clients
//! take turns (round robin: Nagle 1987, "On packet switches with infinite storage"). Since jobs take different times, a client
//! with less of a load goes first: what is shared evenly is workers and their time (max-min fairness: Bertsekas & Gallager
//! 1992, "Data networks", section 6.5.2).

use super::Client;
use std::collections::{HashMap, VecDeque};

/// Why nothing more goes in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Full {
    /// Every place is taken.
    Queue,
    /// With the item, what waits would be too large.
    Bytes,
    /// The client holds as many places as one client may.
    Share,
}

/// How much may wait.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    /// Items.
    pub places: usize,
    /// Of those, one client's.
    pub share: usize,
    /// Bytes of all; a single item may have more.
    pub bytes: usize,
}

/// What waits takes memory.
pub trait Heavy {
    /// The bytes that count.
    fn bytes(&self) -> usize;
}

/// Waiting items, by client.
#[derive(Debug)]
pub struct FairQueue<T> {
    lines: HashMap<Client, VecDeque<T>>,
    /// The clients with something waiting, next one first.
    turns: VecDeque<Client>,
    waiting: usize,
    bytes: usize,
    room: Room,
}

impl<T: Heavy> FairQueue<T> {
    /// An empty queue.
    pub fn new(room: Room) -> Self {
        Self { lines: HashMap::new(), turns: VecDeque::new(), waiting: 0, bytes: 0, room }
    }

    /// The bytes of what waits.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// How many wait.
    pub fn len(&self) -> usize {
        self.waiting
    }

    /// Whether none waits.
    pub fn is_empty(&self) -> bool {
        self.waiting == 0
    }

    /// Whether such an item waits.
    pub fn any(&self, is_sought: impl Fn(Client, &T) -> bool) -> bool {
        self.lines.iter().any(|(client, line)| line.iter().any(|item| is_sought(*client, item)))
    }

    /// How many clients have something waiting.
    pub fn clients(&self) -> usize {
        self.turns.len()
    }

    /// Whether `client` may put in another item, of so many bytes.
    ///
    /// # Errors
    /// Which bound is reached.
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

    /// Puts `item` at the end of the client's line, whatever the bounds: those are for [`FairQueue::admits`].
    pub fn push(&mut self, client: Client, item: T) {
        let line = self.lines.entry(client).or_default();
        if line.is_empty() {
            self.turns.push_back(client);
        }
        self.waiting += 1;
        self.bytes += item.bytes();
        line.push_back(item);
    }

    /// Takes the first item that `may` be taken of the client whose turn it is: of those with the least `load`, the first in
    /// turn. A client without a load is passed over.
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

    /// Takes out the client's first item that `is_sought`, wherever in its line it stands.
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

    /// Leaves in what `stays`, in its order.
    pub fn retain(&mut self, mut stays: impl FnMut(&T) -> bool) {
        self.lines.retain(|_, line| {
            line.retain(&mut stays);
            !line.is_empty()
        });
        self.turns.retain(|client| self.lines.contains_key(client));
        self.waiting = self.lines.values().map(VecDeque::len).sum();
        self.bytes = self.lines.values().flatten().map(Heavy::bytes).sum();
    }

    /// How many items will be taken before the client's first that `is_sought`, if nothing more comes in.
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

    /// The next item where all clients have the same load.
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
