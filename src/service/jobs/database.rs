//! The tables of jobs, and the changes that are made to them, many in one transaction.

use super::seal::{seal, unseal};
use super::tables::{self, FORMAT, InFile, JOBS, RESULTS, SPECIFICATIONS, STARTS};
use super::{JobId, Record, Results};
use redb::{Builder, Database as Redb, ReadableDatabase, ReadableTable, TableDefinition, WriteTransaction};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fmt;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, PoisonError, RwLock};

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

    /// Whether it takes hardly any room, or gives some back.
    pub fn is_small(&self) -> bool {
        self.document.is_none() && self.results.is_none()
    }

    /// The bytes of what it adds.
    pub fn bytes(&self) -> usize {
        let document = self.document.as_ref().map_or(0, |document| document.len());
        document + self.results.as_ref().map_or(0, |results| results.bytes())
    }

    /// Removes every row of these jobs.
    pub fn forgotten(forgotten: Vec<JobId>) -> Self {
        Self { forgotten, ..Self::default() }
    }
}

/// What the database knows of jobs.
#[derive(Debug, Default)]
pub struct Rows {
    /// Those that can be read.
    pub records: Vec<(JobId, Record)>,
    /// The names of those that are as they were written, by a version that writes them otherwise.
    pub unreadable: Vec<JobId>,
    /// The names of those that are not as they were written, or gone.
    pub damaged: Vec<JobId>,
}

/// The database of one process: the file is locked.
///
/// A page that the disk has changed can make the library fail or panic, after which it may refuse everything: it is then
/// opened anew, so that one bad page shuts no other.
pub struct Database {
    open: Box<Open>,
    /// Nothing where it could not be opened anew.
    redb: RwLock<Option<Redb>>,
}

/// How the library opens it.
type Open = dyn Fn() -> io::Result<Redb> + Send + Sync;

impl Database {
    /// The database at `path`, made if it is not there.
    pub fn at(path: &Path) -> impl Fn() -> io::Result<Redb> + Send + Sync + use<> {
        let (path, opened) = (path.to_owned(), AtomicBool::new(false));
        move || {
            // A file that is gone is not made again: what it held would seem to be lost.
            if opened.load(Relaxed) && !path.exists() {
                return Err(io::ErrorKind::NotFound.into());
            }
            let redb = guarded(|| Ok(Builder::new().set_cache_size(CACHE_BYTES).create(&path)?))?;
            opened.store(true, Relaxed);
            Ok(redb)
        }
    }

    /// Opens the database and brings it up to date; gives the format that it had, if there was anything. `file` looks at the
    /// file of results of a job, and puts columns beside it if it may.
    ///
    /// # Errors
    /// It is in use by another process, is no database or one of a later version, or cannot be made.
    pub fn open(
        open: impl Fn() -> io::Result<Redb> + Send + Sync + 'static,
        file: &dyn Fn(JobId) -> Option<InFile>,
    ) -> io::Result<(Self, Option<u64>)> {
        let redb = open()?;
        let format = guarded(|| tables::format(&redb))?;
        if let Some(format) = format
            && format > FORMAT
        {
            let told = format!(
                "the store has format {format}, of a later version of dvi; this one knows those up to {FORMAT}. Start that \
                 version again, or put back a copy from before it; nothing has been changed"
            );
            return Err(io::Error::new(io::ErrorKind::Unsupported, told));
        }
        // Also makes the tables, without which they could not be read.
        if format != Some(FORMAT) {
            guarded(|| tables::make(&redb, format, file))?;
        }
        Ok((Self { open: Box::new(open), redb: RwLock::new(Some(redb)) }, format))
    }

    /// Whether every page is as it was written. Writes what it mends.
    pub fn is_sound(&self) -> bool {
        let sound = match &mut *self.redb.write().unwrap_or_else(PoisonError::into_inner) {
            Some(redb) => guarded(|| Ok(redb.check_integrity()?)),
            None => Ok(false),
        };
        if sound.is_err()
            && let Err(error) = self.reopen()
        {
            tracing::error!(%error, "the database cannot be opened anew");
        }
        sound.unwrap_or(false)
    }

    /// Gives room that is not needed any more back to the disk.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn shrink(&self) -> io::Result<()> {
        let shrunk = match &mut *self.redb.write().unwrap_or_else(PoisonError::into_inner) {
            Some(redb) => guarded(|| {
                redb.compact().map(drop).map_err(|error| match error {
                    redb::CompactionError::Storage(error) => error.into(),
                    error => redb::Error::Corrupted(error.to_string()),
                })
            }),
            None => Ok(()),
        };
        if shrunk.is_err() {
            self.reopen()?;
        }
        shrunk
    }

    /// Makes `changes`, in their order, for good when it returns.
    ///
    /// # Errors
    /// Those of the disk; nothing has changed.
    pub fn apply<'a>(&self, changes: impl IntoIterator<Item = &'a Change> + Clone) -> io::Result<()> {
        self.with(|redb| write(redb, changes.clone(), None))
    }

    /// Makes `changes` and counts a start of the service, all in one.
    ///
    /// # Errors
    /// Those of the disk; nothing has changed.
    pub fn start(&self, changes: &[Change], start: u64) -> io::Result<()> {
        self.with(|redb| write(redb, changes, Some(start)))
    }

    /// The number of the latest start.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn starts(&self) -> io::Result<u64> {
        self.with(|redb| Ok(redb.begin_read()?.open_table(STARTS)?.get(())?.map_or(0, |start| start.value())))
    }

    /// Every row, oldest job first; one that cannot be read is named in the log and left as it is.
    pub fn records(&self) -> Rows {
        let all = self.with(|redb| {
            let mut rows = Rows::default();
            for row in redb.begin_read()?.open_table(JOBS)?.iter()? {
                let (number, sealed) = row?;
                rows.take(JobId::of_number(number.value()), Some(sealed.value()));
            }
            Ok(rows)
        });
        let rows = all.unwrap_or_else(|error| {
            tracing::error!(%error, "a page of the database is damaged; rows are looked up one by one");
            let mut rows = Rows::default();
            for id in self.names() {
                let sealed = self.find(JOBS, id);
                rows.take(id, sealed.ok().flatten().as_deref());
            }
            rows
        });
        for id in &rows.unreadable {
            tracing::error!(job.id = %id, "the row of job {id} cannot be read; it is kept as it is");
        }
        for id in &rows.damaged {
            tracing::error!(job.id = %id, "the row of job {id} is damaged; it is kept as it is");
        }
        rows
    }

    /// Every name in any of the tables, from both ends to the first page that cannot be read.
    pub fn names(&self) -> BTreeSet<JobId> {
        let mut names = self.names_in(JOBS);
        names.extend(self.names_in(SPECIFICATIONS));
        names.extend(self.names_in(RESULTS));
        names
    }

    /// Every name in a table, likewise.
    fn names_in<V: redb::Value + 'static>(&self, table: TableDefinition<'_, u128, V>) -> BTreeSet<JobId> {
        // Kept outside of the work, which may end half way.
        let names = RefCell::new(BTreeSet::new());
        for backwards in [false, true] {
            let whole = self.with(|redb| {
                let table = redb.begin_read()?.open_table(table)?;
                let mut rows = table.iter()?;
                while let Some(row) = if backwards { rows.next_back() } else { rows.next() } {
                    names.borrow_mut().insert(JobId::of_number(row?.0.value()));
                }
                Ok(())
            });
            if whole.is_ok() {
                break;
            }
        }
        names.into_inner()
    }

    /// What was posted for a job.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn document(&self, id: JobId) -> io::Result<Option<Vec<u8>>> {
        self.find(SPECIFICATIONS, id)
    }

    /// The results of a job, where they are in the table.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn results(&self, id: JobId) -> io::Result<Option<Vec<u8>>> {
        self.find(RESULTS, id)
    }

    fn find<V>(&self, table: TableDefinition<'_, u128, V>, id: JobId) -> io::Result<Option<Vec<u8>>>
    where
        V: for<'a> redb::Value<SelfType<'a> = &'a [u8]> + 'static,
    {
        self.with(|redb| {
            let table = redb.begin_read()?.open_table(table)?;
            Ok(table.get(id.number())?.map(|bytes| bytes.value().to_vec()))
        })
    }

    /// Works with the database, opened anew first where it is not open and afterwards where the work failed.
    fn with<T>(&self, work: impl Fn(&Redb) -> Result<T, redb::Error>) -> io::Result<T> {
        if self.redb.read().unwrap_or_else(PoisonError::into_inner).is_none() {
            self.reopen()?;
        }
        let done = match &*self.redb.read().unwrap_or_else(PoisonError::into_inner) {
            Some(redb) => guarded(|| work(redb)),
            None => Err(io::ErrorKind::NotConnected.into()),
        };
        if done.is_err()
            && let Err(error) = self.reopen()
        {
            tracing::error!(%error, "the database cannot be opened anew");
        }
        done
    }

    /// Opens the database anew.
    ///
    /// # Errors
    /// As of [`Database::open`].
    pub fn reopen(&self) -> io::Result<()> {
        let mut redb = self.redb.write().unwrap_or_else(PoisonError::into_inner);
        guarded(|| {
            drop(redb.take());
            Ok(())
        })?;
        *redb = Some((self.open)()?);
        Ok(())
    }
}

impl Rows {
    /// Takes in what was found of the row of a job.
    fn take(&mut self, id: JobId, sealed: Option<&[u8]>) {
        match sealed.and_then(|sealed| unseal(id, sealed)).map(serde_json::from_slice) {
            Some(Ok(record)) => self.records.push((id, record)),
            Some(Err(error)) => {
                tracing::debug!(job.id = %id, %error, "a row of another version");
                self.unreadable.push(id);
            }
            None => self.damaged.push(id),
        }
    }
}

impl fmt::Debug for Database {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Database").finish_non_exhaustive()
    }
}

/// Does work with the library; a panic of it, as over a damaged page, is an error like others. The log has its place.
pub fn guarded<T>(work: impl FnOnce() -> Result<T, redb::Error>) -> io::Result<T> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(done)) => Ok(done),
        Ok(Err(redb::Error::DatabaseAlreadyOpen)) => {
            Err(io::Error::new(io::ErrorKind::ResourceBusy, "the store is in use by another process"))
        }
        Ok(Err(redb::Error::Io(error))) if error.kind() != io::ErrorKind::UnexpectedEof => Err(error),
        Ok(Err(error @ (redb::Error::Corrupted(_) | redb::Error::Io(_)))) => {
            Err(io::Error::new(io::ErrorKind::InvalidData, format!("the database is damaged: {error}")))
        }
        Ok(Err(error)) => Err(io::Error::other(error)),
        Err(_) => Err(io::Error::new(io::ErrorKind::InvalidData, "a page of the database is damaged")),
    }
}

fn write<'a>(
    redb: &Redb,
    changes: impl IntoIterator<Item = &'a Change>,
    start: Option<u64>,
) -> Result<(), redb::Error> {
    let mut transaction = redb.begin_write()?;
    // A kill at any moment then leaves a file that opens at once.
    transaction.set_quick_repair(true);
    make(&transaction, changes, start)?;
    transaction.commit()?;
    Ok(())
}

fn make<'a>(
    transaction: &WriteTransaction,
    changes: impl IntoIterator<Item = &'a Change>,
    start: Option<u64>,
) -> Result<(), redb::Error> {
    let mut jobs = transaction.open_table(JOBS)?;
    let mut specifications = transaction.open_table(SPECIFICATIONS)?;
    let mut results = transaction.open_table(RESULTS)?;
    let mut starts = transaction.open_table(STARTS)?;
    for change in changes {
        if let Some((id, record)) = &change.record {
            if let Some(document) = &change.document {
                specifications.insert(id.number(), &**document)?;
            } else if jobs.get(id.number())?.is_none() {
                // News of a job that could not be stored.
                continue;
            }
            jobs.insert(id.number(), seal(*id, record).as_slice())?;
            if let Some(json) = change.results.as_ref().and_then(|results| results.text()) {
                results.insert(id.number(), json)?;
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
