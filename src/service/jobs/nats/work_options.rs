//! The options of a worker that takes jobs over NATS: command-line flags with their environment variables.

use super::options::Nats;
use crate::options::Options;
use clap::Args;
use jiff::SignedDuration;
use std::num::{NonZeroU64, NonZeroUsize};
use std::time::Duration;

/// The options of a worker that takes jobs over NATS.
#[derive(Args, Clone, Debug)]
pub struct WorkOptions {
    /// The servers over which jobs are shared with other machines
    #[command(flatten)]
    pub nats: Nats,

    /// Largest number of concurrent solves, each in its own process; the default is one per core
    #[arg(long, env = "DVI_WORKERS", value_name = "N", default_value_t = Options::default().workers)]
    pub workers: NonZeroUsize,

    /// Time limit of a job, in seconds, after which its trajectory so far is kept
    #[arg(long, env = "DVI_WALL_SECONDS", value_name = "SECONDS", default_value_t = Options::default().wall_seconds)]
    pub wall_seconds: NonZeroU64,

    /// Largest number of accepted steps of a solve, up to 10,000,000; its trajectory so far is kept
    #[arg(long, env = "DVI_STEPS", value_name = "STEPS", default_value_t = Options::default().steps)]
    pub steps: NonZeroU64,

    /// Largest result, in MiB of JSON
    #[arg(long, env = "DVI_RESULT_MIB", value_name = "MIB", default_value_t = Options::default().result_mib)]
    pub result_mib: NonZeroUsize,

    /// Leave when there has been nothing to do for so long, such as `10m`
    #[arg(long, env = "DVI_UNTIL_IDLE", value_name = "TIME", value_parser = duration, requires = "servers")]
    pub until_idle: Option<Duration>,

    /// Time for running jobs to end after SIGTERM or SIGINT, in seconds; then they are left to other workers
    #[arg(long, env = "DVI_GRACE_SECONDS", value_name = "SECONDS", default_value_t = Options::default().grace_seconds)]
    pub grace_seconds: u64,
}

impl Default for WorkOptions {
    fn default() -> Self {
        let Options { workers, wall_seconds, steps, result_mib, grace_seconds, .. } = Options::default();
        Self { nats: Nats::default(), workers, wall_seconds, steps, result_mib, until_idle: None, grace_seconds }
    }
}

/// Parses a duration such as `10m` or `90s`.
fn duration(text: &str) -> Result<Duration, String> {
    let time: SignedDuration = text.parse().map_err(|error| format!("{error}; write a time such as 10m"))?;
    time.try_into().map_err(|_| "write a time such as 10m".to_owned())
}
