//! The options of the service: each is a command-line flag with an environment variable, and a default that suits one
//! machine shared by a few people.

use super::jobs::{Bounds, Nats, Retention, Room};
use clap::builder::BoolishValueParser as FlagParser;
use clap::{Args, Command};
use serde::Serialize;
use serde_json::Value;
use std::ffi::OsString;
use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::num::{NonZeroU64, NonZeroUsize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::available_parallelism;
use std::time::Duration;

/// A numerical limit in force on the service, described as in `--help`.
#[derive(Clone, Debug, Serialize)]
pub struct Bound {
    /// The command-line flag that sets the limit.
    pub flag: String,
    /// The environment variable that sets the limit.
    pub variable: String,
    /// The unit of the limit's value.
    pub unit: String,
    /// The value of the limit in force.
    pub value: Value,
    /// The help text of the command-line flag.
    pub meaning: String,
}

/// The options of the service: its address, limits, folders and access rules.
#[derive(Args, Clone, Debug, Serialize)]
pub struct Options {
    /// Address and port to listen on
    #[arg(long, env = "DVI_LISTEN", value_name = "ADDRESS:PORT", default_value_t = Options::default().listen)]
    pub listen: SocketAddr,

    /// The folder of durable jobs and of tokens
    #[arg(skip)]
    pub data: Option<PathBuf>,

    /// The path of this program, if its `store` command checks the folder before it is opened
    #[arg(skip)]
    #[serde(skip)]
    pub program: Option<OsString>,

    /// Keep jobs in memory only, so that none survives the process; `--data` is ignored
    #[arg(long, env = "DVI_EPHEMERAL", value_parser = FlagParser::new())]
    pub ephemeral: bool,

    /// Require tokens on a loopback address too, for example behind a proxy
    #[arg(long, env = "DVI_ASK_TOKENS", conflicts_with = "insecure", value_parser = FlagParser::new())]
    pub ask_tokens: bool,

    /// Require no tokens although other machines can connect
    #[arg(long, env = "DVI_INSECURE", value_parser = FlagParser::new())]
    pub insecure: bool,

    /// A host name, in addition to `localhost`, under which pages may reach a loopback address without tokens; may be
    /// repeated
    #[arg(long, env = "DVI_HOST", value_name = "NAME", value_delimiter = ',')]
    pub host: Vec<String>,

    /// An origin whose pages may use the service too, such as `https://lab.example`; may be repeated
    #[arg(long, env = "DVI_CORS_ORIGIN", value_name = "ORIGIN", value_delimiter = ',')]
    pub cors_origin: Vec<String>,

    /// The path under which a proxy exposes the service, such as `/dvi`; the service accepts paths with and without it
    #[arg(long, env = "DVI_PATH_PREFIX", value_name = "PATH", default_value = "")]
    pub path_prefix: String,

    /// Largest number of concurrent solves, each in its own process; the default is one per core
    #[arg(long, env = "DVI_WORKERS", value_name = "N", default_value_t = Options::default().workers)]
    pub workers: NonZeroUsize,

    /// Additional concurrent solves, each for a short time slice, so that no job waits behind long jobs before it has had a
    /// slice; a job that takes longer starts again when another ends
    #[arg(long, env = "DVI_EXPRESS", value_name = "N", default_value_t = Options::default().express)]
    pub express: usize,

    /// Additional concurrent solves: long jobs of clients without a running job while others occupy all workers
    #[arg(long, env = "DVI_RELIEF", value_name = "N", default_value_t = Options::default().relief)]
    pub relief: usize,

    /// Largest number of waiting jobs; a further one is refused with 429
    #[arg(long, env = "DVI_QUEUE", value_name = "JOBS", default_value_t = Options::default().queue)]
    pub queue: NonZeroUsize,

    /// Largest total size of waiting specifications, in MiB; a further one is refused with 429
    #[arg(long, env = "DVI_QUEUE_MIB", value_name = "MIB", default_value_t = Options::default().queue_mib)]
    pub queue_mib: NonZeroUsize,

    /// Largest number of waiting jobs of one client, identified by its token or else by its address
    #[arg(long, env = "DVI_CLIENT_SHARE", value_name = "JOBS", default_value_t = Options::default().client_share)]
    pub client_share: NonZeroUsize,

    /// Time limit of a job, in seconds, after which its trajectory so far is kept; also the time limit of a check
    #[arg(long, env = "DVI_WALL_SECONDS", value_name = "SECONDS", default_value_t = Options::default().wall_seconds)]
    pub wall_seconds: NonZeroU64,

    /// Largest number of accepted steps of a solve, up to 10,000,000; its trajectory so far is kept
    #[arg(long, env = "DVI_STEPS", value_name = "STEPS", default_value_t = Options::default().steps)]
    pub steps: NonZeroU64,

    /// Memory limit of a solve, in MiB; a solve with a larger estimate is refused with 422, one that exceeds the limit is
    /// ended
    #[arg(long, env = "DVI_MEMORY_MIB", value_name = "MIB", default_value_t = Options::default().memory_mib)]
    pub memory_mib: NonZeroUsize,

    /// Largest specification, in MiB
    #[arg(long, env = "DVI_BODY_MIB", value_name = "MIB", default_value_t = Options::default().body_mib)]
    pub body_mib: NonZeroUsize,

    /// Largest result, in MiB of JSON
    #[arg(long, env = "DVI_RESULT_MIB", value_name = "MIB", default_value_t = Options::default().result_mib)]
    pub result_mib: NonZeroUsize,

    /// Largest total size of responses being sent, in MiB; a further one waits until others have been received
    #[arg(long, env = "DVI_ANSWERS_MIB", value_name = "MIB", default_value_t = Options::default().answers_mib)]
    pub answers_mib: NonZeroUsize,

    /// Largest number of ended jobs that are kept; the oldest is deleted first
    #[arg(long, env = "DVI_KEPT_JOBS", value_name = "JOBS", default_value_t = Options::default().kept_jobs)]
    pub kept_jobs: NonZeroUsize,

    /// Largest total size of specifications and results that are kept, in MiB; the oldest are deleted first
    #[arg(long, env = "DVI_KEPT_MIB", value_name = "MIB", default_value_t = Options::default().kept_mib)]
    pub kept_mib: NonZeroUsize,

    /// Number of days for which an ended job is kept
    #[arg(long, env = "DVI_KEPT_DAYS", value_name = "DAYS", default_value_t = Options::default().kept_days)]
    pub kept_days: NonZeroU64,

    /// Time limit, in seconds, for a client to send the headers of a request, to send its body, and to receive each part
    /// of a response
    #[arg(long, env = "DVI_READ_SECONDS", value_name = "SECONDS", default_value_t = Options::default().read_seconds)]
    pub read_seconds: NonZeroU64,

    /// Largest number of open connections; a further one waits until another closes
    #[arg(long, env = "DVI_CONNECTIONS", value_name = "CONNECTIONS", default_value_t = Options::default().connections)]
    pub connections: NonZeroUsize,

    /// Largest number of open event streams; a further one is refused with 503
    #[arg(long, env = "DVI_STREAMS", value_name = "STREAMS", default_value_t = Options::default().streams)]
    pub streams: NonZeroUsize,

    /// Time for running jobs to end after SIGTERM or SIGINT, in seconds; then they are stopped
    #[arg(long, env = "DVI_GRACE_SECONDS", value_name = "SECONDS", default_value_t = Options::default().grace_seconds)]
    pub grace_seconds: u64,

    /// The servers over which jobs are shared with other machines
    #[command(flatten)]
    #[serde(skip)]
    pub nats: Nats,
}

impl Default for Options {
    fn default() -> Self {
        let count = |n| NonZeroUsize::new(n).unwrap_or(NonZeroUsize::MIN);
        let number = |n| NonZeroU64::new(n).unwrap_or(NonZeroU64::MIN);
        Self {
            listen: (Ipv4Addr::LOCALHOST, 8080).into(),
            data: None,
            program: None,
            ephemeral: false,
            ask_tokens: false,
            insecure: false,
            host: Vec::new(),
            cors_origin: Vec::new(),
            path_prefix: String::new(),
            workers: available_parallelism().unwrap_or(NonZeroUsize::MIN),
            express: 1,
            relief: 1,
            queue: count(1000),
            queue_mib: count(256),
            client_share: count(750),
            wall_seconds: number(300),
            steps: number(10_000_000),
            memory_mib: count(2048),
            body_mib: count(8),
            result_mib: count(256),
            answers_mib: count(64),
            kept_jobs: count(10_000),
            kept_mib: count(1024),
            kept_days: number(30),
            read_seconds: number(30),
            connections: count(16_384),
            streams: count(1000),
            grace_seconds: 30,
            nats: Nats::default(),
        }
    }
}

impl Options {
    /// Returns the folder of durable jobs, or `None` if jobs are kept in memory or on NATS servers.
    pub fn jobs_folder(&self) -> Option<&Path> {
        self.data.as_deref().filter(|_| !self.ephemeral && !self.nats.is_used())
    }

    /// The path prefix of the service: empty, or a path that begins with a slash and ends without one.
    pub fn prefix(&self) -> Arc<str> {
        self.path_prefix.trim_end_matches('/').into()
    }

    /// Checks the options whose value is not a number: the path prefix and the allowed origins.
    ///
    /// # Errors
    /// The flag with an invalid value, and an example of a valid one.
    pub fn check(&self) -> io::Result<()> {
        let wrong = |what: String| Err(io::Error::new(io::ErrorKind::InvalidInput, what));
        let prefix = self.prefix();
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "/-_.~".contains(c);
        if !prefix.is_empty() && (!prefix.starts_with('/') || prefix.contains("//") || !prefix.chars().all(is_plain)) {
            return wrong(format!("--path-prefix {prefix}: expected a path such as /dvi"));
        }
        let is_origin = |origin: &str| {
            let host = origin.trim_end_matches('/').split_once("://").map(|(_, host)| host);
            host.is_some_and(|host| !host.is_empty() && !host.contains(['/', '*', '@']))
        };
        match self.cors_origin.iter().find(|origin| !is_origin(origin)) {
            Some(origin) => wrong(format!("--cors-origin {origin}: expected an origin such as https://lab.example")),
            None => Ok(()),
        }
    }

    /// Whether clients must present a token: if other machines can connect, or if `--ask-tokens` demands it.
    pub fn asks_tokens(&self) -> bool {
        self.ask_tokens || !(self.insecure || self.listen.ip().is_loopback())
    }

    /// The size limit of a request body, in bytes.
    pub fn body_bytes(&self) -> usize {
        bytes(self.body_mib)
    }

    /// The time limit for a client to send the headers of a request, to send its body, and to receive each piece of a
    /// response.
    pub fn read_time(&self) -> Duration {
        Duration::from_secs(self.read_seconds.get())
    }

    /// The wall-clock time limit of a job, and of the check of a specification.
    pub fn wall(&self) -> Duration {
        Duration::from_secs(self.wall_seconds.get())
    }

    /// The grace time: from the signal to stop the service until running jobs are stopped.
    pub fn grace(&self) -> Duration {
        Duration::from_secs(self.grace_seconds)
    }

    /// The number of worker processes that solve, without relief workers (additional workers for clients that have no
    /// long job running).
    pub fn supervised(&self) -> NonZeroUsize {
        self.workers.saturating_add(self.express)
    }

    /// The number of worker processes that check specifications, in addition to those that solve: half as many, since
    /// checks are short.
    pub fn checkers(&self) -> usize {
        self.workers.get().div_ceil(2)
    }

    /// All limits in force: the options whose value is a number.
    pub fn in_force(&self) -> Vec<Bound> {
        let values = serde_json::to_value(self).unwrap_or_default();
        let command = Self::augment_args(Command::new("dvi"));
        let bound = |flag: &clap::Arg| {
            let value = values.get(flag.get_id().as_str()).filter(|value| value.is_number())?.clone();
            Some(Bound {
                flag: format!("--{}", flag.get_long()?),
                variable: flag.get_env()?.to_string_lossy().into_owned(),
                unit: flag.get_value_names()?.first()?.to_lowercase(),
                value,
                meaning: flag.get_help()?.to_string(),
            })
        };
        command.get_arguments().filter_map(bound).collect()
    }

    /// The limits on jobs: workers, queue, steps, memory, time, size of results and retention.
    pub fn bounds(&self) -> Bounds {
        Bounds {
            workers: self.workers.get(),
            queue: Room { places: self.queue.get(), share: self.client_share.get(), bytes: bytes(self.queue_mib) },
            steps: self.steps.get(),
            memory: bytes(self.memory_mib),
            wall: self.wall(),
            result_bytes: bytes(self.result_mib),
            retention: Retention {
                jobs: self.kept_jobs.get(),
                bytes: bytes(self.kept_mib),
                age: Duration::from_secs(self.kept_days.get().saturating_mul(24 * 3600)),
            },
        }
    }
}

fn bytes(mib: NonZeroUsize) -> usize {
    mib.get().saturating_mul(1 << 20)
}
