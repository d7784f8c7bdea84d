//! Announcements: how a worker that has nothing to do hears of a job, at a cost that does not grow with the number of workers.
//!
//! A worker that has nothing to do *offers* itself: it listens in a queue group, for one announcement, and the server gives each
//! announcement to one of those that listen. It then waits at the line of the client, or looks there, and offers itself again
//! if there is nothing. Announcements that come while no worker listens are dropped, so a worker that begins to listen asks a
//! gateway which clients have jobs, and so does one that goes from job to job, now and then: all gateways know. Without a
//! gateway, it asks all lines.
//!
//! 1. A job is announced before it is written, so that a pull waits when its message comes. The worker answers.
//! 2. If none has answered when the message is in its line, the job is announced again, as one that is there: all workers
//!    were busy, or the one that was told is lost.
//! 3. Gateways remind of clients whose jobs still wait: the one that was told may be lost, or another has given a job back.

use super::gateway::Far;
use super::servers::Exchange;
use crate::jobs::{Client, Jobs};
use async_nats::client::RequestErrorKind;
use async_nats::{Message, Subscriber};
use futures_util::StreamExt;
use futures_util::future::{BoxFuture, FutureExt};
use std::collections::HashSet;
use std::time::Duration;
use tokio::task::JoinHandle;
use tokio::time::{Instant, interval, sleep, timeout};

/// The time for which a pull waits for a job that was announced: long beside the writes of a job.
pub const WAIT: Duration = Duration::from_millis(200);

/// The interval at which gateways remind of jobs that wait.
const REMIND: Duration = Duration::from_millis(250);

/// The largest number of clients that are named at a time, so that the cost is bounded. Later ones have their turn when those
/// before them have had theirs.
const MOST_NAMED: usize = 256;

/// The number of clients of running jobs in an answer to an idle worker: one of these jobs may have lost its worker, and nobody
/// announces the message that then comes again. Each answer names the next.
const MOST_AGAIN: usize = 2;

/// The time that a gateway has to answer.
const ANSWER: Duration = Duration::from_secs(5);

/// The pause before something is tried again.
const PAUSE: Duration = Duration::from_secs(1);

/// The queue groups of workers and of gateways.
const WORKERS: &str = "workers";
const GATEWAYS: &str = "gateways";

/// What an announcement says of a job that is in its line already.
const THERE: &[u8] = b"there";

/// What a worker asks that has had nothing to do for a while.
const AGAIN: &[u8] = b"again";

/// An announcement of a job that is still to be written.
#[derive(Debug)]
pub struct Announced {
    begun: Instant,
    answer: JoinHandle<bool>,
}

impl Announced {
    /// Whether a worker waits for the job, as far as is known.
    async fn heard(self) -> bool {
        if !self.answer.is_finished() {
            self.answer.abort();
            return false;
        }
        // Its pull must not end before the message comes.
        self.begun.elapsed() < WAIT / 2 && self.answer.await.unwrap_or(false)
    }
}

/// What a worker has been told by an announcement.
#[derive(Debug, PartialEq, Eq)]
pub enum Told {
    /// A job of this client is about to arrive.
    Soon(String),
    /// A job of this client is there.
    There(String),
}

/// The clients that may have jobs; `None` if no gateway says so.
pub type Answer = BoxFuture<'static, Option<Vec<String>>>;

impl Exchange {
    /// Announces a job that is about to be written.
    pub fn announce(&self, client: Client) -> Announced {
        let (connection, subject) = (self.client.clone(), self.subject("arrival", client.token()));
        let answer = tokio::spawn(async move { connection.request(subject, "".into()).await.is_ok() });
        Announced { begun: Instant::now(), answer }
    }

    /// Announces a job that is in its line, unless a worker waits for it.
    pub async fn announce_again(&self, client: Client, announced: Announced) {
        if !announced.heard().await {
            self.remind(client).await;
        }
    }

    async fn remind(&self, client: Client) {
        let _ = self.client.publish(self.subject("arrival", client.token()), THERE.into()).await;
    }

    /// Listens for one announcement.
    pub async fn offer(&self) -> Option<Subscriber> {
        let mut offer = self.client.queue_subscribe(self.subject("arrival", "*"), WORKERS.to_owned()).await.ok()?;
        offer.unsubscribe_after(1).await.ok()?;
        Some(offer)
    }

    /// Takes an announcement.
    pub async fn hear_announcement(&self, announcement: Message) -> Option<Told> {
        let client = announcement.subject.rsplit_once('.')?.1.to_owned();
        if &*announcement.payload == THERE {
            return Some(Told::There(client));
        }
        if let Some(reply) = announcement.reply {
            let _ = self.client.publish(reply, "".into()).await;
        }
        Some(Told::Soon(client))
    }

    /// Takes an offer back. An announcement that has come meanwhile is passed on as that of a job that is there; one that is on
    /// its way has no answer.
    pub async fn take_back(&self, mut offer: Subscriber) {
        if let Some(Some(announcement)) = offer.next().now_or_never() {
            let _ = self.client.publish(announcement.subject, THERE.into()).await;
        }
    }

    /// Asks a gateway which clients have jobs that wait; `again` asks for some that run as well.
    pub fn ask_lines(&self, again: bool) -> Answer {
        let (connection, subject) = (self.client.clone(), self.subject("lines", "all"));
        let question = if again { AGAIN } else { b"" };
        async move {
            match timeout(ANSWER, connection.request(subject, question.into())).await {
                Ok(Ok(answer)) => serde_json::from_slice(&answer.payload).ok(),
                Ok(Err(error)) if error.kind() == RequestErrorKind::NoResponders => None,
                Ok(Err(error)) => {
                    tracing::debug!(%error, "no gateway says which clients have jobs");
                    None
                }
                Err(_) => None,
            }
        }
        .boxed()
    }
}

impl Jobs {
    /// Tells workers which clients have jobs.
    pub(super) async fn answer_workers(&self) {
        let Some(far) = &self.far else { return };
        let exchange = &far.exchange;
        loop {
            let subject = exchange.subject("lines", "all");
            if let Ok(mut questions) = exchange.client.queue_subscribe(subject, GATEWAYS.to_owned()).await {
                while let Some(question) = questions.next().await {
                    let Some(reply) = question.reply else { continue };
                    let mut clients = self.waiting_clients(far);
                    if &*question.payload == AGAIN {
                        clients.extend(far.mirror().next_running(MOST_AGAIN));
                    }
                    let tokens: Vec<String> = clients.into_iter().map(Client::token).collect();
                    let text = serde_json::to_vec(&tokens).unwrap_or_default();
                    let _ = exchange.client.publish(reply, text.into()).await;
                }
            }
            sleep(PAUSE).await;
        }
    }

    /// Reminds of clients whose jobs have waited for a while.
    pub(super) async fn remind_workers(&self) {
        let Some(far) = &self.far else { return };
        let mut ticks = interval(REMIND);
        let mut before: HashSet<Client> = HashSet::new();
        loop {
            ticks.tick().await;
            let waiting = self.waiting_clients(far);
            if far.exchange.is_near() {
                for client in waiting.iter().filter(|client| before.contains(client)) {
                    far.exchange.remind(*client).await;
                }
            }
            before = waiting.into_iter().collect();
        }
    }

    /// The clients with jobs or chunks that wait.
    fn waiting_clients(&self, far: &Far) -> Vec<Client> {
        let sweeps = far.mirror().sweeps_that_wait(MOST_NAMED);
        let mut clients: Vec<Client> =
            sweeps.into_iter().filter_map(|id| self.find(id)).map(|job| job.client).collect();
        clients.extend(self.lock().queue.in_turn().take(MOST_NAMED));
        let mut known = HashSet::new();
        clients.retain(|client| known.insert(*client));
        clients
    }
}
