//! The order in which a worker takes the jobs of clients: each client has a subject, with a consumer from which all
//! workers pull. A worker asks for a job of the next client that may have one, and then of the one after it, so that
//! the jobs of one client, however many, delay those of another by at most one job.
//!
//! An idle worker hears of a job before the job is in the queue (see `announcements`). It then starts a pull at the
//! consumer of the client, which waits for the message of the job. Pulls may bring more jobs than the worker can
//! solve at a time; it gives these back at once, to others.
//!
//! A client that had no job when it was asked for is asked for again when the worker hears of a job of the client, by
//! an announcement or from a gateway. After a while it is asked for in any case: messages that are delivered again
//! are not announced.

use super::announcements::{Answer, Told, WAIT};
use super::servers::Exchange;
use async_nats::Subscriber;
use async_nats::jetstream::AckKind;
use async_nats::jetstream::consumer::{Consumer, pull};
use async_nats::jetstream::message::Message;
use futures_util::future::{BoxFuture, FutureExt, OptionFuture};
use futures_util::stream::{FuturesUnordered, StreamExt};
use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet, VecDeque};
use std::fmt;
use std::mem;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::{Notify, oneshot};
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep_until, timeout};

/// The time after which an idle worker asks gateways again which clients have jobs.
const LOOK: Duration = Duration::from_secs(2);

/// The time for which a worker that goes from job to job relies on the last answer to which clients have jobs: long
/// compared with a question, short compared with what a client notices.
const KNOWN: Duration = Duration::from_millis(20);

/// The longest time for which a worker that goes from job to job waits for the answer of gateways to which clients have
/// jobs.
const SOON: Duration = Duration::from_millis(50);

/// The time limit for a JetStream consumer to say whether it has a message. A message that comes later is delivered
/// again.
const ANSWER: Duration = Duration::from_secs(5);

/// The clients of the jobs that a worker takes, and the state of its requests for jobs.
#[derive(Debug, Default)]
pub struct Lines {
    turns: Mutex<Turns>,
    arrival: Notify,
    /// The state of the requests for jobs; of the worker's concurrent solves that wait for a job, one at a time makes
    /// requests.
    asking: tokio::sync::Mutex<Asking>,
    /// The number of the worker's concurrent solves that have no job.
    idle: AtomicUsize,
}

/// The clients in the order in which a worker asks for their jobs, and those that may have a job.
#[derive(Debug, Default)]
struct Turns {
    order: VecDeque<String>,
    may: HashSet<String>,
}

/// The JetStream consumers of clients, and the pending requests of a worker for jobs.
#[derive(Debug, Default)]
struct Asking {
    consumers: HashMap<String, Consumer<pull::Config>>,
    pulls: Pulls,
    /// The task that has the pending pulls while all of the worker's concurrent solves have jobs, and gives back what
    /// the pulls bring.
    aside: Option<Aside>,
    /// The subscription that brings the next announcement of a job, while one of the worker's concurrent solves has
    /// no job and no pull waits.
    offer: Option<Subscriber>,
    /// The unanswered question to gateways which clients have jobs, and the time of the last answer.
    question: Option<Question>,
    told: Option<Instant>,
    /// The time at which an idle worker asks again which clients have jobs.
    look: Option<Instant>,
}

/// A question to gateways which clients have jobs that has not been answered.
struct Question(Answer);

impl fmt::Debug for Question {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Question")
    }
}

/// Pulls of a worker that wait for the message of a job at JetStream consumers, with the clients of the jobs.
#[derive(Debug, Default)]
struct Pulls {
    clients: HashSet<String>,
    waiting: FuturesUnordered<BoxFuture<'static, (String, Option<Message>)>>,
}

/// A task that gives the messages of jobs that waiting pulls bring back to the NATS servers, for other workers.
#[derive(Debug)]
struct Aside {
    pulls: JoinHandle<Pulls>,
    /// Ends the task that gives messages back, when the worker can take a job again and wants the pulls.
    wanted: oneshot::Sender<()>,
}

impl Turns {
    fn has_next(&self) -> bool {
        self.order.iter().any(|client| self.may.contains(client))
    }

    /// Returns the next client in turn that may have a job, and moves it to the end of the order.
    fn next(&mut self) -> Option<String> {
        let client = self.order.iter().find(|client| self.may.contains(*client))?.clone();
        self.goes_last(&client);
        Some(client)
    }

    /// Moves a client of which the worker has taken a job to the end of the order of clients.
    fn goes_last(&mut self, client: &str) {
        if let Some(place) = self.order.iter().position(|known| known == client)
            && let Some(client) = self.order.remove(place)
        {
            self.order.push_back(client);
        }
    }

    /// Adds clients that may have jobs to those that the worker asks for; `None` stands for all known clients.
    fn learn(&mut self, clients: Option<Vec<String>>) {
        let Some(clients) = clients else {
            self.may = self.order.iter().cloned().collect();
            return;
        };
        for client in clients {
            self.add(&client);
        }
    }

    fn add(&mut self, client: &str) {
        if !self.order.iter().any(|known| known == client) {
            self.order.push_back(client.to_owned());
        }
        self.may.insert(client.to_owned());
    }
}

impl Lines {
    /// Adds a client that may have a job to those that the worker asks for.
    pub fn add(&self, client: &str) {
        self.lock().add(client);
        self.arrival.notify_one();
    }

    /// Makes the tasks of a worker that wait for a job check again whether the worker is to stop.
    pub fn look(&self) {
        self.arrival.notify_one();
    }

    /// Returns the message of the next job, with the time within which its consumer expects a sign of life; `None` if
    /// `is_over` returns true while there is no job.
    pub async fn next(&self, exchange: &Exchange, is_over: impl Fn() -> bool) -> Option<(Message, Duration)> {
        self.idle.fetch_add(1, Relaxed);
        let mut asking = self.asking.lock().await;
        asking.resume().await;
        let next = self.next_of(&mut asking, exchange, is_over).await;
        // If no other concurrent solve of the worker waits for a job, pulls must give back what they bring, and no
        // announcement of a job is wanted.
        if self.idle.fetch_sub(1, Relaxed) == 1 {
            asking.put_aside();
            if let Some(offer) = asking.offer.take() {
                exchange.take_back(offer).await;
            }
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
            if self.lock().has_next() {
                self.learn_in_time(asking, exchange).await;
            }
            let next = self.lock().next();
            let (client, message) = if let Some(client) = next {
                // The client is removed from those that may have a job before its JetStream consumer is asked, so that
                // an announcement meanwhile adds it again.
                self.lock().may.remove(&client);
                let message = asking.ask(exchange, &client).await;
                (client, message)
            } else {
                asking.listen(exchange).await;
                let look = *asking.look.get_or_insert_with(|| Instant::now() + LOOK);
                tokio::select! {
                    Some((client, message)) = asking.pulls.next() => {
                        if message.is_some() {
                            self.lock().goes_last(&client);
                        }
                        (client, message)
                    }
                    Some(announcement) = OptionFuture::from(asking.offer.as_mut().map(StreamExt::next)) => {
                        asking.offer = None;
                        match OptionFuture::from(announcement.map(|it| exchange.hear_announcement(it))).await.flatten() {
                            Some(Told::Soon(client)) => asking.wait_for(exchange, client).await,
                            Some(Told::There(client)) => self.lock().add(&client),
                            None => {}
                        }
                        continue;
                    }
                    Some(clients) = OptionFuture::from(asking.question.as_mut().map(|question| &mut question.0)) => {
                        asking.question = None;
                        asking.told = Some(Instant::now());
                        self.lock().learn(clients);
                        continue;
                    }
                    () = self.arrival.notified() => continue,
                    () = sleep_until(look) => {
                        asking.look = None;
                        asking.question = Some(Question(exchange.ask_lines(true)));
                        continue;
                    }
                }
            };
            if let Some(message) = message {
                let wait =
                    asking.consumers.get(&client).map_or(LOOK, |consumer| consumer.cached_info().config.ack_wait);
                // If the JetStream consumer is known to have further messages of the client, the client stays one that
                // may have a job.
                if message.info().is_ok_and(|info| info.pending > 0) {
                    self.lock().may.insert(client);
                }
                return Some((message, wait));
            }
        }
    }

    /// Asks gateways which clients have jobs, if the last answer is too old, and waits for the answer for a short time.
    async fn learn_in_time(&self, asking: &mut Asking, exchange: &Exchange) {
        if asking.told.is_some_and(|told| told.elapsed() < KNOWN) {
            return;
        }
        let is_new = asking.question.is_none();
        let question = asking.question.get_or_insert_with(|| Question(exchange.ask_lines(false)));
        // A question to gateways that was not answered in time is not waited for again.
        let most = if is_new { SOON } else { Duration::ZERO };
        if let Ok(clients) = timeout(most, &mut question.0).await {
            asking.question = None;
            asking.told = Some(Instant::now());
            self.lock().learn(clients);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Turns> {
        self.turns.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Asking {
    /// Asks the JetStream consumer of a client for the message of a job, without waiting for one to arrive.
    async fn ask(&mut self, exchange: &Exchange, client: &str) -> Option<Message> {
        let asked = async {
            // The request has no time limit: with one, the server would wait for a message to come.
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

    /// Subscribes to an announcement of a job, unless the worker does so already or a pull waits for an announced job.
    /// Also asks gateways which clients have jobs, since earlier announcements were missed.
    async fn listen(&mut self, exchange: &Exchange) {
        if self.offer.is_some() || !self.pulls.clients.is_empty() {
            return;
        }
        self.offer = exchange.offer().await;
        self.question = Some(Question(exchange.ask_lines(false)));
    }

    /// Starts a pull that waits for the message of the next job of a client.
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

    /// Starts a task that gives back to the NATS servers the messages that the waiting pulls bring from now on.
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
                            // If giving the message back fails, the servers deliver it again after a while.
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

    /// Ends the task that gives messages back, if it runs, and takes over its pulls that still wait.
    async fn resume(&mut self) {
        let Some(Aside { pulls, wanted }) = self.aside.take() else { return };
        // Sending fails if the task that gives messages back has ended by itself, which is harmless.
        let _ = wanted.send(());
        self.pulls = pulls.await.unwrap_or_default();
    }
}

impl Pulls {
    /// Returns the client and the message, if any, of the next pull that ends; `None` if no pull waits.
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
        lines.lock().add("c");
        assert_eq!(next().as_deref(), Some("c"));
        // A client whose job was brought by a waiting pull has had its turn, and goes to the end of the order.
        ["a", "b"].iter().for_each(|client| lines.lock().add(client));
        lines.lock().goes_last("a");
        assert_eq!(next().as_deref(), Some("b"));
        lines.lock().may.clear();
        assert_eq!(next(), None);
    }

    #[test]
    fn what_a_gateway_says_is_asked_for_and_without_a_gateway_all() {
        let lines = Lines::default();
        ["a", "b"].iter().for_each(|client| lines.add(client));
        lines.lock().may.clear();
        // The client `c` was not known to the worker.
        lines.lock().learn(Some(vec!["c".to_owned(), "b".to_owned()]));
        let next = || lines.lock().next();
        assert_eq!([next(), next(), next()].map(Option::unwrap), ["b", "c", "b"]);
        lines.lock().may.clear();
        assert!(!lines.lock().has_next());
        lines.lock().learn(None);
        assert_eq!([next(), next(), next()].map(Option::unwrap), ["a", "c", "b"]);
    }
}
