//! The tables of jobs, and the changes that are made to them, many in one transaction.

use super::{JobId, Record, Results};
use redb::{Builder, Database as Redb, ReadableDatabase, ReadableTable, TableDefinition, WriteTransaction};
use std::io;
use std::path::Path;
use std::sync::Arc;

const JOBS: TableDefinition<'_, u128, &[u8]> = TableDefinition::new("jobs");
const SPECIFICATIONS: TableDefinition<'_, u128, &[u8]> = TableDefinition::new("specifications");
const RESULTS: TableDefinition<'_, u128, &[u8]> = TableDefinition::new("results");
const STARTS: TableDefinition<'_, (), u64> = TableDefinition::new("starts");

/// Pages kept in memory. What is read again soon was just written; the rest is for the system's own cache.
const CACHE_BYTES: usize = 64 << 20;

/// What happens to rows; all of it or nothing.
#[derive(Debug, Default)]
pub struct Change {
    /// A job's row, new or anew.
    pub record: Option<(JobId, Vec<u8>)>,
    /// What was posted for that job.
    pub document: Option<Arc<[u8]>>,
    /// What came of it.
    pub results: Option<Arc<Results>>,
    /// Jobs of which nothing is to be left.
    pub forgotten: Vec<JobId>,
}

impl Change {
    /// Writes a row.
    pub fn record(id: JobId, record: &Record) -> Self {
        // Strings and finite numbers always have a JSON form.
        Self { record: Some((id, serde_json::to_vec(record).unwrap_or_default())), ..Self::default() }
    }

    /// Removes every row of these jobs.
    pub fn forgotten(forgotten: Vec<JobId>) -> Self {
        Self { forgotten, ..Self::default() }
    }
}

/// What the database knows of jobs.
#[derive(Debug)]
pub struct Rows {
    /// Those that can be read.
    pub records: Vec<(JobId, Record)>,
    /// The names of the others.
    pub unreadable: Vec<JobId>,
}

/// The database of one process: the file is locked.
#[derive(Debug)]
pub struct Database {
    redb: Redb,
}

impl Database {
    /// Opens the file, made if it is not there.
    ///
    /// # Errors
    /// It is in use by another process, is no database, or cannot be made.
    pub fn open(path: &Path) -> io::Result<Self> {
        let redb = Builder::new().set_cache_size(CACHE_BYTES).create(path).map_err(io::Error::other)?;
        let database = Self { redb };
        // Makes the tables, without which they could not be read.
        database.write(&[], None).map_err(io::Error::other)?;
        Ok(database)
    }

    /// Makes `changes`, in their order, for good when it returns.
    ///
    /// # Errors
    /// Those of the disk; nothing has changed.
    pub fn apply(&self, changes: &[Change]) -> io::Result<()> {
        self.write(changes, None).map_err(io::Error::other)
    }

    /// Makes `changes` and counts a start of the service, all in one.
    ///
    /// # Errors
    /// Those of the disk; nothing has changed.
    pub fn start(&self, changes: &[Change], start: u64) -> io::Result<()> {
        self.write(changes, Some(start)).map_err(io::Error::other)
    }

    /// The number of the latest start.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn starts(&self) -> io::Result<u64> {
        let read = || -> Result<_, redb::Error> {
            Ok(self.redb.begin_read()?.open_table(STARTS)?.get(())?.map_or(0, |start| start.value()))
        };
        read().map_err(io::Error::other)
    }

    /// Every row, oldest job first; one that cannot be read, as after a step back to an earlier version, is named in the log
    /// and left as it is.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn records(&self) -> io::Result<Rows> {
        let read = || -> Result<_, redb::Error> {
            let (mut records, mut unreadable) = (Vec::new(), Vec::new());
            for row in self.redb.begin_read()?.open_table(JOBS)?.iter()? {
                let (number, record) = row?;
                let id = JobId::of_number(number.value());
                match serde_json::from_slice(record.value()) {
                    Ok(record) => records.push((id, record)),
                    Err(error) => {
                        tracing::error!(job.id = %id, %error, "the row of job {id} cannot be read; it is kept as it is");
                        unreadable.push(id);
                    }
                }
            }
            Ok(Rows { records, unreadable })
        };
        read().map_err(io::Error::other)
    }

    /// What was posted for a job.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn document(&self, id: JobId) -> io::Result<Option<Vec<u8>>> {
        self.find(SPECIFICATIONS, id).map_err(io::Error::other)
    }

    /// The results of a job, where they are in the table.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn results(&self, id: JobId) -> io::Result<Option<Vec<u8>>> {
        self.find(RESULTS, id).map_err(io::Error::other)
    }

    fn find(&self, table: TableDefinition<'_, u128, &[u8]>, id: JobId) -> Result<Option<Vec<u8>>, redb::Error> {
        let table = self.redb.begin_read()?.open_table(table)?;
        Ok(table.get(id.number())?.map(|bytes| bytes.value().to_vec()))
    }

    fn write(&self, changes: &[Change], start: Option<u64>) -> Result<(), redb::Error> {
        let mut transaction = self.redb.begin_write()?;
        // A kill at any moment then leaves a file that opens at once.
        transaction.set_quick_repair(true);
        make(&transaction, changes, start)?;
        transaction.commit()?;
        Ok(())
    }
}

fn make(transaction: &WriteTransaction, changes: &[Change], start: Option<u64>) -> Result<(), redb::Error> {
    let mut jobs = transaction.open_table(JOBS)?;
    let mut specifications = transaction.open_table(SPECIFICATIONS)?;
    let mut results = transaction.open_table(RESULTS)?;
    let mut starts = transaction.open_table(STARTS)?;
    for change in changes {
        if let Some((id, record)) = &change.record {
            jobs.insert(id.number(), record.as_slice())?;
            if let Some(document) = &change.document {
                specifications.insert(id.number(), &**document)?;
            }
            if let Some(found) = &change.results {
                results.insert(id.number(), found.json())?;
            }
        }
        for id in &change.forgotten {
            jobs.remove(id.number())?;
            specifications.remove(id.number())?;
            results.remove(id.number())?;
        }
    }
    if let Some(start) = start {
        starts.insert((), start)?;
    }
    Ok(())
}
