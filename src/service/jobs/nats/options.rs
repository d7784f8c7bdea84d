//! The options of the connection to NATS servers and of the streams there: command-line flags with their environment
//! variables.

use clap::Args;
use std::io;
use std::num::{NonZeroU64, NonZeroUsize};
use std::path::PathBuf;
use std::time::Duration;

/// The NATS servers over which gateways and workers share jobs.
#[derive(Args, Clone, Debug)]
pub struct Nats {
    /// Share jobs with other gateways and with workers over these NATS servers, such as `nats://host:4222` or
    /// `tls://host:4222`; several of one cluster are separated by commas
    #[arg(long = "nats", env = "DVI_NATS", value_name = "URL", value_delimiter = ',')]
    pub servers: Vec<String>,

    /// The file of credentials (a JWT and its seed) for the NATS servers
    #[arg(long = "nats-credentials", env = "DVI_NATS_CREDENTIALS", value_name = "FILE", requires = "servers")]
    pub credentials: Option<PathBuf>,

    /// The file of an nkey seed for the NATS servers
    #[arg(
        long = "nats-nkey",
        env = "DVI_NATS_NKEY",
        value_name = "FILE",
        requires = "servers",
        conflicts_with = "credentials"
    )]
    pub nkey: Option<PathBuf>,

    /// A certificate authority of the NATS servers, in PEM, in addition to those that the machine trusts
    #[arg(long = "nats-ca", env = "DVI_NATS_CA", value_name = "FILE", requires = "servers")]
    pub authority: Option<PathBuf>,

    /// The name with which the streams, buckets and subjects on the NATS servers begin
    #[arg(long = "nats-name", env = "DVI_NATS_NAME", value_name = "NAME", default_value = "dvi")]
    pub name: String,

    /// The number of servers that keep each job; three in a cluster of three survive the loss of one
    #[arg(long = "nats-replicas", env = "DVI_NATS_REPLICAS", value_name = "N", default_value = "1")]
    pub replicas: NonZeroUsize,

    /// Time without a sign of life of a worker after which its job is given to another, in seconds; set by the gateway that
    /// first has a job of a client
    #[arg(long = "nats-lost-seconds", env = "DVI_NATS_LOST_SECONDS", value_name = "SECONDS", default_value = "30")]
    pub lost_seconds: NonZeroU64,
}

impl Default for Nats {
    fn default() -> Self {
        Self {
            servers: Vec::new(),
            credentials: None,
            nkey: None,
            authority: None,
            name: "dvi".to_owned(),
            replicas: NonZeroUsize::MIN,
            lost_seconds: NonZeroU64::new(30).unwrap_or(NonZeroU64::MIN),
        }
    }
}

impl Nats {
    /// Whether the options name NATS servers over which jobs are shared.
    pub fn is_used(&self) -> bool {
        !self.servers.is_empty()
    }

    /// Checks the name with which streams, buckets and subjects begin.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidInput`], with the flag and what is expected.
    pub fn check(&self) -> io::Result<()> {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if self.name.is_empty() || !self.name.chars().all(is_plain) {
            let told = format!("--nats-name {}: expected letters, digits, `-` and `_`", self.name);
            return Err(io::Error::new(io::ErrorKind::InvalidInput, told));
        }
        Ok(())
    }

    /// Returns the time without a sign of life after which a worker counts as lost.
    pub fn lost_after(&self) -> Duration {
        Duration::from_secs(self.lost_seconds.get())
    }
}
