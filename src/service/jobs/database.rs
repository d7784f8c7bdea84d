//! The database of jobs, whose changes are made in transactions of many at a time.

use super::change::{Change, write};
use super::guarded::guarded;
use super::home::{Home, Memory};
use super::salvage::{Salvaged, Source};
use super::seal::unseal;
use super::tables::{self, FORGOTTEN, FORMAT, InFile, JOBS, LOST, RESULTS, SPECIFICATIONS, STARTS};
use super::watched::{Sums, Watched};
use super::{JobId, Record, is_damage};
use redb::{Builder, Database as Redb, ReadableDatabase, ReadableTable, TableDefinition, TableError};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fmt;
use std::fs::OpenOptions;
use std::io;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError, RwLock};

/// The size of the page cache of the database library, in bytes. It serves pages that are read soon after they were
/// written; for others there is the page cache of the system.
pub(super) const CACHE_BYTES: usize = 64 << 20;

/// The rows of all jobs in the database, sorted by whether they can be read.
#[derive(Debug, Default)]
pub struct Rows {
    /// The ids and contents of the rows of jobs that can be read.
    pub records: Vec<(JobId, Record)>,
    /// The ids of jobs with an intact row in the format of another version of the program.
    pub unreadable: Vec<JobId>,
    /// The ids of jobs whose row is damaged or missing.
    pub damaged: Vec<JobId>,
    /// The ids of rows that were damaged or missing when the database was last rebuilt.
    pub lost: Vec<JobId>,
    /// Whether a page of the database could not be read.
    pub is_broken: bool,
}

/// The open database of jobs; its file is locked against other processes.
///
/// A corrupted page can make the database library fail or panic, after which it may refuse all further calls: the
/// database is then reopened, so that one bad page does not block access to the others. If a corrupted page prevents
/// a change, the database is rebuilt from what can be read.
pub struct Database {
    open: Box<Open>,
    /// The open database of the database library; `None` if the database could not be reopened.
    redb: RwLock<Option<Redb>>,
    /// The place of the database file; `None` if the database is only inspected and must not be rebuilt.
    home: Option<Home>,
}

/// A function that opens or reopens the database file.
type Open = dyn Fn() -> io::Result<Redb> + Send + Sync;

impl Database {
    /// Returns a function that opens the database at `path`, creating it the first time; `sums` are the checksums of
    /// the blocks of its file.
    pub fn at(path: &Path, sums: Arc<Mutex<Sums>>) -> impl Fn() -> io::Result<Redb> + Send + Sync + use<> {
        let (path, opened) = (path.to_owned(), AtomicBool::new(false));
        move || {
            // A database file that has disappeared is not created again: its jobs would seem to be lost.
            if opened.load(Relaxed) && !path.exists() {
                return Err(io::ErrorKind::NotFound.into());
            }
            let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path)?;
            let watched = Watched::over(file, sums.lock().unwrap_or_else(PoisonError::into_inner).clone())?;
            let redb = guarded(|| Ok(Builder::new().set_cache_size(CACHE_BYTES).create_with_backend(watched)?))?;
            opened.store(true, Relaxed);
            Ok(redb)
        }
    }

    /// Opens the database and converts it to the current format; also returns its former format, `None` if it was
    /// empty. `file` examines the results file of a job, and may write columns beside it.
    ///
    /// # Errors
    /// The file is in use by another process, is not a database or one of a later version, or cannot be created.
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
        // The conversion to the current format also creates the tables, which must exist to be read.
        if format != Some(FORMAT) {
            guarded(|| tables::make(&redb, format, file))?;
        }
        Ok((Self { open: Box::new(open), redb: RwLock::new(Some(redb)), home: None }, format))
    }

    /// Opens the database at `path`, creating it if needed, for a service that may rebuild it.
    ///
    /// # Errors
    /// See [`Database::open`].
    pub fn in_file(path: &Path, file: &dyn Fn(JobId) -> Option<InFile>) -> io::Result<(Self, Option<u64>)> {
        let sums = Arc::default();
        let (database, format) = Self::open(Self::at(path, Arc::clone(&sums)), file)?;
        Ok((Self { home: Some(Home::of(path, sums)?), ..database }, format))
    }

    /// Wraps a database that is only inspected, and cannot be reopened.
    pub fn looked_at(redb: Redb) -> Self {
        let open = || Err(io::ErrorKind::NotConnected.into());
        Self { open: Box::new(open), redb: RwLock::new(Some(redb)), home: None }
    }

    /// Whether the opened database file is still at its path.
    pub fn is_in_place(&self) -> bool {
        self.home.as_ref().is_none_or(Home::is_in_place)
    }

    /// Counts a rebuild of the database that was made before the database was opened.
    pub fn count_rebuild(&self) {
        if let Some(home) = &self.home {
            home.count_rebuild();
        }
    }

    /// Returns the number of times that the database was rebuilt.
    pub fn rebuilds(&self) -> u64 {
        self.home.as_ref().map_or(0, Home::rebuilds)
    }

    /// Sets the function that returns the rows of jobs in memory, from which a rebuild of the database restores lost
    /// rows.
    pub fn remember(&self, memory: Memory) {
        if let Some(home) = &self.home {
            home.remember(memory);
        }
    }

    /// Rebuilds the database from what can be read; the damaged file is kept under another name. Logs `reason` and
    /// the losses.
    ///
    /// # Errors
    /// I/O errors of the disk; the database is unchanged.
    pub fn rebuild(&self, reason: &io::Error) -> io::Result<Salvaged> {
        let Some(home) = &self.home else { return Err(io::ErrorKind::ReadOnlyFilesystem.into()) };
        let source = if self.can_be_opened() { Source::Tables(self) } else { Source::leaves(home.path())? };
        let (rebuilt, salvaged) = home.rebuild(&source, reason)?;
        let last = self.redb.write().unwrap_or_else(PoisonError::into_inner).replace(rebuilt);
        // Errors of closing the damaged database do not matter after its replacement.
        let _ = guarded(|| {
            drop(last);
            Ok(())
        });
        Ok(salvaged)
    }

    /// Whether every page of the database is intact. May write repairs to the file.
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

    /// Compacts the database file, which returns unused space to the disk.
    ///
    /// # Errors
    /// I/O errors of the disk.
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

    /// Makes `changes`, in their order, durably.
    ///
    /// # Errors
    /// I/O errors of the disk; the database is unchanged.
    pub fn apply<'a>(&self, changes: impl IntoIterator<Item = &'a Change> + Clone) -> io::Result<()> {
        self.insist(|redb| write(redb, changes.clone(), None))
    }

    /// Makes `changes` and stores `start` as the number of starts of the service, in one transaction.
    ///
    /// # Errors
    /// I/O errors of the disk; the database is unchanged.
    pub fn start(&self, changes: &[Change], start: u64) -> io::Result<()> {
        self.insist(|redb| write(redb, changes, Some(start)))
    }

    /// Returns the number of the latest start of the service.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn starts(&self) -> io::Result<u64> {
        self.with(|redb| Ok(redb.begin_read()?.open_table(STARTS)?.get(())?.map_or(0, |start| start.value())))
    }

    /// Reads the rows of all jobs, oldest job first; rows that cannot be read are logged and left in the database.
    pub fn records(&self) -> Rows {
        let all = RefCell::new(Rows::default());
        let whole = self.scan(JOBS, &|id, sealed| {
            all.borrow_mut().take(id, Some(sealed));
            ControlFlow::Continue(())
        });
        let mut rows = all.into_inner();
        if let Err(error) = whole {
            tracing::error!(%error, "a page of the database is damaged; rows are looked up one by one");
            rows = Rows { is_broken: true, ..Rows::default() };
            for id in self.names() {
                let sealed = self.find(JOBS, id);
                rows.take(id, sealed.ok().flatten().as_deref());
            }
        }
        for id in &rows.unreadable {
            tracing::error!(job.id = %id, "the row of job {id} cannot be read; it is kept as it is");
        }
        for id in &rows.damaged {
            tracing::error!(job.id = %id, "the row of job {id} is damaged; it is kept as it is");
        }
        match self.lost() {
            Ok(lost) => rows.lost = lost,
            Err(_) => rows.is_broken = true,
        }
        rows
    }

    /// Returns the jobs whose rows were lost when the database was rebuilt.
    pub(super) fn lost(&self) -> io::Result<Vec<JobId>> {
        self.named(LOST)
    }

    /// Returns the deleted jobs whose files may still exist, since the process ended before it removed them.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn forgotten(&self) -> io::Result<Vec<JobId>> {
        self.named(FORGOTTEN)
    }

    /// Returns the job ids in a table of the database that has ids only; no ids if there is no such table.
    fn named(&self, table: TableDefinition<'_, u128, ()>) -> io::Result<Vec<JobId>> {
        self.with(|redb| {
            let names = match redb.begin_read()?.open_table(table) {
                Err(TableError::TableDoesNotExist(_)) => return Ok(Vec::new()),
                names => names?,
            };
            names.iter()?.map(|row| Ok(JobId::of_number(row?.0.value()))).collect()
        })
    }

    /// Returns all job ids in any table of the database, read from both ends of each table up to the first page that
    /// cannot be read.
    pub fn names(&self) -> BTreeSet<JobId> {
        let mut names = self.names_in(JOBS);
        names.extend(self.names_in(SPECIFICATIONS));
        names.extend(self.names_in(RESULTS));
        names
    }

    /// Returns all job ids in one table of the database, read from both ends up to the first page that cannot be read.
    fn names_in<V>(&self, table: TableDefinition<'_, u128, V>) -> BTreeSet<JobId>
    where
        V: for<'a> redb::Value<SelfType<'a> = &'a [u8]> + 'static,
    {
        let names = RefCell::new(BTreeSet::new());
        let visit = |id, _: &[u8]| {
            names.borrow_mut().insert(id);
            ControlFlow::Continue(())
        };
        // After a read error, the job ids that were found from either end of the table are returned.
        let _ = self.scan(table, &visit);
        names.into_inner()
    }

    /// Visits the rows of a table, oldest job first. If a page cannot be read, visits the rows before it, and then
    /// those behind it, from the last one backwards. Stops when `visit` breaks.
    ///
    /// # Errors
    /// A page could not be read.
    pub(super) fn scan<V>(
        &self,
        table: TableDefinition<'_, u128, V>,
        visit: &dyn Fn(JobId, &[u8]) -> ControlFlow<()>,
    ) -> io::Result<()>
    where
        V: for<'a> redb::Value<SelfType<'a> = &'a [u8]> + 'static,
    {
        let through = |backwards| {
            self.with(|redb| {
                let table = redb.begin_read()?.open_table(table)?;
                let mut rows = table.iter()?;
                while let Some(row) = if backwards { rows.next_back() } else { rows.next() } {
                    let (number, bytes) = row?;
                    if visit(JobId::of_number(number.value()), bytes.value()).is_break() {
                        break;
                    }
                }
                Ok(())
            })
        };
        through(false).inspect_err(|_| drop(through(true)))
    }

    /// Returns the posted specification of a job, if it is in the database.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn document(&self, id: JobId) -> io::Result<Option<Vec<u8>>> {
        self.find(SPECIFICATIONS, id)
    }

    /// Returns the results of a job, if they are in the database.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn results(&self, id: JobId) -> io::Result<Option<Vec<u8>>> {
        self.find(RESULTS, id)
    }

    /// Returns the value that a table of the database has for a job.
    pub(super) fn find<V>(&self, table: TableDefinition<'_, u128, V>, id: JobId) -> io::Result<Option<Vec<u8>>>
    where
        V: for<'a> redb::Value<SelfType<'a> = &'a [u8]> + 'static,
    {
        self.with(|redb| {
            let table = redb.begin_read()?.open_table(table)?;
            Ok(table.get(id.number())?.map(|bytes| bytes.value().to_vec()))
        })
    }

    /// Does `work` on the database; if a damaged page prevents it, rebuilds the database once and does the work again.
    fn insist<T>(&self, work: impl Fn(&Redb) -> Result<T, redb::Error>) -> io::Result<T> {
        let done = self.with(&work);
        let Err(damage) = &done else { return done };
        if !is_damage(damage) || !self.home.as_ref().is_some_and(Home::may_be_rebuilt) {
            return done;
        }
        if let Err(error) = self.rebuild(damage) {
            tracing::error!(%error, "the database cannot be built anew");
            return done;
        }
        let done = self.with(work);
        if let (Err(error), Some(home)) = (&done, &self.home)
            && is_damage(error)
        {
            home.give_up();
        }
        done
    }

    /// Calls `work` with the database, reopening it first if it is not open, and afterwards if `work` failed.
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

    /// Whether the database is open, after an attempt to reopen it if it was not.
    fn can_be_opened(&self) -> bool {
        self.redb.read().unwrap_or_else(PoisonError::into_inner).is_some() || self.reopen().is_ok()
    }

    /// Closes the database, if it is open, and opens it again.
    ///
    /// # Errors
    /// See [`Database::open`].
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
    /// Decodes the stored row of a job and adds the job to the readable, unreadable or damaged ones; `None` is a row
    /// that was not found.
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
