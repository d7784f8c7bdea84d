//! A bounded queue in which no client can starve another: one line a client, first in first out, and the clients
//! take turns (round robin: Nagle 1987, "On packet switches with infinite storage").

use std::collections::{HashMap, VecDeque};
use std::net::IpAddr;

/// Whoever shares the service with others: all that comes from one address.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Client(IpAddr);

impl Client {
    /// The client at `address`; an IPv4 address is the same client when it comes mapped into IPv6.
    pub fn at(address: IpAddr) -> Self {
        Self(address.to_canonical())
    }
}

/// Why nothing more goes in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Full {
    /// Every place is taken.
    Queue,
    /// The client holds as many places as one client may.
    Share,
}

/// Waiting items, by client.
#[derive(Debug)]
pub struct FairQueue<T> {
    lines: HashMap<Client, VecDeque<T>>,
    /// The clients with something waiting, next one first.
    turns: VecDeque<Client>,
    waiting: usize,
    places: usize,
    share: usize,
}

impl<T> FairQueue<T> {
    /// An empty queue of `places`, of which one client may hold `share`.
    pub fn new(places: usize, share: usize) -> Self {
        Self { lines: HashMap::new(), turns: VecDeque::new(), waiting: 0, places, share }
    }

    /// How many wait.
    pub fn len(&self) -> usize {
        self.waiting
    }

    /// Whether none waits.
    pub fn is_empty(&self) -> bool {
        self.waiting == 0
    }

    /// How many clients have something waiting.
    pub fn clients(&self) -> usize {
        self.turns.len()
    }

    /// Whether `client` may put in another item.
    ///
    /// # Errors
    /// Which bound is reached.
    pub fn admits(&self, client: Client) -> Result<(), Full> {
        if self.waiting >= self.places {
            return Err(Full::Queue);
        }
        if self.lines.get(&client).is_some_and(|line| line.len() >= self.share) {
            return Err(Full::Share);
        }
        Ok(())
    }

    /// Puts `item` at the end of the client's line.
    ///
    /// # Errors
    /// Which bound is reached; the item is dropped.
    pub fn push(&mut self, client: Client, item: T) -> Result<(), Full> {
        self.admits(client)?;
        let line = self.lines.entry(client).or_default();
        if line.is_empty() {
            self.turns.push_back(client);
        }
        line.push_back(item);
        self.waiting += 1;
        Ok(())
    }

    /// Takes the first item of the client whose turn it is.
    pub fn pop(&mut self) -> Option<T> {
        let client = self.turns.pop_front()?;
        let line = self.lines.get_mut(&client)?;
        let item = line.pop_front()?;
        self.waiting -= 1;
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
        if line.is_empty() {
            self.lines.remove(&client);
            self.turns.retain(|turn| *turn != client);
        }
        Some(item)
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

    fn client(last: u8) -> Client {
        Client::at(IpAddr::from([10, 0, 0, last]))
    }

    fn queue_of(arrivals: &[(u8, &'static str)]) -> FairQueue<&'static str> {
        let mut queue = FairQueue::new(100, 100);
        for (from, item) in arrivals {
            queue.push(client(*from), *item).unwrap();
        }
        queue
    }

    #[test]
    fn a_late_client_is_served_after_one_job_of_a_busy_one() {
        let mut queue = queue_of(&[(1, "a1"), (1, "a2"), (1, "a3"), (2, "b1"), (3, "c1"), (2, "b2")]);
        let order: Vec<_> = std::iter::from_fn(|| queue.pop()).collect();
        assert_eq!(order, ["a1", "b1", "c1", "a2", "b2", "a3"]);
        assert!(queue.is_empty() && queue.lines.is_empty() && queue.turns.is_empty());
    }

    #[test]
    fn positions_foretell_the_order_of_service() {
        let arrivals = [(1, "a1"), (1, "a2"), (1, "a3"), (2, "b1"), (3, "c1"), (2, "b2")];
        let mut queue = queue_of(&arrivals);
        queue.pop();
        let foretold: Vec<_> = arrivals
            .iter()
            .map(|(from, sought)| (queue.position(client(*from), |item| item == sought), *sought))
            .collect();
        for (position, item) in std::iter::from_fn(|| queue.pop()).enumerate() {
            assert!(foretold.contains(&(Some(position), item)), "{item} came at {position}: {foretold:?}");
        }
    }

    #[test]
    fn each_bound_is_named_and_a_freed_place_is_given_again() {
        let mut queue = FairQueue::new(3, 2);
        assert_eq!(queue.push(client(1), 1), Ok(()));
        assert_eq!(queue.push(client(1), 2), Ok(()));
        assert_eq!(queue.push(client(1), 3), Err(Full::Share));
        assert_eq!(queue.push(client(2), 4), Ok(()));
        assert_eq!(queue.push(client(3), 5), Err(Full::Queue));
        queue.pop();
        assert_eq!(queue.push(client(1), 3), Ok(()));
        assert_eq!(queue.waiting, 3);
    }

    #[test]
    fn a_removed_item_leaves_the_turns_of_the_others_alone() {
        let mut queue = queue_of(&[(1, "a1"), (2, "b1"), (3, "c1")]);
        assert_eq!(queue.remove(client(2), |item| *item == "b1"), Some("b1"));
        assert_eq!(queue.remove(client(2), |item| *item == "b1"), None);
        assert_eq!((queue.pop(), queue.pop(), queue.pop()), (Some("a1"), Some("c1"), None));
    }

    #[test]
    fn a_mapped_address_is_the_same_client() {
        assert_eq!(Client::at("::ffff:10.0.0.1".parse().unwrap()), client(1));
    }
}
