//! The folder of a durable service:
//!
//! ```text
//! jobs.redb        a row a job, its specification, its result if that is small
//! results/ID.json  a large result
//! running-N        what the workers of the Nth start are at
//! ```

use super::database::{Change, Database};
use super::ended::{Ended, Ending, Fault, Held};
use super::files::{self, Files};
use super::marks::Marks;
use super::writer::{Place, Unwritable, Writer};
use super::{JobId, Record, Results};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{fs, io};

/// A result of this size and more is a file: the database would copy it once more and keep its room.
const LARGE: usize = 64 << 10;

/// A job that was running this often when its process ended is not started again.
const MOST_CRASHES: u32 = 2;

/// The open folder.
#[derive(Debug)]
pub struct Disk {
    database: Arc<Database>,
    files: Arc<Files>,
    marks: Marks,
    writer: Writer,
}

impl Disk {
    /// Opens the folder, made if it is not there, with the jobs of earlier processes, oldest first. Jobs that were running
    /// have one crash more; those with too many have failed.
    ///
    /// # Errors
    /// Another process uses the folder, or those of the disk.
    pub fn open(folder: &Path) -> io::Result<(Self, Vec<(JobId, Record)>)> {
        Self::recover(folder).map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", folder.display())))
    }

    fn recover(folder: &Path) -> io::Result<(Self, Vec<(JobId, Record)>)> {
        fs::create_dir_all(folder)?;
        let database = Arc::new(Database::open(&folder.join("jobs.redb"))?);
        let files = Arc::new(Files::open(folder.join("results"))?);
        files::sync(folder)?;
        let (mut records, start) = (database.records()?, database.starts()?);
        let running: HashSet<_> = Marks::read(&marks(folder, start))?.into_iter().collect();
        let mut changes = Vec::new();
        for (id, record) in &mut records {
            if recover(record, running.contains(id)) {
                changes.push(Change::record(*id, record));
            }
        }
        // In the same transaction: marks that have been counted once are those of an earlier start.
        database.start(&changes, start + 1)?;
        let counted = marks(folder, start);
        if counted.exists() {
            fs::remove_file(counted)?;
        }
        let marks = Marks::create(&marks(folder, start + 1))?;
        files.sweep(&records.iter().filter(|(_, record)| has_file(record)).map(|(id, _)| *id).collect())?;
        let writer = Writer::start(Arc::clone(&database), Arc::clone(&files))?;
        Ok((Self { database, files, marks, writer }, records))
    }

    /// A place for a change, as soon as there is one.
    ///
    /// # Errors
    /// The store cannot be written.
    pub async fn place(&self) -> Result<Place, Unwritable> {
        self.writer.place().await
    }

    /// Whether the latest change could not be made.
    pub fn has_failed(&self) -> bool {
        self.writer.has_failed()
    }

    /// The marks of the workers.
    pub fn marks(&self) -> &Marks {
        &self.marks
    }

    /// Puts away a large result, for good when it returns; a small one is given back, for the change that tells of
    /// the end.
    pub fn put_away(&self, id: JobId, ended: Ended) -> (Ended, Option<Arc<Results>>) {
        let Some(Held::Memory(results)) = &ended.held else { return (ended, None) };
        let (results, bytes) = (Arc::clone(results), results.json().len());
        if bytes < LARGE {
            return (Ended { held: Some(Held::Table(bytes)), ..ended }, Some(results));
        }
        match self.files.write(id, results.json()) {
            Ok(()) => (Ended { held: Some(Held::File(bytes)), ..ended }, None),
            Err(error) => {
                tracing::error!(job.id = %id, %error, "the results of job {id} cannot be written");
                (ended.unwritable(), None)
            }
        }
    }

    /// Removes all that there is of these jobs.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn erase(&self, jobs: Vec<JobId>) -> io::Result<()> {
        jobs.iter().for_each(|id| self.discard(*id));
        self.database.apply(&[Change::forgotten(jobs)])
    }

    /// Removes a result whose job is forgotten.
    pub fn discard(&self, id: JobId) {
        if let Err(error) = self.files.remove(id) {
            tracing::warn!(job.id = %id, %error, "a file of results is left behind until the next start");
        }
    }

    /// What was posted for a job.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn document(&self, id: JobId) -> io::Result<Vec<u8>> {
        self.database.document(id)?.ok_or_else(|| io::ErrorKind::NotFound.into())
    }

    /// The results of a job.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn results(&self, id: JobId, held: &Held) -> io::Result<Arc<Results>> {
        let json = match held {
            Held::Memory(results) => return Ok(Arc::clone(results)),
            Held::Table(_) => self.database.results(id)?.ok_or(io::ErrorKind::NotFound)?,
            Held::File(_) => self.files.read(id)?,
        };
        Ok(Arc::new(Results::read(json)))
    }
}

/// Brings a row up to date after the end of its process, in which the job was `running` or not; says whether it has changed.
fn recover(record: &mut Record, running: bool) -> bool {
    if record.ended.is_some() {
        return false;
    }
    let crashed = running || record.underway;
    record.underway = false;
    record.crashes += u32::from(crashed);
    if record.dismissed {
        record.ended = Some(Ended::unsolved(Ending::Dismissed));
    } else if record.crashes >= MOST_CRASHES {
        record.ended = Some(Ended::unsolved(Ending::Broken(Fault::Poisoned)));
    }
    crashed || record.ended.is_some()
}

fn has_file(record: &Record) -> bool {
    matches!(&record.ended, Some(Ended { held: Some(Held::File(_)), .. }))
}

fn marks(folder: &Path, start: u64) -> PathBuf {
    folder.join(format!("running-{start}"))
}
