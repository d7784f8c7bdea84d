//! The connection to the NATS servers, and the stream of messages and the buckets that are stored there.

use super::announcements::Announced;
use super::entry::{Entry, Versioned};
use super::options::Nats;
use crate::jobs::{Client, JobId};
use async_nats::connection::State;
use async_nats::jetstream::consumer::{AckPolicy, pull};
use async_nats::jetstream::context::ContextBuilder;
use async_nats::jetstream::kv::{self, CreateErrorKind, UpdateErrorKind};
use async_nats::jetstream::object_store::{self, ObjectStore};
use async_nats::jetstream::stream::{DiscardPolicy, LastRawMessageErrorKind, RetentionPolicy, StorageType, Stream};
use async_nats::jetstream::{Context, message, stream};
use async_nats::{ConnectErrorKind, ConnectOptions};
use std::collections::HashSet;
use std::fmt;
use std::io;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use thiserror::Error;
use tokio::time::{Instant, sleep};

/// The error that the NATS servers do not answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("the NATS servers do not answer")]
pub struct Away;

impl From<Away> for io::Error {
    fn from(away: Away) -> Self {
        Self::new(io::ErrorKind::NotConnected, away)
    }
}

/// The reason why an entry of the bucket of states could not be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// The NATS servers do not answer the request.
    Away,
    /// Another version of the program wrote the entry.
    OtherVersion,
}

impl From<Away> for Trouble {
    fn from(_: Away) -> Self {
        Self::Away
    }
}

impl From<Trouble> for Away {
    fn from(_: Trouble) -> Self {
        Self
    }
}

/// The time limit for an answer of the NATS servers, and that of the connection at the start of the process.
const ANSWER: Duration = Duration::from_secs(5);
const PATIENCE: Duration = Duration::from_secs(60);

/// The interval of pings to the NATS servers; after two unanswered pings the connection counts as lost.
const PING: Duration = Duration::from_secs(10);

/// The first and the longest pause between attempts to connect to the NATS servers.
const FIRST_PAUSE: Duration = Duration::from_millis(50);
const LONGEST_PAUSE: Duration = Duration::from_secs(4);

/// The time for which JetStream rejects messages with the id of an earlier message.
const REMEMBERED: Duration = Duration::from_secs(120);

/// The largest number of running jobs of one client that its consumer allows, larger than any pool of workers.
const MOST_RUNNING: i64 = 100_000;

/// The largest text that is stored as one message, in bytes. By default, NATS servers accept messages of up to 1 MiB,
/// including their headers.
pub const ONE_MESSAGE: usize = (1 << 20) - (4 << 10);

/// The connection to the NATS servers, with the stream and the buckets that gateways and workers share.
pub struct Exchange {
    pub name: String,
    pub client: async_nats::Client,
    pub jetstream: Context,
    pub messages: Stream,
    pub state: kv::Store,
    pub data: kv::Store,
    pub objects: ObjectStore,
    /// The time without a sign of life after which a worker counts as lost.
    pub lost_after: Duration,
    /// The time at which the NATS servers were last connected: shortly afterwards, a missing answer of another process
    /// says little.
    connected: Arc<Mutex<Instant>>,
    /// The clients whose subjects are known to have a JetStream consumer.
    lines: Mutex<HashSet<String>>,
}

impl fmt::Debug for Exchange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Exchange").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Exchange {
    /// Connects to the NATS servers, and creates the stream and the buckets if they do not exist. `role` is a part of
    /// the connection's name, which the administrator of the servers sees.
    ///
    /// # Errors
    /// The options are invalid, the servers do not answer within a minute, or they refuse.
    pub async fn join(options: &Nats, role: &str) -> io::Result<Self> {
        options.check()?;
        let connected = Arc::new(Mutex::new(Instant::now()));
        let client = connect(options, role, &connected).await?;
        let jetstream = ContextBuilder::new().timeout(ANSWER).ack_timeout(ANSWER).build(client.clone());
        let begun = Instant::now();
        // The servers of a cluster that has just been started have to elect a leader first.
        let (messages, state, data, objects) = loop {
            match create(&jetstream, options).await {
                Ok(created) => break created,
                Err(error) if begun.elapsed() > PATIENCE => {
                    return Err(io::Error::other(format!("JetStream of the NATS servers: {error}")));
                }
                Err(error) => {
                    tracing::warn!(%error, "the streams are not there yet");
                    sleep(Duration::from_secs(1)).await;
                }
            }
        };
        let (name, lost_after) = (options.name.clone(), options.lost_after());
        Ok(Self {
            name,
            client,
            jetstream,
            messages,
            state,
            data,
            objects,
            lost_after,
            connected,
            lines: Mutex::default(),
        })
    }

    /// Whether the NATS servers are connected.
    pub fn is_near(&self) -> bool {
        self.client.connection_state() == State::Connected
    }

    /// Returns the time for which the connection to the NATS servers has been up; zero if it is down.
    pub fn connected_for(&self) -> Duration {
        if self.is_near() {
            self.connected.lock().unwrap_or_else(PoisonError::into_inner).elapsed()
        } else {
            Duration::ZERO
        }
    }

    /// Returns an error at once if the servers are not connected, since a request would wait until its time limit.
    ///
    /// # Errors
    /// The servers are not connected.
    pub fn near(&self) -> Result<(), Away> {
        if self.is_near() { Ok(()) } else { Err(Away) }
    }

    /// Returns the core NATS subject `NAME.kind.of`, where `NAME` is the name that gateways and workers share.
    pub fn subject(&self, kind: &str, of: impl fmt::Display) -> String {
        format!("{}.{kind}.{of}", self.name)
    }

    /// Returns the entry of a job, and its revision, as the leader of the servers has it; `None` if there is none.
    ///
    /// # Errors
    /// See [`Trouble`].
    pub async fn entry(&self, id: JobId) -> Result<Option<(Entry, u64)>, Trouble> {
        self.read(&job_key(id)).await
    }

    /// Returns the object stored under a key of the bucket of states, and its revision; `None` if there is none.
    ///
    /// # Errors
    /// See [`Trouble`].
    pub async fn read<E: Versioned>(&self, key: &str) -> Result<Option<(E, u64)>, Trouble> {
        let Some(message) = self.last(&self.state, key).await? else { return Ok(None) };
        let entry = E::read(&message.payload).ok_or(Trouble::OtherVersion)?;
        Ok(Some((entry, message.sequence)))
    }

    /// Returns the latest value of a key, as the leader of the servers has it, so that it includes every completed
    /// write.
    ///
    /// # Errors
    /// The servers do not answer.
    pub async fn last(&self, bucket: &kv::Store, key: &str) -> Result<Option<message::StreamMessage>, Away> {
        self.near()?;
        match bucket.stream.get_last_raw_message_by_subject(&format!("{}{key}", bucket.prefix)).await {
            Ok(message) if message.headers.get("KV-Operation").is_some_and(|what| what.as_str() != "PUT") => Ok(None),
            Ok(message) => Ok(Some(message)),
            Err(error) if error.kind() == LastRawMessageErrorKind::NoMessageFound => Ok(None),
            Err(error) => Err(away(&error)),
        }
    }

    /// Creates an entry in the bucket of states; returns its revision, or `None` if the key has an entry already.
    ///
    /// # Errors
    /// The servers do not answer.
    pub async fn create(&self, key: &str, text: Vec<u8>) -> Result<Option<u64>, Away> {
        self.near()?;
        match self.state.create(key, text.into()).await {
            Ok(revision) => Ok(Some(revision)),
            Err(error) if error.kind() == CreateErrorKind::AlreadyExists => Ok(None),
            Err(error) => Err(away(&error)),
        }
    }

    /// Applies `change` to the entry of a job, and writes the entry if `change` returns true, again if it was changed
    /// meanwhile. Returns the entry with its revision; `None` if there is none. `known` is the entry as last seen,
    /// with its revision.
    ///
    /// # Errors
    /// See [`Trouble`].
    pub async fn change(
        &self,
        id: JobId,
        known: Option<(Entry, u64)>,
        change: impl FnMut(&mut Entry) -> bool,
    ) -> Result<Option<(Entry, u64)>, Trouble> {
        self.alter(&job_key(id), known, change).await
    }

    /// Applies `change` to the object under a key of the bucket of states, as [`Exchange::change`] does to an entry.
    ///
    /// # Errors
    /// See [`Trouble`].
    pub async fn alter<E: Versioned>(
        &self,
        key: &str,
        mut known: Option<(E, u64)>,
        mut change: impl FnMut(&mut E) -> bool,
    ) -> Result<Option<(E, u64)>, Trouble> {
        loop {
            let found = match known.take() {
                Some(known) => Some(known),
                None => self.read(key).await?,
            };
            let Some((mut entry, revision)) = found else { return Ok(None) };
            if !change(&mut entry) {
                return Ok(Some((entry, revision)));
            }
            self.near()?;
            match self.state.update(key, entry.text().into(), revision).await {
                Ok(revision) => return Ok(Some((entry, revision))),
                Err(error) if error.kind() == UpdateErrorKind::WrongLastRevision => {}
                Err(error) => return Err(away(&error).into()),
            }
        }
    }

    /// Makes sure that the jobs of a client have a consumer, and that workers know of it.
    ///
    /// # Errors
    /// The servers do not answer.
    pub async fn open_line(&self, client: Client) -> Result<(), Away> {
        let token = client.token();
        if self.lines().contains(&token) {
            return Ok(());
        }
        self.near()?;
        let config = pull::Config {
            durable_name: Some(token.clone()),
            filter_subject: format!("{}.jobs.{token}.*", self.name),
            ack_policy: AckPolicy::Explicit,
            ack_wait: self.lost_after,
            max_ack_pending: MOST_RUNNING,
            ..pull::Config::default()
        };
        self.messages.get_or_create_consumer(&token, config).await.map_err(|error| away(&error))?;
        self.create(&format!("client.{token}"), Vec::new()).await?;
        self.lines().insert(token);
        Ok(())
    }

    /// Whether the message of a job or chunk is in the stream, which means that it has not been acknowledged.
    ///
    /// # Errors
    /// The servers do not answer.
    pub async fn is_queued(&self, id: impl fmt::Display, client: Client) -> Result<bool, Away> {
        self.near()?;
        match self.messages.get_last_raw_message_by_subject(&self.job_subject(id, client)).await {
            Ok(_) => Ok(true),
            Err(error) if error.kind() == LastRawMessageErrorKind::NoMessageFound => Ok(false),
            Err(error) => Err(away(&error)),
        }
    }

    /// Whether the jobs of a client are known to have a JetStream consumer.
    pub fn has_line(&self, client: Client) -> bool {
        self.lines().contains(&client.token())
    }

    /// Puts the message of a job or chunk into the stream, once, and announces it to an idle worker; `announced` is
    /// an announcement that has been made already.
    ///
    /// # Errors
    /// The servers do not answer, so that the message may be in the stream or not.
    pub async fn enqueue(
        &self,
        id: impl fmt::Display,
        client: Client,
        text: Vec<u8>,
        announced: Option<Announced>,
    ) -> Result<(), Away> {
        self.near()?;
        let announced = announced.unwrap_or_else(|| self.announce(client));
        let message = message::PublishMessage::build().message_id(id.to_string()).payload(text.into());
        let sent = self.jetstream.send_publish(self.job_subject(&id, client), message).await;
        sent.map_err(|error| away(&error))?.await.map_err(|error| away(&error))?;
        self.announce_again(client, announced).await;
        Ok(())
    }

    /// Removes the message of a job or chunk that waits.
    ///
    /// # Errors
    /// The servers do not answer.
    pub async fn dequeue(&self, id: impl fmt::Display, client: Client) -> Result<(), Away> {
        self.near()?;
        // The message is removed by its number: after a purge by subject, consumers of some NATS servers (as in
        // Debian) count the remaining messages wrongly.
        match self.messages.get_last_raw_message_by_subject(&self.job_subject(id, client)).await {
            Ok(message) => {
                // A message that has been acknowledged in between is not in the stream any more.
                let _ = self.messages.delete_message(message.sequence).await;
                Ok(())
            }
            Err(error) if error.kind() == LastRawMessageErrorKind::NoMessageFound => Ok(()),
            Err(error) => Err(away(&error)),
        }
    }

    fn job_subject(&self, id: impl fmt::Display, client: Client) -> String {
        format!("{}.jobs.{}.{id}", self.name, client.token())
    }

    fn lines(&self) -> std::sync::MutexGuard<'_, HashSet<String>> {
        self.lines.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the key of the entry of a job in the bucket of states.
pub fn job_key(id: JobId) -> String {
    format!("job.{id}")
}

/// Parses the id of a job from the last token of a NATS subject, or of a key of the bucket of states.
pub fn job_of(subject: &str) -> Option<JobId> {
    subject.rsplit('.').next()?.parse().ok()
}

/// Logs `error`, for which a request to the NATS servers failed.
pub fn away(error: &dyn fmt::Display) -> Away {
    tracing::warn!(%error, "the NATS servers do not answer");
    Away
}

async fn connect(options: &Nats, role: &str, connected: &Arc<Mutex<Instant>>) -> io::Result<async_nats::Client> {
    let begun = Instant::now();
    let mut pause = FIRST_PAUSE;
    loop {
        let since = Arc::clone(connected);
        let mut connection = ConnectOptions::new()
            .name(format!("dvi {role}"))
            .ping_interval(PING)
            .reconnect_delay_callback(pause_before)
            .event_callback(move |event| {
                let since = Arc::clone(&since);
                async move {
                    if event == async_nats::Event::Connected {
                        *since.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
                    }
                    tracing::info!("NATS: {event}");
                }
            });
        if let Some(authority) = &options.authority {
            connection = connection.add_root_certificates(authority.clone());
        }
        if let Some(nkey) = &options.nkey {
            connection = connection.nkey(secret(nkey)?);
        }
        if let Some(credentials) = &options.credentials {
            connection = connection.credentials(&secret(credentials)?)?;
        }
        match connection.connect(options.servers.as_slice()).await {
            Ok(client) => return Ok(client),
            Err(error) if begun.elapsed() > PATIENCE || is_final(error.kind()) => {
                return Err(io::Error::new(io::ErrorKind::NotConnected, format!("the NATS servers: {error}")));
            }
            Err(error) => {
                tracing::warn!(%error, "the NATS servers do not answer yet");
                sleep(pause).await;
                pause = (2 * pause).min(LONGEST_PAUSE);
            }
        }
    }
}

/// Whether an error of an attempt to connect to the NATS servers makes further attempts useless.
fn is_final(kind: ConnectErrorKind) -> bool {
    use ConnectErrorKind::{Authentication, AuthorizationViolation, ServerParse, Tls};
    matches!(kind, Authentication | AuthorizationViolation | ServerParse | Tls)
}

/// Reads a file with a secret, without the white space around the secret.
fn secret(path: &Path) -> io::Result<String> {
    let text = std::fs::read_to_string(path)
        .map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", path.display())))?;
    Ok(text.trim().to_owned())
}

/// Returns the pause before the next attempt to connect to the NATS servers, after `attempts` attempts.
fn pause_before(attempts: usize) -> Duration {
    let doublings = u32::try_from(attempts.saturating_sub(1)).unwrap_or(u32::MAX);
    FIRST_PAUSE.saturating_mul(2_u32.saturating_pow(doublings)).min(LONGEST_PAUSE)
}

async fn create(
    jetstream: &Context,
    options: &Nats,
) -> Result<(Stream, kv::Store, kv::Store, ObjectStore), async_nats::Error> {
    let (name, replicas) = (&options.name, options.replicas.get());
    let messages = stream::Config {
        name: format!("{name}_jobs"),
        description: Some("the jobs of dvi that have not ended".to_owned()),
        subjects: vec![format!("{name}.jobs.*.*")],
        retention: RetentionPolicy::WorkQueue,
        storage: StorageType::File,
        num_replicas: replicas,
        duplicate_window: REMEMBERED,
        ..stream::Config::default()
    };
    let messages = jetstream.get_or_create_stream(messages).await?;
    let state = bucket(jetstream, format!("{name}_state"), "the states of the jobs of dvi", replicas).await?;
    let data = bucket(jetstream, format!("{name}_data"), "the specifications and results of dvi", replicas).await?;
    let objects = format!("{name}_objects");
    let objects = match jetstream.get_object_store(&objects).await {
        Ok(objects) => objects,
        Err(_) => {
            let config = object_store::Config {
                bucket: objects,
                description: Some("the long specifications and results of dvi".to_owned()),
                num_replicas: replicas,
                ..object_store::Config::default()
            };
            jetstream.create_object_store(config).await?
        }
    };
    Ok((messages, state, data, objects))
}

async fn bucket(
    jetstream: &Context,
    bucket: String,
    description: &str,
    num_replicas: usize,
) -> Result<kv::Store, async_nats::Error> {
    match jetstream.get_key_value(&bucket).await {
        Ok(bucket) => Ok(bucket),
        Err(_) => {
            // The configuration of a bucket (ADR-8 of NATS) is given explicitly: that of the client library contains
            // settings that servers before 2.10 do not know.
            let config = stream::Config {
                name: format!("KV_{bucket}"),
                description: Some(description.to_owned()),
                subjects: vec![format!("$KV.{bucket}.>")],
                storage: StorageType::File,
                num_replicas,
                max_messages_per_subject: 1,
                discard: DiscardPolicy::New,
                allow_rollup: true,
                deny_delete: true,
                allow_direct: true,
                ..stream::Config::default()
            };
            jetstream.create_stream(config).await?;
            Ok(jetstream.get_key_value(&bucket).await?)
        }
    }
}
