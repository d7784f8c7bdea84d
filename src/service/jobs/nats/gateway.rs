//! A gateway: it admits jobs to NATS servers, and answers requests for all jobs that any gateway has admitted.
//!
//! A job is written in an order in which each part can be found by those after it: the idempotency key, which
//! reserves the id; specification and entry; and the message in the queue. A gateway that dies in between leaves a
//! reserved id, which the client takes over when it repeats its request with the key, or an entry without a message,
//! which every gateway looks for.

use super::announcements::Announced;
use super::entry::{Entry, FORMAT, Versioned as _};
use super::errand::{Errand, bare};
use super::mirror::{Mirror, Told};
use super::options::Nats;
use super::parts::{Part, PartId};
use super::servers::{Away, Exchange, Trouble, away, job_key, job_of};
use super::texts::document_name;
use crate::digest::Digest;
use crate::jobs::{
    AdmissionError, Bounds, Client, Ended, Ending, Held, Job, JobId, Jobs, Key, Order, Record, Results, Solver, State,
    Unwritable,
};
use crate::metrics::Metrics;
use async_nats::jetstream::consumer::{DeliverPolicy, push};
use async_nats::jetstream::message::Message;
use futures_util::StreamExt;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::join;
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

/// The age from which the id reserved for an idempotency key, without a job, may be used by a repeated request: the
/// gateway that reserved it has died before it wrote the entry of the job.
const TAKE_OVER: Duration = Duration::from_secs(10);

/// The interval between two searches for waiting jobs without a message in the NATS queue, and the age from which the
/// message of a job is looked for.
const SWEEP: Duration = Duration::from_secs(60);
const UNQUEUED: Duration = Duration::from_secs(60);

/// The silence after which the bucket of states counts as completely read at the start of a gateway.
const SILENCE: Duration = Duration::from_secs(5);

/// The pause before a gateway repeats a read from or a write to the NATS servers that has failed.
const PAUSE: Duration = Duration::from_secs(1);

/// The connection of a gateway to the NATS servers, with what it knows of the jobs there.
#[derive(Debug)]
pub struct Far {
    pub exchange: Exchange,
    mirror: Mutex<Mirror>,
}

impl Far {
    /// Locks and returns the mirror: the last known state of each job on the NATS servers.
    pub fn mirror(&self) -> MutexGuard<'_, Mirror> {
        self.mirror.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The background tasks of a gateway, a service process that admits jobs for workers on other machines; dropping this
/// value ends them.
pub struct Gateway {
    _tasks: JoinSet<()>,
}

/// A job that is being written to the NATS servers; if that fails, or its client disconnects meanwhile, dropping this
/// value removes the job from the mirror and, unless it has an idempotency key, from the servers.
struct Posting<'a> {
    jobs: &'a Jobs,
    far: &'a Far,
    job: &'a Arc<Job>,
    is_posted: bool,
}

impl Drop for Posting<'_> {
    fn drop(&mut self) {
        if self.is_posted {
            return;
        }
        self.jobs.drop_from_mirror(self.far, self.job);
        // A client without an idempotency key does not know the job, which is therefore deleted; a client with a key
        // can repeat its request, and find the job.
        if self.job.key.is_none() {
            self.jobs.store.let_go(self.job);
        }
    }
}

/// The value that is stored for an idempotency key in the bucket of states.
#[derive(Debug, Serialize, Deserialize)]
struct Reserved {
    id: String,
    key: Key,
}

/// The job that an idempotency key stands for, or the id reserved for it.
enum Reservation {
    /// No job has been admitted under the idempotency key; a new job under it is to get this id, which is reserved
    /// for the key.
    Free(JobId),
    /// This job has been admitted under the idempotency key.
    Taken(Arc<Job>),
}

impl Gateway {
    /// Connects to the NATS servers, and reads the entries of all jobs.
    ///
    /// # Errors
    /// The servers do not answer, or refuse the connection.
    pub async fn open(
        bounds: Bounds,
        solver: Solver,
        options: &Nats,
        metrics: Arc<Metrics>,
    ) -> io::Result<(Arc<Jobs>, Self)> {
        let exchange = Exchange::join(options, "gateway").await?;
        let far = Far { exchange, mirror: Mutex::default() };
        let (forgotten, to_forget) = unbounded_channel();
        let jobs = Arc::new(Jobs::far(bounds, solver, far, forgotten, metrics)?);
        let mut tasks = JoinSet::new();
        let (read, is_read) = tokio::sync::oneshot::channel();
        let mirroring = Arc::clone(&jobs);
        tasks.spawn(async move { mirroring.follow_entries(read).await });
        // Receiving the signal cannot fail, since the task that reads the entries of jobs, and then sends it, outlives
        // this function.
        let _ = is_read.await;
        let [hearing, ending, counting, forgetting, sweeping, answering, reminding] = [0; 7].map(|_| Arc::clone(&jobs));
        tasks.spawn(async move { hearing.follow_progress().await });
        tasks.spawn(async move { ending.hear_ends().await });
        tasks.spawn(async move { counting.follow_parts().await });
        tasks.spawn(async move { forgetting.forget_expired(to_forget).await });
        tasks.spawn(async move { sweeping.sweep().await });
        tasks.spawn(async move { answering.answer_workers().await });
        tasks.spawn(async move { reminding.remind_workers().await });
        Ok((jobs, Self { _tasks: tasks }))
    }
}

impl Jobs {
    /// Admits a job to be solved on other machines, or returns the earlier job with the same idempotency key.
    pub(in crate::jobs) async fn submit_far(&self, far: &Far, order: Order) -> Result<Arc<Job>, AdmissionError> {
        far.exchange.near()?;
        self.admits(order.client, order.document.len())?;
        let (client, document) = (order.client, Arc::clone(&order.document));
        let announced = far.exchange.has_line(client).then(|| far.exchange.announce(client));
        let id = match &order.key {
            None => JobId::new(),
            Some(key) => match self.reserve(far, client, key).await? {
                Reservation::Free(id) => id,
                Reservation::Taken(job) => return Ok(job),
            },
        };
        let job = Arc::new(Job::elsewhere(id, order));
        {
            let mut mirror = far.mirror();
            let mut intake = self.lock();
            self.admit(&intake, client, document.len())?;
            if let Some(first) = self.store.index().insert(&job)? {
                return Ok(first);
            }
            mirror.admitted(id);
            intake.queue.push(client, Arc::clone(&job));
        }
        let mut posting = Posting { jobs: self, far, job: &job, is_posted: false };
        far.post(&job, &document, announced).await?;
        posting.is_posted = true;
        drop(posting);
        Ok(job)
    }

    /// Returns the job that the client has already posted under the idempotency key `key`.
    pub(in crate::jobs) async fn recall_far(
        &self,
        far: &Far,
        client: Client,
        key: &Key,
    ) -> Result<Option<Arc<Job>>, AdmissionError> {
        let Some(message) = far.exchange.last(&far.exchange.state, &reservation(client, key)).await? else {
            return Ok(None);
        };
        match self.reserved(far, key, &message.payload, None).await? {
            Reservation::Taken(job) => Ok(Some(job)),
            Reservation::Free(_) => Ok(None),
        }
    }

    async fn reserve(&self, far: &Far, client: Client, key: &Key) -> Result<Reservation, AdmissionError> {
        let id = JobId::new();
        let name = reservation(client, key);
        let text = serde_json::to_vec(&Reserved { id: id.to_string(), key: key.clone() }).unwrap_or_default();
        if far.exchange.create(&name, text).await?.is_some() {
            return Ok(Reservation::Free(id));
        }
        match far.exchange.last(&far.exchange.state, &name).await? {
            Some(message) => {
                let age = (Timestamp::now().as_second() - message.time.unix_timestamp()).max(0).unsigned_abs();
                self.reserved(far, key, &message.payload, Some(Duration::from_secs(age))).await
            }
            // The job of the idempotency key has been deleted between the two requests.
            None => Err(AdmissionError::KeyInUse),
        }
    }

    /// Returns the job that the idempotency key `key` stands for, or the id reserved for it, by its stored value
    /// `text`, which was written `age` ago.
    async fn reserved(
        &self,
        far: &Far,
        key: &Key,
        text: &[u8],
        age: Option<Duration>,
    ) -> Result<Reservation, AdmissionError> {
        let reserved: Reserved = serde_json::from_slice(text).map_err(|_| AdmissionError::KeyInUse)?;
        if reserved.key != *key {
            return Err(AdmissionError::KeyReused);
        }
        let id: JobId = reserved.id.parse().map_err(|_| AdmissionError::KeyInUse)?;
        if let Some(job) = self.look_up_far(far, id).await? {
            if matches!(job.state(), State::Accepted(_)) && !far.exchange.is_queued(id, job.client).await? {
                far.exchange.enqueue(id, job.client, bare(), None).await?;
            }
            return Ok(Reservation::Taken(job));
        }
        match age {
            Some(age) if age < TAKE_OVER => Err(AdmissionError::KeyInUse),
            _ => Ok(Reservation::Free(id)),
        }
    }

    /// Returns the job with this id, from memory or from the bucket of states.
    pub(in crate::jobs) async fn look_up_far(&self, far: &Far, id: JobId) -> Result<Option<Arc<Job>>, Away> {
        if let Some(job) = self.find(id) {
            return Ok(Some(job));
        }
        match far.exchange.entry(id).await {
            Ok(Some((entry, revision))) => Ok(self.take_over(far, id, entry, revision).await),
            Ok(None) | Err(Trouble::OtherVersion) => Ok(None),
            Err(Trouble::Away) => Err(Away),
        }
    }

    /// Dismisses a waiting job on the NATS servers, asks a running job to stop, and leaves an ended job unchanged.
    pub(in crate::jobs) async fn cancel_far(&self, far: &Far, job: &Arc<Job>) -> Result<(), Unwritable> {
        let id = job.id;
        let changed = far.exchange.change(id, None, |entry| {
            if entry.record.ended.is_some() || entry.record.dismissed {
                return false;
            }
            // A running job, or a sweep that is divided into chunks, is only marked as dismissed: a sweep keeps its
            // rows, and the worker that takes it next makes the table of them.
            if entry.claim.is_some() || entry.divided {
                entry.record.dismissed = true;
            } else {
                entry.record.ended = Some(Ended::unsolved(Ending::Dismissed));
            }
            true
        });
        let Some((entry, revision)) = changed.await.map_err(|_| Unwritable)? else { return Ok(()) };
        if entry.record.ended.is_none() {
            self.ask_to_stop(far, id).await.map_err(|Away| Unwritable)?;
        } else {
            // If removing the message fails, a worker that takes it finds that the job has ended.
            let _ = far.exchange.dequeue(id, job.client).await;
        }
        self.take_over(far, id, entry, revision).await;
        Ok(())
    }

    async fn ask_to_stop(&self, far: &Far, id: JobId) -> Result<(), Away> {
        let asked = far.exchange.state.put(format!("cancel.{id}"), "".into()).await;
        asked.map(|_| ()).map_err(|error| away(&error))
    }

    /// Cancels a job and deletes it from the NATS servers and from memory.
    pub(in crate::jobs) async fn forget_far(&self, far: &Far, job: &Arc<Job>) -> Result<(), Unwritable> {
        // The job leaves the queue of this process before the NATS servers confirm its deletion.
        self.take_out(job);
        self.erase_far(far, job).await.map_err(|Away| Unwritable)?;
        self.take_away(far, job.id, 0, Timestamp::now());
        Ok(())
    }

    /// Removes a job from the NATS servers; its entry first, without which no worker can write the end of the job.
    async fn erase_far(&self, far: &Far, job: &Job) -> Result<(), Away> {
        let (exchange, id) = (&far.exchange, job.id);
        let entry = exchange.entry(id).await.ok().flatten().map(|(entry, _)| entry);
        exchange.near()?;
        exchange.state.purge(job_key(id)).await.map_err(|error| away(&error))?;
        if entry.as_ref().is_some_and(|entry| entry.claim.is_some()) {
            self.ask_to_stop(far, id).await?;
        }
        let attempts = entry.map_or(0, |entry| entry.record.crashes) + 1;
        let document = document_name(id);
        let (dequeued, document) = join!(exchange.dequeue(id, job.client), exchange.remove(&document));
        dequeued.and(document)?;
        for attempt in 1..=attempts {
            exchange.remove_results(id, attempt).await?;
        }
        if job.members().is_some() {
            exchange.clear_parts(id).await?;
        }
        exchange.clear(&format!("progress.{id}")).await?;
        match &job.key {
            Some(key) => exchange.clear(&reservation(job.client, key)).await,
            None => Ok(()),
        }
    }

    /// Returns the posted specification of a job from the NATS servers, after a check of its digest.
    pub(in crate::jobs) async fn document_far(&self, far: &Far, job: &Job) -> io::Result<Arc<[u8]>> {
        let document = far.exchange.document(job.id).await?;
        let damaged = || io::Error::new(io::ErrorKind::InvalidData, "its digest is not known");
        job.digest.get().ok_or_else(damaged)?.vouch(document).map(Arc::from)
    }

    /// Returns the results of a job, from memory or from the NATS servers.
    pub(in crate::jobs) async fn results_far(&self, far: &Far, job: &Job, held: &Held) -> io::Result<Arc<Results>> {
        let short = far.mirror().short_results(job.id);
        match short {
            Some(json) => Results::vouched(json.get().as_bytes().to_vec(), held.digest()).map(Arc::new),
            None => far.exchange.results(job.id, job.attempt(), held).await,
        }
    }

    /// Removes the remaining entries of jobs that were deleted long ago from the bucket of states.
    pub(in crate::jobs) async fn expire_far(&self, far: &Far, now: Timestamp) {
        let gone = far.mirror().forget_gone(now);
        for id in gone {
            if far.exchange.clear(&job_key(id)).await.is_err() {
                return;
            }
        }
    }

    /// At the stop of this gateway, wakes the requests that wait for the end of a job: they are answered with the
    /// address of the job, which another gateway serves.
    pub(in crate::jobs) fn leave_far(&self) {
        for job in self.all() {
            let mut lifecycle = job.lock();
            if !matches!(lifecycle.state, State::Ended(_)) {
                lifecycle.parked = true;
                drop(lifecycle);
                job.wake();
            }
        }
    }

    /// Keeps the mirror (the last known state of each job) up to date with the entries of jobs; signals on `read` when
    /// all existing entries have been read.
    async fn follow_entries(&self, read: tokio::sync::oneshot::Sender<()>) {
        let Some(far) = &self.far else { return };
        let mut read = Some(read);
        loop {
            match entries(&far.exchange).await {
                Ok((mut messages, mut left)) => {
                    if left == 0 {
                        let _ = read.take().map(|read| read.send(()));
                    }
                    loop {
                        let next = messages.next();
                        // Entries of jobs that change while they are read are delivered later, so that fewer come now
                        // than were counted, and a time limit on silence ends the wait for them.
                        let next = if read.is_some() { timeout(SILENCE, next).await.ok() } else { Some(next.await) };
                        match next {
                            None => {
                                let _ = read.take().map(|read| read.send(()));
                            }
                            Some(None) => break,
                            Some(Some(Err(error))) => tracing::debug!(%error, "entries are late"),
                            Some(Some(Ok(message))) => {
                                self.entry_came(far, &message).await;
                                left = left.saturating_sub(1);
                                if left == 0 {
                                    let _ = read.take().map(|read| read.send(()));
                                }
                            }
                        }
                    }
                }
                Err(error) => {
                    tracing::warn!(%error, "the entries of jobs cannot be followed yet");
                    sleep(PAUSE).await;
                }
            }
        }
    }

    async fn entry_came(&self, far: &Far, message: &Message) {
        let Some(id) = job_of(&message.subject) else { return };
        let Ok(info) = message.info() else { return };
        let revision = info.stream_sequence;
        let operation = message.headers.as_ref().and_then(|headers| headers.get("KV-Operation"));
        if operation.is_some_and(|what| what.as_str() != "PUT") {
            let when = Timestamp::from_second(info.published.unix_timestamp()).unwrap_or_default();
            return self.take_away(far, id, revision, when);
        }
        match Entry::read(&message.payload) {
            Some(entry) => {
                self.take_over(far, id, entry, revision).await;
            }
            None => tracing::warn!(job.id = %id, "the entry of job {id} was written by another version than {FORMAT}"),
        }
    }

    /// Receives the ends of jobs in messages from the workers that have written them; the messages come earlier than
    /// the changes of the entries.
    async fn hear_ends(&self) {
        let Some(far) = &self.far else { return };
        let mut ends = far.exchange.hear("ended", "*").await;
        while let Some(message) = ends.next().await {
            if let (Some(id), Some(end)) = (job_of(&message.subject), Errand::read(&message.payload)) {
                self.take_over(far, id, end.entry, end.revision).await;
            }
        }
    }

    /// Keeps count of the waiting and the claimed chunks of shared sweeps, by the changes of their entries.
    async fn follow_parts(&self) {
        let Some(far) = &self.far else { return };
        let came = |key: &str, text: Option<&[u8]>| {
            if let Some(id) = PartId::of(key) {
                far.mirror().part_came(id, text.and_then(Part::read).as_ref());
            }
        };
        far.exchange.follow("part.*.*", came).await;
    }

    /// Receives the progress of running jobs, including those that started before this gateway.
    async fn follow_progress(&self) {
        let Some(far) = &self.far else { return };
        let exchange = &far.exchange;
        let mut progress = exchange.hear("progress", "*").await;
        let running = far.mirror().running_jobs();
        for id in running {
            if let Ok(Some(told)) = exchange.last(&exchange.state, &format!("progress.{id}")).await
                && let Ok(told) = serde_json::from_slice(&told.payload)
            {
                self.hear(id, told);
            }
        }
        while let Some(message) = progress.next().await {
            let id = job_of(&message.subject);
            if let (Some(id), Ok(told)) = (id, serde_json::from_slice::<Told>(&message.payload)) {
                self.hear(id, told);
            }
        }
    }

    /// Removes from the NATS servers the jobs that this gateway has removed from memory to make room.
    async fn forget_expired(&self, mut forgotten: UnboundedReceiver<Arc<Job>>) {
        let Some(far) = &self.far else { return };
        while let Some(job) = forgotten.recv().await {
            while self.erase_far(far, &job).await.is_err() {
                sleep(PAUSE).await;
            }
            self.take_away(far, job.id, 0, Timestamp::now());
        }
    }

    /// Looks for waiting jobs that have an entry and no message, and puts them into the NATS queue: their gateway died
    /// before it had written the message. Each job is looked for once.
    async fn sweep(&self) {
        let Some(far) = &self.far else { return };
        let mut looked_for = None;
        loop {
            sleep(SWEEP).await;
            let mut waiting = self.all();
            waiting.retain(|job| {
                let age = Timestamp::now().duration_since(job.created.date).try_into().unwrap_or(Duration::ZERO);
                let is_new = looked_for.is_none_or(|last| job.id > last);
                is_new && age > UNQUEUED && matches!(job.lock().state, State::Accepted(_)) && job.is_durable()
            });
            waiting.sort_unstable_by_key(|job| job.id);
            for job in waiting {
                match far.exchange.is_queued(job.id, job.client).await {
                    Ok(true) => {}
                    // A worker may have taken and ended the job since the mirror of the entries was last updated, so
                    // that its entry is read.
                    Ok(false) => {
                        if let Ok(Some((entry, _))) = far.exchange.entry(job.id).await
                            && entry.claim.is_none()
                            && entry.record.ended.is_none()
                        {
                            tracing::warn!(job.id = %job.id, "job {} is put into the queue again", job.id);
                            if far.exchange.enqueue(job.id, job.client, bare(), None).await.is_err() {
                                break;
                            }
                        }
                    }
                    Err(Away) => break,
                }
                looked_for = Some(job.id);
            }
        }
    }
}

impl Far {
    /// Writes the specification, the entry and the message of a job that has been admitted.
    async fn post(&self, job: &Arc<Job>, document: &Arc<[u8]>, announced: Option<Announced>) -> Result<(), Away> {
        let exchange = &self.exchange;
        job.digest.get_or_init(|| Digest::of(document));
        let entry = Entry::waiting(Record::of(job, &job.lock())).with_document(document);
        let (name, key) = (document_name(job.id), job_key(job.id));
        let written =
            async { if entry.document.is_some() { Ok(()) } else { exchange.put(&name, document.to_vec()).await } };
        let (opened, written, created) =
            join!(exchange.open_line(job.client), written, exchange.create(&key, entry.text()));
        opened.and(written)?;
        // There is no revision if the entry of the job exists already: an earlier attempt has written it, and the
        // answer of the servers was lost.
        let text = created?.map_or_else(bare, |revision| Errand::text(&entry, revision));
        exchange.enqueue(job.id, job.client, text, announced).await
    }
}

impl Exchange {
    /// Removes a key of the bucket of states, including its history.
    ///
    /// # Errors
    /// The servers do not answer.
    pub async fn clear(&self, key: &str) -> Result<(), Away> {
        self.near()?;
        let filter = format!("{}{key}", self.state.prefix);
        self.state.stream.purge().filter(filter).await.map(|_| ()).map_err(|error| away(&error))
    }
}

/// Subscribes to the entries of all jobs, first the latest of each and then each change; also returns the number of
/// existing entries.
async fn entries(exchange: &Exchange) -> Result<(push::Ordered, u64), async_nats::Error> {
    exchange.near()?;
    let config = push::OrderedConfig {
        deliver_subject: exchange.client.new_inbox(),
        filter_subject: format!("{}job.*", exchange.state.prefix),
        deliver_policy: DeliverPolicy::LastPerSubject,
        ..push::OrderedConfig::default()
    };
    let consumer = exchange.state.stream.create_consumer(config).await?;
    let count = consumer.cached_info().num_pending;
    Ok((consumer.messages().await?, count))
}

/// Returns the key of the bucket of states for an idempotency key: a digest of its text, which may have characters that
/// a NATS subject must not have.
fn reservation(client: Client, key: &Key) -> String {
    format!("key.{}.{}", client.token(), Digest::of(key.name.as_bytes()))
}
