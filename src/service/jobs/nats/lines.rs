//! The clients in turn: each has a subject, with a consumer that all workers pull from. A worker asks the next client that
//! may have a job, and then the one behind it, so that the jobs of one client, however many, delay those of another by one
//! job at most.
//!
//! A client that had no job when it was asked is asked again when one arrives, and after a while anyway: messages that
//! come again are not announced.

use super::servers::Exchange;
use async_nats::jetstream::consumer::{Consumer, pull};
use async_nats::jetstream::message::Message;
use futures_util::StreamExt;
use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::Notify;
use tokio::time::{sleep, timeout};

/// The time after which all clients are asked again.
const LOOK: Duration = Duration::from_secs(2);

/// The time that a consumer has to say whether it has a message. One that comes later comes again.
const ANSWER: Duration = Duration::from_secs(5);

/// The clients.
#[derive(Debug, Default)]
pub struct Lines {
    turns: Mutex<Turns>,
    arrival: Notify,
    /// One at a time asks.
    consumers: tokio::sync::Mutex<HashMap<String, Consumer<pull::Config>>>,
}

/// The clients in order of their turns, and those that may have a job.
#[derive(Debug, Default)]
struct Turns {
    order: VecDeque<String>,
    may: HashSet<String>,
}

impl Turns {
    /// A client that may have a job, which then goes to the end.
    fn next(&mut self) -> Option<String> {
        let place = self.order.iter().position(|client| self.may.contains(client))?;
        let client = self.order.remove(place)?;
        self.order.push_back(client.clone());
        Some(client)
    }
}

impl Lines {
    /// Adds a client.
    pub fn add(&self, client: &str) {
        let mut turns = self.lock();
        if !turns.order.iter().any(|known| known == client) {
            turns.order.push_back(client.to_owned());
        }
        drop(turns);
        self.arrived(client);
    }

    /// A job of a client has arrived.
    pub fn arrived(&self, client: &str) {
        self.lock().may.insert(client.to_owned());
        self.arrival.notify_one();
    }

    /// Has who waits look again whether it is over.
    pub fn look(&self) {
        self.arrival.notify_one();
    }

    /// The message of the next job, with the time in which its consumer has to hear of it; `None` if `is_over` says so
    /// while there is none.
    pub async fn next(&self, exchange: &Exchange, is_over: impl Fn() -> bool) -> Option<(Message, Duration)> {
        let mut consumers = self.consumers.lock().await;
        loop {
            if is_over() {
                return None;
            }
            let next = self.lock().next();
            let Some(client) = next else {
                tokio::select! {
                    () = self.arrival.notified() => {}
                    () = sleep(LOOK) => {
                        let mut turns = self.lock();
                        turns.may = turns.order.iter().cloned().collect();
                    }
                }
                continue;
            };
            // Taken before the consumer is asked: an arrival meanwhile puts it back.
            self.lock().may.remove(&client);
            match ask(exchange, &mut consumers, &client).await {
                Ok(Some(message)) => {
                    self.lock().may.insert(client.clone());
                    let wait = consumers.get(&client).map_or(LOOK, |consumer| consumer.cached_info().config.ack_wait);
                    return Some((message, wait));
                }
                Ok(None) => {}
                Err(error) => {
                    tracing::debug!(%error, client, "the jobs of a client cannot be asked for");
                    consumers.remove(&client);
                }
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, Turns> {
        self.turns.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Asks the consumer of a client for a message, without waiting for one to arrive.
async fn ask(
    exchange: &Exchange,
    consumers: &mut HashMap<String, Consumer<pull::Config>>,
    client: &str,
) -> Result<Option<Message>, async_nats::Error> {
    exchange.near()?;
    if !consumers.contains_key(client) {
        consumers.insert(client.to_owned(), exchange.messages.get_consumer(client).await?);
    }
    let Some(consumer) = consumers.get(client) else { return Ok(None) };
    // With a time of its own, the request would wait for a message.
    let mut messages = consumer.fetch().max_messages(1).messages().await?;
    match timeout(ANSWER, messages.next()).await {
        Ok(Some(message)) => message.map(Some),
        Ok(None) => Ok(None),
        Err(late) => Err(late.into()),
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
        lines.arrived("c");
        assert_eq!(next().as_deref(), Some("c"));
        lines.lock().may.clear();
        assert_eq!(next(), None);
    }
}
