//! Specifications, results and rows on NATS servers: values of a bucket, or objects of the object store if they are
//! longer than a message may be.

use super::entry::{Entry, SHORT};
use super::servers::{Away, Exchange, ONE_MESSAGE, Trouble, away};
use crate::digest::Digest;
use crate::jobs::results::{Long, Results};
use crate::jobs::spool::{Backing, Spool};
use crate::jobs::{Held, JobId};
use async_nats::jetstream::object_store::{GetErrorKind, InfoErrorKind};
use std::env::temp_dir;
use std::io::{self, Write};
use std::sync::Arc;
use tokio::io::AsyncReadExt;
use tokio::task::spawn_blocking;

/// The size of the pieces in which an object is read from the NATS object store, in bytes.
const PIECE: usize = 128 << 10;

impl Exchange {
    /// Stores a text under `name`.
    ///
    /// # Errors
    /// The servers do not answer.
    pub async fn put(&self, name: &str, text: Vec<u8>) -> Result<(), Away> {
        self.near()?;
        if text.len() <= self.client.max_payload().min(ONE_MESSAGE) {
            return self.data.put(name, text.into()).await.map(|_| ()).map_err(|error| away(&error));
        }
        self.objects.put(name, &mut text.as_slice()).await.map(|_| ()).map_err(|error| away(&error))
    }

    /// Copies the text stored under `name` to `to`; returns false if there is none.
    ///
    /// # Errors
    /// The servers do not answer, the text is incomplete, or `to` cannot be written.
    async fn copy(&self, name: &str, to: &mut (impl Write + Send)) -> io::Result<bool> {
        self.near()?;
        // Any NATS server with a replica of the bucket may answer. If a replica that is behind does not have the text,
        // the leader of the cluster is asked.
        let value = match self.data.get(name).await {
            Ok(Some(value)) => Some(value),
            Ok(None) | Err(_) => self.last(&self.data, name).await?.map(|message| message.payload),
        };
        if let Some(value) = value {
            return to.write_all(&value).map(|()| true);
        }
        let mut object = match self.objects.get(name).await {
            Ok(object) => object,
            Err(error) if error.kind() == GetErrorKind::NotFound => return Ok(false),
            Err(error) => return Err(away(&error).into()),
        };
        let mut piece = vec![0; PIECE];
        loop {
            match object.read(&mut piece).await? {
                0 => return Ok(true),
                count => to.write_all(&piece[..count])?,
            }
        }
    }

    /// Returns the specification of a job.
    ///
    /// # Errors
    /// The servers do not answer; [`io::ErrorKind::InvalidData`] if the specification is missing.
    pub async fn document(&self, id: JobId) -> io::Result<Vec<u8>> {
        match self.entry(id).await {
            Ok(Some((entry, _))) => self.document_of(id, &entry).await,
            Ok(None) | Err(Trouble::OtherVersion) => Err(gone()),
            Err(Trouble::Away) => Err(Away.into()),
        }
    }

    /// Returns the specification of a job whose entry is `entry`.
    ///
    /// # Errors
    /// The servers do not answer; [`io::ErrorKind::InvalidData`] if the specification is missing.
    pub async fn document_of(&self, id: JobId, entry: &Entry) -> io::Result<Vec<u8>> {
        if let Some(document) = &entry.document {
            return Ok(document.clone().into_bytes());
        }
        let mut text = Vec::new();
        if self.copy(&document_name(id), &mut text).await? { Ok(text) } else { Err(gone()) }
    }

    /// Stores the results of an attempt at a job; returns the place to record in the job's entry.
    ///
    /// # Errors
    /// The servers do not answer, or results in a file cannot be read.
    pub async fn put_results(&self, id: JobId, attempt: u32, results: Arc<Results>) -> io::Result<Held> {
        let (held, text) = spawn_blocking(move || match &*results {
            Results::Text(_) => {
                Ok((Held::Table(results.fingerprint()), results.text().map(<[u8]>::to_vec).unwrap_or_default()))
            }
            Results::Columns(Long { backing, json, index }) => {
                let (source, length) = backing.open()?;
                let mut columns = vec![0; usize::try_from(length).map_err(io::Error::other)?];
                source.read_at(0, &mut columns)?;
                io::Result::Ok((Held::Columns { json: *json, index: *index }, columns))
            }
        })
        .await
        .map_err(io::Error::other)??;
        self.put(&results_name(id, attempt), text).await?;
        Ok(held)
    }

    /// Returns the results of an attempt at a job; long ones in a temporary file.
    ///
    /// # Errors
    /// The servers do not answer; [`io::ErrorKind::InvalidData`] if the results are damaged or missing.
    pub async fn results(&self, id: JobId, attempt: u32, held: &Held) -> io::Result<Arc<Results>> {
        let name = results_name(id, attempt);
        Ok(Arc::new(match held {
            Held::Memory(results) => return Ok(Arc::clone(results)),
            Held::Table(json) | Held::File(json) => {
                let mut text = self.short_results(id, json.bytes).await?;
                if text.is_empty() && !self.copy(&name, &mut text).await? {
                    return Err(gone());
                }
                Results::vouched(text, json.digest)?
            }
            Held::Columns { json, index } => {
                let file = temp_dir().join(format!("dvi-{}-{}", std::process::id(), uuid::Uuid::now_v7()));
                let mut spool = Spool::new(Some(file));
                if !self.copy(&name, &mut spool).await? {
                    return Err(gone());
                }
                let backing: Backing = spool.end();
                Results::Columns(Long { backing, json: *json, index: *index })
            }
        }))
    }

    /// Returns the results that are stored in the entry of a job, if they are short; empty if there are none.
    async fn short_results(&self, id: JobId, bytes: usize) -> Result<Vec<u8>, Away> {
        if bytes > SHORT {
            return Ok(Vec::new());
        }
        match self.entry(id).await {
            Ok(Some((entry, _))) => Ok(entry.results.map_or_else(Vec::new, |json| json.get().as_bytes().to_vec())),
            Ok(None) | Err(Trouble::OtherVersion) => Ok(Vec::new()),
            Err(Trouble::Away) => Err(Away),
        }
    }

    /// Stores rows of a sweep under a name.
    ///
    /// # Errors
    /// The servers do not answer.
    pub async fn put_rows(&self, name: &str, rows: &[u8]) -> Result<(), Away> {
        self.put(name, rows.to_vec()).await
    }

    /// Returns the rows of a sweep that are stored under a name.
    ///
    /// # Errors
    /// The servers do not answer; [`io::ErrorKind::InvalidData`] if the rows are damaged or missing.
    pub async fn rows(&self, name: &str, digest: Digest) -> io::Result<Vec<u8>> {
        let mut rows = Vec::new();
        if self.copy(name, &mut rows).await? { digest.vouch(rows) } else { Err(gone()) }
    }

    /// Removes the results of an attempt at a job.
    ///
    /// # Errors
    /// The servers do not answer.
    pub async fn remove_results(&self, id: JobId, attempt: u32) -> Result<(), Away> {
        self.remove(&results_name(id, attempt)).await
    }

    /// Removes the text stored under `name`.
    ///
    /// # Errors
    /// The servers do not answer.
    pub async fn remove(&self, name: &str) -> Result<(), Away> {
        self.near()?;
        let filter = format!("{}{name}", self.data.prefix);
        self.data.stream.purge().filter(filter).await.map_err(|error| away(&error))?;
        match self.objects.info(name).await {
            Ok(info) if info.deleted => Ok(()),
            Ok(_) => self.objects.delete(name).await.map_err(|error| away(&error)),
            Err(error) if error.kind() == InfoErrorKind::NotFound => Ok(()),
            Err(error) => Err(away(&error)),
        }
    }
}

/// Returns the name under which the specification of a job is stored on the NATS servers.
pub fn document_name(id: JobId) -> String {
    format!("document.{id}")
}

/// Returns the name under which the results of an attempt at a job are stored on the NATS servers.
fn results_name(id: JobId, attempt: u32) -> String {
    format!("results.{id}.{attempt}")
}

fn gone() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "it is not there any more")
}
