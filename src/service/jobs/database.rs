//! The tables of jobs, and the changes that are made to them, many in one transaction.

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

/// Pages kept in memory. What is read again soon was just written; the rest is for the system's own cache.
pub(super) const CACHE_BYTES: usize = 64 << 20;

/// What the database knows of jobs.
#[derive(Debug, Default)]
pub struct Rows {
    /// Those that can be read.
    pub records: Vec<(JobId, Record)>,
    /// The names of those that are as they were written, by a version that writes them otherwise.
    pub unreadable: Vec<JobId>,
    /// The names of those that are not as they were written, or gone.
    pub damaged: Vec<JobId>,
    /// The names of those that were so when the database was built anew.
    pub lost: Vec<JobId>,
    /// Whether a page could not be read.
    pub is_broken: bool,
}

/// The database of one process: the file is locked.
///
/// A page that the disk has changed can make the library fail or panic, after which it may refuse everything: it is then
/// opened anew, so that one bad page shuts no other. Where such a page is in the way of a change, the database is
/// built anew from what can be read.
pub struct Database {
    open: Box<Open>,
    /// Nothing where it could not be opened anew.
    redb: RwLock<Option<Redb>>,
    /// Nothing where it is only looked at.
    home: Option<Home>,
}

/// How the library opens it.
type Open = dyn Fn() -> io::Result<Redb> + Send + Sync;

impl Database {
    /// The database at `path`, made if it is not there, whose blocks have those sums.
    pub fn at(path: &Path, sums: Arc<Mutex<Sums>>) -> impl Fn() -> io::Result<Redb> + Send + Sync + use<> {
        let (path, opened) = (path.to_owned(), AtomicBool::new(false));
        move || {
            // A file that is gone is not made again: what it held would seem to be lost.
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
        Ok((Self { open: Box::new(open), redb: RwLock::new(Some(redb)), home: None }, format))
    }

    /// The same of the file at `path`, made if it is not there, which may be built anew.
    ///
    /// # Errors
    /// As of [`Database::open`].
    pub fn in_file(path: &Path, file: &dyn Fn(JobId) -> Option<InFile>) -> io::Result<(Self, Option<u64>)> {
        let sums = Arc::default();
        let (database, format) = Self::open(Self::at(path, Arc::clone(&sums)), file)?;
        Ok((Self { home: Some(Home::of(path, sums)?), ..database }, format))
    }

    /// One that is only looked at, and not opened again.
    pub fn looked_at(redb: Redb) -> Self {
        let open = || Err(io::ErrorKind::NotConnected.into());
        Self { open: Box::new(open), redb: RwLock::new(Some(redb)), home: None }
    }

    /// Whether its file is where it was opened.
    pub fn is_in_place(&self) -> bool {
        self.home.as_ref().is_none_or(Home::is_in_place)
    }

    /// Counts that it was built anew before it was opened.
    pub fn count_rebuild(&self) {
        if let Some(home) = &self.home {
            home.count_rebuild();
        }
    }

    /// How often it was built anew.
    pub fn rebuilds(&self) -> u64 {
        self.home.as_ref().map_or(0, Home::rebuilds)
    }

    /// What is known of jobs beside it, from now on.
    pub fn remember(&self, memory: Memory) {
        if let Some(home) = &self.home {
            home.remember(memory);
        }
    }

    /// Builds it anew from what can be read; its file stays beside under another name. The reason is told with what is lost.
    ///
    /// # Errors
    /// Those of the disk; nothing has changed.
    pub fn rebuild(&self, reason: &io::Error) -> io::Result<Salvaged> {
        let Some(home) = &self.home else { return Err(io::ErrorKind::ReadOnlyFilesystem.into()) };
        let source = if self.can_be_opened() { Source::Tables(self) } else { Source::leaves(home.path())? };
        let (rebuilt, salvaged) = home.rebuild(&source, reason)?;
        let last = self.redb.write().unwrap_or_else(PoisonError::into_inner).replace(rebuilt);
        // Whatever its last page says: it is not used any more.
        let _ = guarded(|| {
            drop(last);
            Ok(())
        });
        Ok(salvaged)
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
        self.insist(|redb| write(redb, changes.clone(), None))
    }

    /// Makes `changes` and counts a start of the service, all in one.
    ///
    /// # Errors
    /// Those of the disk; nothing has changed.
    pub fn start(&self, changes: &[Change], start: u64) -> io::Result<()> {
        self.insist(|redb| write(redb, changes, Some(start)))
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

    /// The jobs whose rows were lost when the database was built anew.
    pub(super) fn lost(&self) -> io::Result<Vec<JobId>> {
        self.named(LOST)
    }

    /// Forgotten jobs whose files were not removed before the process ended.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn forgotten(&self) -> io::Result<Vec<JobId>> {
        self.named(FORGOTTEN)
    }

    /// The names in a table that has nothing else, and may be absent.
    fn named(&self, table: TableDefinition<'_, u128, ()>) -> io::Result<Vec<JobId>> {
        self.with(|redb| {
            let names = match redb.begin_read()?.open_table(table) {
                Err(TableError::TableDoesNotExist(_)) => return Ok(Vec::new()),
                names => names?,
            };
            names.iter()?.map(|row| Ok(JobId::of_number(row?.0.value()))).collect()
        })
    }

    /// Every name in any of the tables, from both ends to the first page that cannot be read.
    pub fn names(&self) -> BTreeSet<JobId> {
        let mut names = self.names_in(JOBS);
        names.extend(self.names_in(SPECIFICATIONS));
        names.extend(self.names_in(RESULTS));
        names
    }

    /// Every name in a table, likewise.
    fn names_in<V>(&self, table: TableDefinition<'_, u128, V>) -> BTreeSet<JobId>
    where
        V: for<'a> redb::Value<SelfType<'a> = &'a [u8]> + 'static,
    {
        let names = RefCell::new(BTreeSet::new());
        let visit = |id, _: &[u8]| {
            names.borrow_mut().insert(id);
            ControlFlow::Continue(())
        };
        // Up to a page that cannot be read, from either end.
        let _ = self.scan(table, &visit);
        names.into_inner()
    }

    /// Shows every row of a table, oldest job first; where a page cannot be read, those before it, and then those behind it
    /// from the last one on. Stops where `visit` says so.
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

    /// A row of a table.
    pub(super) fn find<V>(&self, table: TableDefinition<'_, u128, V>, id: JobId) -> io::Result<Option<Vec<u8>>>
    where
        V: for<'a> redb::Value<SelfType<'a> = &'a [u8]> + 'static,
    {
        self.with(|redb| {
            let table = redb.begin_read()?.open_table(table)?;
            Ok(table.get(id.number())?.map(|bytes| bytes.value().to_vec()))
        })
    }

    /// Changes the database, built anew once where a damaged page is in the way.
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

    /// Whether it is open, or was not and is now.
    fn can_be_opened(&self) -> bool {
        self.redb.read().unwrap_or_else(PoisonError::into_inner).is_some() || self.reopen().is_ok()
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
