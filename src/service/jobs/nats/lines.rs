//! The clients in turn: each has a subject, with a consumer that all workers pull from. A worker asks the next client that
//! may have a job, and then the one behind it, so that the jobs of one client, however many, delay those of another by one
//! job at most.
//!
//! Jobs are announced before they are in the queue. A worker that has nothing to do then has a pull wait at the consumer of
//! the client, so that the job comes without being asked for. Pulls may bring more jobs than the worker has places for; it
//! gives these back at once, to the pulls of other workers.
//!
//! A client that had no job when it was asked is asked again when one is announced, and after a while anyway: messages
//! that come again are not announced.

use super::servers::Exchange;
use async_nats::jetstream::AckKind;
use async_nats::jetstream::consumer::{Consumer, pull};
use async_nats::jetstream::message::Message;
use futures_util::future::{BoxFuture, FutureExt};
use futures_util::stream::{FuturesUnordered, StreamExt};
use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet, VecDeque};
use std::mem;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::{Notify, oneshot};
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep_until, timeout};

/// The time after which all clients are asked again.
const LOOK: Duration = Duration::from_secs(2);

/// The time that a consumer has to say whether it has a message. One that comes later comes again.
const ANSWER: Duration = Duration::from_secs(5);

/// The time for which a pull waits for a job that was announced.
const WAIT: Duration = Duration::from_secs(1);

/// The clients.
#[derive(Debug, Default)]
pub struct Lines {
    turns: Mutex<Turns>,
    arrival: Notify,
    /// One place at a time asks.
    asking: tokio::sync::Mutex<Asking>,
    /// The number of places without a job.
    idle: AtomicUsize,
}

/// The clients in order of their turns, and those that may have a job.
#[derive(Debug, Default)]
struct Turns {
    order: VecDeque<String>,
    may: HashSet<String>,
    /// When a job of a client was announced, if no pull has waited for it since.
    announced: HashMap<String, Instant>,
}

/// The consumers of clients, and what waits there.
#[derive(Debug, Default)]
struct Asking {
    consumers: HashMap<String, Consumer<pull::Config>>,
    pulls: Pulls,
    /// The pulls, while all places have jobs.
    aside: Option<Aside>,
    /// When all clients are asked again, however many jobs some of them have: a job that comes again may be of another.
    look: Option<Instant>,
}

/// Pulls that wait for a message, and their clients.
#[derive(Debug, Default)]
struct Pulls {
    clients: HashSet<String>,
    waiting: FuturesUnordered<BoxFuture<'static, (String, Option<Message>)>>,
}

/// A task that gives back what pulls bring.
#[derive(Debug)]
struct Aside {
    pulls: JoinHandle<Pulls>,
    /// Ends the task.
    wanted: oneshot::Sender<()>,
}

impl Turns {
    /// A client that may have a job, which then goes to the end.
    fn next(&mut self) -> Option<String> {
        let client = self.order.iter().find(|client| self.may.contains(*client))?.clone();
        self.goes_last(&client);
        Some(client)
    }

    /// A client has had its turn.
    fn goes_last(&mut self, client: &str) {
        if let Some(place) = self.order.iter().position(|known| known == client)
            && let Some(client) = self.order.remove(place)
        {
            self.order.push_back(client);
        }
    }

    /// The clients that had a job announced a moment ago; pulls are to wait for them.
    fn announced(&mut self) -> Vec<String> {
        let announced = mem::take(&mut self.announced);
        let recent = announced.into_iter().filter(|(_, when)| when.elapsed() < WAIT);
        let recent: Vec<String> = recent.map(|(client, _)| client).collect();
        for client in &recent {
            self.may.remove(client);
        }
        recent
    }
}

impl Lines {
    /// Adds a client.
    pub fn add(&self, client: &str) {
        let mut turns = self.lock();
        if !turns.order.iter().any(|known| known == client) {
            turns.order.push_back(client.to_owned());
        }
        turns.may.insert(client.to_owned());
        drop(turns);
        self.arrival.notify_one();
    }

    /// A job of a client is about to arrive.
    pub fn announce(&self, client: &str) {
        let mut turns = self.lock();
        turns.may.insert(client.to_owned());
        turns.announced.insert(client.to_owned(), Instant::now());
        drop(turns);
        self.arrival.notify_one();
    }

    /// Has who waits look again whether it is over.
    pub fn look(&self) {
        self.arrival.notify_one();
    }

    /// The message of the next job, with the time in which its consumer has to hear of it; `None` if `is_over` says so
    /// while there is none.
    pub async fn next(&self, exchange: &Exchange, is_over: impl Fn() -> bool) -> Option<(Message, Duration)> {
        self.idle.fetch_add(1, Relaxed);
        let mut asking = self.asking.lock().await;
        asking.resume().await;
        let next = self.next_of(&mut asking, exchange, is_over).await;
        // Without another place that goes on with them, pulls must not keep what they bring.
        if self.idle.fetch_sub(1, Relaxed) == 1 {
            asking.put_aside();
        }
        next
    }

    async fn next_of(
        &self,
        asking: &mut Asking,
        exchange: &Exchange,
        is_over: impl Fn() -> bool,
    ) -> Option<(Message, Duration)> {
        loop {
            if is_over() {
                return None;
            }
            let look = *asking.look.get_or_insert_with(|| Instant::now() + LOOK);
            if look <= Instant::now() {
                asking.look = None;
                let mut turns = self.lock();
                turns.may = turns.order.iter().cloned().collect();
            }
            let next = self.lock().next();
            let (client, message) = if let Some(client) = next {
                // Taken before the consumer is asked: an announcement meanwhile puts it back.
                self.lock().may.remove(&client);
                let message = asking.ask(exchange, &client).await;
                (client, message)
            } else {
                tokio::select! {
                    Some((client, message)) = asking.pulls.next() => {
                        if message.is_some() {
                            self.lock().goes_last(&client);
                        }
                        (client, message)
                    }
                    () = self.arrival.notified() => {
                        let announced = self.lock().announced();
                        for client in announced {
                            asking.wait_for(exchange, client).await;
                        }
                        continue;
                    }
                    () = sleep_until(look) => continue,
                }
            };
            if let Some(message) = message {
                let wait =
                    asking.consumers.get(&client).map_or(LOOK, |consumer| consumer.cached_info().config.ack_wait);
                self.lock().may.insert(client);
                return Some((message, wait));
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, Turns> {
        self.turns.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Asking {
    /// Asks the consumer of a client for a message, without waiting for one to arrive.
    async fn ask(&mut self, exchange: &Exchange, client: &str) -> Option<Message> {
        let asked = async {
            // With a time of its own, the request would wait for a message.
            let mut messages = self.consumer(exchange, client).await?.fetch().max_messages(1).messages().await?;
            timeout(ANSWER, messages.next()).await?.transpose()
        };
        match asked.await {
            Ok(message) => message,
            Err(error) => {
                self.failed(client, &error);
                None
            }
        }
    }

    /// Has a pull wait for the next message of a client.
    async fn wait_for(&mut self, exchange: &Exchange, client: String) {
        if self.pulls.clients.contains(&client) {
            return;
        }
        let asked = async {
            let pull = self.consumer(exchange, &client).await?.batch().max_messages(1).expires(WAIT);
            Ok::<_, async_nats::Error>(pull.messages().await?)
        };
        match asked.await {
            Ok(mut messages) => {
                self.pulls.clients.insert(client.clone());
                let pull = async move { (client, messages.next().await.and_then(Result::ok)) };
                self.pulls.waiting.push(pull.boxed());
            }
            Err(error) => self.failed(&client, &error),
        }
    }

    async fn consumer(
        &mut self,
        exchange: &Exchange,
        client: &str,
    ) -> Result<&Consumer<pull::Config>, async_nats::Error> {
        exchange.near()?;
        match self.consumers.entry(client.to_owned()) {
            Entry::Occupied(known) => Ok(known.into_mut()),
            Entry::Vacant(place) => Ok(place.insert(exchange.messages.get_consumer(client).await?)),
        }
    }

    fn failed(&mut self, client: &str, error: &async_nats::Error) {
        tracing::debug!(%error, client, "the jobs of a client cannot be asked for");
        self.consumers.remove(client);
    }

    /// Gives back what the pulls bring from now on.
    fn put_aside(&mut self) {
        if self.pulls.clients.is_empty() {
            return;
        }
        let (wanted, mut is_wanted) = oneshot::channel();
        let mut pulls = mem::take(&mut self.pulls);
        let pulls = tokio::spawn(async move {
            loop {
                tokio::select! {
                    biased;
                    _ = &mut is_wanted => return pulls,
                    next = pulls.next() => match next {
                        Some((_, Some(message))) => {
                            // Otherwise, the message comes again after a while.
                            let _ = message.ack_with(AckKind::Nak(None)).await;
                        }
                        Some((_, None)) => {}
                        None => return pulls,
                    }
                }
            }
        });
        self.aside = Some(Aside { pulls, wanted });
    }

    /// Goes on with the pulls that are still waiting.
    async fn resume(&mut self) {
        let Some(Aside { pulls, wanted }) = self.aside.take() else { return };
        // It may have ended by itself.
        let _ = wanted.send(());
        self.pulls = pulls.await.unwrap_or_default();
    }
}

impl Pulls {
    /// What the next pull has brought, if any waits.
    async fn next(&mut self) -> Option<(String, Option<Message>)> {
        let next = self.waiting.next().await?;
        self.clients.remove(&next.0);
        Some(next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clients_that_may_have_a_job_are_asked_in_turn() {
        let lines = Lines::default();
        ["a", "b", "c"].iter().for_each(|client| lines.add(client));
        let next = || lines.lock().next();
        let order: Vec<_> = (0..5).filter_map(|_| next()).collect();
        assert_eq!(order, ["a", "b", "c", "a", "b"]);
        lines.lock().may.remove("c");
        assert_eq!((next().as_deref(), next().as_deref()), (Some("a"), Some("b")));
        lines.announce("c");
        assert_eq!(next().as_deref(), Some("c"));
        // A client whose job came by a pull has had its turn.
        ["a", "b"].iter().for_each(|client| lines.announce(client));
        lines.lock().goes_last("a");
        assert_eq!(next().as_deref(), Some("b"));
        lines.lock().may.clear();
        assert_eq!(next(), None);
    }

    #[test]
    fn a_pull_waits_for_what_was_announced_a_moment_ago_in_place_of_a_question() {
        let lines = Lines::default();
        ["a", "b"].iter().for_each(|client| lines.add(client));
        lines.announce("b");
        lines.lock().announced.insert("a".to_owned(), Instant::now() - WAIT);
        assert_eq!(lines.lock().announced(), ["b"]);
        assert_eq!(lines.lock().announced(), Vec::<String>::new());
        let next = || lines.lock().next();
        assert_eq!((next().as_deref(), next().as_deref()), (Some("a"), Some("a")));
    }
}
