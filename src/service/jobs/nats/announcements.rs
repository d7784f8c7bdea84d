//! Announcements of jobs to idle workers over NATS, at a cost that does not grow with the number of workers.
//!
//! An idle worker *offers* itself: it listens in a queue group for one announcement, and the server gives each
//! announcement to one of the listening workers. The worker then waits for the message of the job in the queue of the
//! client, or fetches it, and offers itself again if there is none. Announcements that come while no worker listens
//! are dropped, so that a worker that begins to listen asks a gateway for the clients that have jobs, and so does,
//! now and then, a worker that goes from job to job: every gateway knows these clients. If no gateway answers, the
//! worker asks for jobs of all clients.
//!
//! 1. A job is announced before its message is written, so that a pull is waiting when the message comes. The worker
//!    confirms the announcement.
//! 2. If no worker has confirmed it when the message has been written, the job is announced again, as one that can be
//!    fetched: all workers were busy, or the worker that got the announcement is lost.
//! 3. Gateways repeat announcements for clients whose jobs still wait: a worker that got an announcement may be lost,
//!    or a worker has given a job back.

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

/// The time for which a worker's pull waits at the JetStream consumer for the message of a job that was announced: long
/// compared with the writes of a job.
pub const WAIT: Duration = Duration::from_millis(200);

/// The interval at which gateways repeat the announcements of jobs for clients whose jobs still wait for a worker.
const REMIND: Duration = Duration::from_millis(250);

/// The largest number of clients named in one answer of a gateway to a worker, so that the cost is bounded. Later
/// clients are named when the jobs of those before them have been taken.
const MOST_NAMED: usize = 256;

/// The number of clients of running jobs that a gateway names to an idle worker in one answer: a running job may have
/// lost its worker, and its redelivered message is not announced. Each answer names the next clients.
const MOST_AGAIN: usize = 2;

/// The time limit for a gateway to answer a worker which clients have jobs.
const ANSWER: Duration = Duration::from_secs(5);

/// The pause before a failed request to the NATS servers is repeated.
const PAUSE: Duration = Duration::from_secs(1);

/// The NATS queue groups of workers and of gateways.
const WORKERS: &str = "workers";
const GATEWAYS: &str = "gateways";

/// The payload of an announcement of a job whose message has been written.
const THERE: &[u8] = b"there";

/// The payload of the question of a worker that has been idle for a while and asks gateways again which clients have
/// jobs.
const AGAIN: &[u8] = b"again";

/// An announcement of a job to idle workers before its message is written to the NATS queue.
#[derive(Debug)]
pub struct Announced {
    begun: Instant,
    answer: JoinHandle<bool>,
}

impl Announced {
    /// Whether a worker has confirmed the announcement of the job, and still waits for the message of the job.
    async fn heard(self) -> bool {
        if !self.answer.is_finished() {
            self.answer.abort();
            return false;
        }
        // An announcement made long ago does not count: the worker's pull might end before the message of the job
        // comes.
        self.begun.elapsed() < WAIT / 2 && self.answer.await.unwrap_or(false)
    }
}

/// The content of the announcement of a job to an idle worker.
#[derive(Debug, PartialEq, Eq)]
pub enum Told {
    /// A job of this client is about to be put into the NATS queue.
    Soon(String),
    /// A job of this client is in the NATS queue and can be fetched.
    There(String),
}

/// A pending answer of a gateway to a worker: the clients that may have jobs; `None` if no gateway answers.
pub type Answer = BoxFuture<'static, Option<Vec<String>>>;

impl Exchange {
    /// Announces to idle workers a job of `client` whose message is about to be written to the NATS queue.
    pub fn announce(&self, client: Client) -> Announced {
        let (connection, subject) = (self.client.clone(), self.subject("arrival", client.token()));
        let answer = tokio::spawn(async move { connection.request(subject, "".into()).await.is_ok() });
        Announced { begun: Instant::now(), answer }
    }

    /// Announces a job of `client` whose message has been written, unless a worker has confirmed the earlier
    /// announcement and waits for the message.
    pub async fn announce_again(&self, client: Client, announced: Announced) {
        if !announced.heard().await {
            self.remind(client).await;
        }
    }

    async fn remind(&self, client: Client) {
        let _ = self.client.publish(self.subject("arrival", client.token()), THERE.into()).await;
    }

    /// Subscribes to one announcement of a job, as an idle worker does.
    pub async fn offer(&self) -> Option<Subscriber> {
        let mut offer = self.client.queue_subscribe(self.subject("arrival", "*"), WORKERS.to_owned()).await.ok()?;
        offer.unsubscribe_after(1).await.ok()?;
        Some(offer)
    }

    /// Reads an announcement, and confirms it if the message of the job has yet to be written.
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

    /// Stops listening for an announcement of a job. An announcement that has come meanwhile is passed on to another
    /// worker as that of a job that can be fetched; one that is on its way stays unconfirmed.
    pub async fn take_back(&self, mut offer: Subscriber) {
        if let Some(Some(announcement)) = offer.next().now_or_never() {
            let _ = self.client.publish(announcement.subject, THERE.into()).await;
        }
    }

    /// Asks a gateway for the clients with waiting jobs; `again` asks for some clients with running jobs as well.
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
    /// Answers, as a gateway, the questions of workers for the clients that have jobs.
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

    /// Repeats the announcements of jobs for clients whose jobs have waited for a worker for a while.
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

    /// Returns the clients with waiting jobs, or waiting chunks of sweeps, that this gateway knows.
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
