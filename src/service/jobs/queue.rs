//! A bounded queue in which no client can starve another: one line a client, first in first out, and the clients
//! take turns (round robin: Nagle 1987, "On packet switches with infinite storage").

use super::Client;
use std::collections::{HashMap, VecDeque};

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

    /// Puts `item` at the end of the client's line, whatever the bounds: those are for [`FairQueue::admits`].
    pub fn push(&mut self, client: Client, item: T) {
        let line = self.lines.entry(client).or_default();
        if line.is_empty() {
            self.turns.push_back(client);
        }
        line.push_back(item);
        self.waiting += 1;
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

    /// Leaves in what `stays`, in its order.
    pub fn retain(&mut self, mut stays: impl FnMut(&T) -> bool) {
        self.lines.retain(|_, line| {
            line.retain(&mut stays);
            !line.is_empty()
        });
        self.turns.retain(|client| self.lines.contains_key(client));
        self.waiting = self.lines.values().map(VecDeque::len).sum();
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

    fn client(last: u8) -> Client {
        Client::at(IpAddr::from([10, 0, 0, last]))
    }

    fn queue_of(arrivals: &[(u8, &'static str)]) -> FairQueue<&'static str> {
        let mut queue = FairQueue::new(100, 100);
        for (from, item) in arrivals {
            queue.push(client(*from), *item);
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
        queue.push(client(1), 1);
        assert_eq!(queue.admits(client(1)), Ok(()));
        queue.push(client(1), 2);
        assert_eq!(queue.admits(client(1)), Err(Full::Share));
        assert_eq!(queue.admits(client(2)), Ok(()));
        queue.push(client(2), 4);
        assert_eq!(queue.admits(client(3)), Err(Full::Queue));
        queue.pop();
        assert_eq!(queue.admits(client(1)), Ok(()));
        assert_eq!(queue.waiting, 2);
    }

    #[test]
    fn a_removed_item_leaves_the_turns_of_the_others_alone() {
        let mut queue = queue_of(&[(1, "a1"), (2, "b1"), (3, "c1")]);
        assert_eq!(queue.remove(client(2), |item| *item == "b1"), Some("b1"));
        assert_eq!(queue.remove(client(2), |item| *item == "b1"), None);
        assert_eq!((queue.pop(), queue.pop(), queue.pop()), (Some("a1"), Some("c1"), None));
    }

    #[test]
    fn what_stays_keeps_its_order_and_what_leaves_gives_its_place() {
        let mut queue = queue_of(&[(1, "a1"), (1, "a2"), (2, "b1"), (3, "c1")]);
        queue.retain(|item| !["a1", "b1"].contains(item));
        assert_eq!((queue.waiting, queue.clients()), (2, 2));
        assert_eq!((queue.pop(), queue.pop(), queue.pop()), (Some("a2"), Some("c1"), None));
    }
}
