//! The data folder of a durable service:
//!
//! ```text
//! jobs.redb              for each job its row, its specification, and its results if they are short
//! jobs.redb.damaged-TIME the damaged file that a rebuild has replaced
//! results/ID.columns     long results
//! results/ID.rows        the rows of a sweep that has not ended
//! results/ID.json        long results of a version before format 3 that could not be converted to columns
//! results.orphaned       results whose job has no row, for instance since the database was lost
//! lock                   the file that the running service has locked; always empty
//! reserve                reserved room, so that jobs can be deleted on a full disk
//! running-N              the marks of the running jobs of the Nth start
//! ```
//!
//! The start of a service removes no admitted job and no result: the database may be missing, or of another version,
//! by a mistake that can be corrected.

use super::apart;
use super::change::Change;
use super::crashes::recover;
use super::database::{Database, Rows};
use super::ended::{Ended, Held};
use super::files::{self, Files};
use super::home::Memory;
use super::marks::Marks;
use super::reserve::Reserve;
use super::results::Long;
use super::tables::FORMAT;
use super::tenancy::{Tenancy, patiently};
use super::writer::{Unwritable, WriteSlot, Writer};
use super::{JobId, Record, Results, is_damage};
use crate::digest::Digest;
use crate::metrics::Metrics;
use std::collections::HashSet;
use std::ffi::OsStr;
use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{fs, io};

/// The name of the folder to which files of results that belong to no job are moved.
const ORPHANS: &str = "results.orphaned";

/// The contents of the data folder at the start of the service.
#[derive(Debug, Default)]
pub struct Found {
    /// The records of the jobs of earlier service processes, oldest job first.
    pub records: Vec<(JobId, Record)>,
    /// The number of jobs whose rows another version of the program wrote.
    pub unreadable: usize,
    /// The jobs whose rows are damaged or lost.
    pub damaged: HashSet<JobId>,
    /// The number of results without a job, which were moved to a folder of their own.
    pub orphaned: usize,
}

/// The opened data folder of the service: the database of jobs and the files of long results.
#[derive(Debug)]
pub struct Disk {
    database: Arc<Database>,
    files: Arc<Files>,
    marks: Marks,
    writer: Writer,
    _tenancy: Tenancy,
}

impl Disk {
    /// Opens the data folder, creating it if needed, and loads the jobs of earlier processes, oldest first. A job
    /// that was running counts one more crash, and has failed if there are too many. If `program` is given, a child
    /// process running it checks the database first.
    ///
    /// # Errors
    /// Another process uses the folder, or the disk reports an I/O error.
    pub fn open(folder: &Path, program: Option<&OsStr>, metrics: &Metrics) -> io::Result<(Self, Found)> {
        Self::recover(folder, program, metrics)
            .map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", folder.display())))
    }

    fn recover(folder: &Path, program: Option<&OsStr>, metrics: &Metrics) -> io::Result<(Self, Found)> {
        files::create(folder)?;
        let path = folder.join("jobs.redb");
        let patience = apart::patience(&path)?;
        let tenancy = Tenancy::take(folder, &path, patience)?;
        let is_healed = program.map_or(Ok(false), |program| apart::heal(program, folder))?;
        let files = Arc::new(Files::open(folder.join("results"))?);
        let reserve = Reserve::at(folder.join("reserve"));
        let open = || patiently(patience, || Database::in_file(&path, &|id| files.put_beside(id)));
        // On a full disk, releasing the reserved disk space may free just what opening the database takes.
        let (database, format) = open().or_else(|error| {
            if error.kind() != io::ErrorKind::StorageFull {
                return Err(error);
            }
            reserve.release();
            open()
        })?;
        let database = Arc::new(database);
        if is_healed {
            database.count_rebuild();
        }
        if let Some(format) = format.filter(|format| *format < FORMAT) {
            tracing::info!("the store was of format {format} and is of format {FORMAT} now");
        }
        if let Err(error) = fs::set_permissions(&path, Permissions::from_mode(files::OWN)) {
            tracing::warn!(%error, "others may be able to read {}", path.display());
        }
        files::sync(folder)?;
        let (Rows { mut records, unreadable, mut damaged, lost, .. }, start) = look(&database)?;
        damaged.extend(lost);
        if format.is_some_and(|format| format < FORMAT) {
            let is_columns = |record: &Record| {
                record.ended.as_ref().is_some_and(|ended| matches!(ended.held, Some(Held::Columns { .. })))
            };
            records.iter().filter(|(_, record)| is_columns(record)).for_each(|(id, _)| files.remove_json(*id));
        }
        let (running, was_short) = Marks::read(&Marks::path(folder, start))?;
        let running: HashSet<_> = running.into_iter().collect();
        // The last process may have ended before it removed the files of deleted jobs.
        let forgotten = database.forgotten().unwrap_or_default();
        forgotten.iter().try_for_each(|id| files.remove(*id))?;
        let mut changes = vec![Change { discarded: forgotten, ..Change::default() }];
        for (id, record) in &mut records {
            let is_alone = running.iter().all(|other| other == id);
            if recover(record, running.contains(id), is_alone, was_short) {
                changes.push(Change::record(*id, record));
            }
        }
        // The changes and the number of the start are one transaction, so that a crash is counted once.
        database.start(&changes, start + 1).or_else(|_| {
            reserve.release();
            database.start(&changes, start + 1)
        })?;
        // The marks of the last start have been counted, and older ones are obsolete.
        Marks::all(folder)?.into_iter().try_for_each(|(_, path)| fs::remove_file(path))?;
        let marks = Marks::create(&Marks::path(folder, start + 1))?;
        let named = records.iter().map(|(id, _)| id).chain(&unreadable).chain(&damaged).copied().collect();
        let orphans = folder.join(ORPHANS);
        let orphaned = files.sweep(&named, &orphans)?;
        if orphaned > 0 {
            let orphans = orphans.display();
            let why = if start == 0 { "the database is new" } else { "no job has them" };
            tracing::error!(orphaned, "{orphaned} results are set aside in {orphans}: {why}");
        }
        let writer = Writer::start(Arc::clone(&database), Arc::clone(&files), reserve, metrics.store_seconds())?;
        let found = Found { records, unreadable: unreadable.len(), damaged: damaged.into_iter().collect(), orphaned };
        Ok((Self { database, files, marks, writer, _tenancy: tenancy }, found))
    }

    /// Waits for a slot in the queue of changes to the database.
    ///
    /// # Errors
    /// The store cannot be written.
    pub async fn place(&self) -> Result<WriteSlot, Unwritable> {
        self.writer.place().await
    }

    /// Sets the function that returns the rows of jobs in memory, from which a rebuild restores rows that the database
    /// has lost.
    pub fn remember(&self, memory: Memory) {
        self.database.remember(memory);
    }

    /// Returns the number of times that the database of jobs was rebuilt.
    pub fn rebuilds(&self) -> u64 {
        self.database.rebuilds()
    }

    /// Whether the latest change to the database failed.
    pub fn has_failed(&self) -> bool {
        self.writer.has_failed()
    }

    /// The marks that say which job each worker runs.
    pub fn marks(&self) -> &Marks {
        &self.marks
    }

    /// Writes long results to their file, durably; short results are returned, to be written in the change that
    /// records the end of the job.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn put_away(&self, id: JobId, ended: Ended) -> io::Result<(Ended, Option<Arc<Results>>)> {
        let Some(Held::Memory(results)) = &ended.held else { return Ok((ended, None)) };
        let results = Arc::clone(results);
        Ok(match &*results {
            Results::Text(_) => (Ended { held: Some(Held::Table(results.fingerprint())), ..ended }, Some(results)),
            Results::Columns(Long { backing, json, index }) => {
                self.files.keep(id, backing)?;
                (Ended { held: Some(Held::Columns { json: *json, index: *index }), ..ended }, None)
            }
        })
    }

    /// Returns the path of the file with the rows of a sweep.
    pub fn rows(&self, id: JobId) -> PathBuf {
        self.files.rows(id)
    }

    /// Removes the file with the rows of a sweep that has ended.
    pub fn remove_rows(&self, id: JobId) {
        self.files.remove_rows(id);
    }

    /// Returns the path of a scratch file for the results of a job.
    pub fn scratch(&self, id: JobId) -> PathBuf {
        self.files.scratch(id)
    }

    /// Removes the rows and the files of the jobs `jobs`.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn erase(&self, jobs: Vec<JobId>) -> io::Result<()> {
        jobs.iter().for_each(|id| self.discard(*id));
        self.database.apply(&[Change::forgotten(jobs)])
    }

    /// Removes the results file of a deleted job.
    pub fn discard(&self, id: JobId) {
        self.files.discard(id);
    }

    /// Returns the posted specification of a job, verified against its digest.
    ///
    /// # Errors
    /// I/O errors of the disk; [`io::ErrorKind::InvalidData`] if the specification is damaged or missing.
    pub fn document(&self, id: JobId, digest: Option<&Digest>) -> io::Result<Vec<u8>> {
        let document = self.database.document(id)?.ok_or_else(gone)?;
        digest.ok_or_else(gone)?.vouch(document)
    }

    /// Returns the results of a job. Text is verified against its digest; columns are verified when they are read.
    ///
    /// # Errors
    /// I/O errors of the disk; [`io::ErrorKind::InvalidData`] if the results are damaged or missing.
    pub fn results(&self, id: JobId, held: &Held) -> io::Result<Arc<Results>> {
        let (text, json) = match held {
            Held::Memory(results) => return Ok(Arc::clone(results)),
            Held::Columns { json, index } => {
                return Ok(Arc::new(Results::Columns(self.files.columns(id, *json, *index))));
            }
            Held::Table(json) => (self.database.results(id)?, json),
            Held::File(json) => (self.files.find(id)?, json),
        };
        Results::vouched(text.ok_or_else(gone)?, json.digest).map(Arc::new)
    }

    /// Verifies every byte of the results of a job.
    ///
    /// # Errors
    /// See [`Disk::results`].
    pub fn verify(&self, id: JobId, held: &Held) -> io::Result<()> {
        match &*self.results(id, held)? {
            Results::Text(_) => Ok(()),
            Results::Columns(long) => long.verify(),
        }
    }
}

/// Returns the error for stored data of a job that are missing.
fn gone() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "it is not there any more")
}

/// Reads the rows of all jobs and the number of the latest start; rebuilds the database if one of its pages cannot be
/// read.
fn look(database: &Database) -> io::Result<(Rows, u64)> {
    let (rows, start) = (database.records(), database.starts());
    let reason = match start {
        Ok(start) if !rows.is_broken => return Ok((rows, start)),
        Err(error) if !is_damage(&error) => return Err(error),
        Err(error) => error,
        Ok(_) => io::Error::new(io::ErrorKind::InvalidData, "a page of the database cannot be read"),
    };
    match database.rebuild(&reason) {
        Ok(_) => Ok((database.records(), database.starts()?)),
        Err(error) => {
            tracing::error!(%error, "the database cannot be built anew");
            Ok((rows, database.starts()?))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::is_damage;
    use super::super::spool::Backing;
    use super::*;
    use crate::digest::Fingerprint;
    use std::time::{Duration, Instant};

    /// A temporary data folder for tests, removed when it is dropped.
    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Self {
            Self(std::env::temp_dir().join(format!("dvi-disk-{name}-{}", std::process::id())))
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    fn results(folder: &Folder, id: JobId) -> PathBuf {
        folder.0.join("results").join(format!("{id}.json"))
    }

    /// Opens the data folder as the next process does, once the writer thread of the previous `Disk` has ended.
    fn open(folder: &Folder) -> (Disk, Found) {
        Disk::open(&folder.0, None, &Metrics::default()).unwrap()
    }

    #[test]
    fn a_row_that_cannot_be_read_stays_with_its_results() {
        let folder = Folder::new("unreadable");
        let id = JobId::of_number(1);
        let (disk, _) = open(&folder);
        let row = br#"{"client": "of a later version"}"#.to_vec();
        let document = Some(Arc::from(&b"{}"[..]));
        disk.database.apply(&[Change { record: Some((id, row)), document, ..Change::default() }]).unwrap();
        fs::write(results(&folder, id), "{}").unwrap();
        drop(disk);
        for _ in 0..2 {
            let (disk, found) = open(&folder);
            assert_eq!((found.records.len(), found.unreadable, found.orphaned), (0, 1, 0));
            assert_eq!(disk.files.find(id).unwrap().unwrap(), b"{}");
        }
    }

    #[test]
    fn results_without_a_database_are_set_aside_and_the_marks_of_earlier_starts_removed() {
        let folder = Folder::new("orphans");
        let id = JobId::of_number(2);
        let (disk, _) = open(&folder);
        fs::write(results(&folder, id), "{}").unwrap();
        drop(disk);
        fs::remove_file(folder.0.join("jobs.redb")).unwrap();
        fs::write(Marks::path(&folder.0, 17), "").unwrap();
        let (disk, found) = open(&folder);
        assert_eq!((found.unreadable, found.orphaned), (0, 1));
        assert_eq!(fs::read(folder.0.join(ORPHANS).join(format!("{id}.json"))).unwrap(), b"{}");
        assert_eq!(disk.files.find(id).unwrap(), None);
        assert!(!Marks::path(&folder.0, 17).exists() && Marks::path(&folder.0, 1).exists());
    }

    #[test]
    fn long_results_of_the_second_format_become_columns_with_the_same_json() {
        let folder = Folder::new("second");
        let (disk, _) = open(&folder);
        let json = |value: f64| {
            format!(
                "{{\"version\":1,\"status\":\"completed\",\"verdict\":{{\"trusted\":true,\"because\":[],\"caveats\":[]}},\
                 \"trajectory\":{{\"t\":[0.0,{value:?}],\"fields\":{{\"x\":[0.1,1e-7]}},\"events\":[]}},\
                 \"diagnostics\":{{\"steps\":  7}}}}"
            )
        };
        // The file of the second text gets another text, as if it had been corrupted on the disk; the third text has
        // spaces that the encoder does not write, so that no columns encode it.
        let texts = [json(0.3), json(0.3), json(0.3).replace("0.1,", "0.1, ")];
        for (k, text) in texts.iter().enumerate() {
            let id = JobId::of_number(k as u128);
            let told = Fingerprint::of(text.as_bytes());
            let record = Record::example(Held::File(told));
            let document = Some(Arc::from(&b"{}"[..]));
            disk.database.apply(&[Change { document, ..Change::record(id, &record) }]).unwrap();
            fs::write(results(&folder, id), if k == 1 { json(0.4) } else { text.clone() }).unwrap();
        }
        drop(disk);
        let start = Instant::now();
        while super::super::tables::set_format(&folder.0.join("jobs.redb"), 2).is_err() {
            assert!(start.elapsed() < Duration::from_secs(20));
        }
        for _ in 0..2 {
            let (disk, found) = open(&folder);
            let held: Vec<Held> =
                found.records.into_iter().map(|(_, record)| record.ended.unwrap().held.unwrap()).collect();
            assert!(matches!(held.as_slice(), [Held::Columns { .. }, Held::File(_), Held::File(_)]), "{held:?}");
            let are_there = [0, 1, 2].map(|k| results(&folder, JobId::of_number(k)).exists());
            assert_eq!(are_there, [false, true, true]);
            let opened = disk.results(JobId::of_number(0), &held[0]).unwrap().open().unwrap();
            let mut read = Vec::new();
            solution::columnar::write_whole(&*opened.columns, &opened.skeleton, &mut read).unwrap();
            assert_eq!(String::from_utf8(read).unwrap(), texts[0]);
            assert!(is_damage(&disk.results(JobId::of_number(1), &held[1]).unwrap_err()));
            assert_eq!(disk.results(JobId::of_number(2), &held[2]).unwrap().text(), Some(texts[2].as_bytes()));
        }
    }

    #[test]
    fn pages_that_change_while_the_database_is_open_are_not_followed() {
        let folder = Folder::new("circles");
        files::create(&folder.0).unwrap();
        let path = folder.0.join("jobs.redb");
        let (database, _) = Database::in_file(&path, &|_| None).unwrap();
        let document: Arc<[u8]> = Arc::from(&[b' '; 1 << 20][..]);
        let record = Record {
            document: Some(Digest::of(&document)),
            ended: None,
            ..Record::example(Held::Table(Fingerprint::of(b"")))
        };
        // The specifications together are larger than the page cache of the database, so that they are read from the
        // disk.
        let ids: Vec<JobId> = (0..100).map(JobId::of_number).collect();
        for id in &ids {
            let document = Some(Arc::clone(&document));
            database.apply(&[Change { document, ..Change::record(*id, &record) }]).unwrap();
        }
        drop(database);
        let (database, _) = Database::in_file(&path, &|_| None).unwrap();
        let mut pages = fs::read(&path).unwrap();
        // Each branch page is made to refer to itself in place of its children, and a byte of each leaf page is
        // changed.
        for (number, page) in pages.chunks_mut(4096).enumerate().skip(1) {
            let others = usize::from(u16::from_le_bytes([page[2], page[3]])) + 1;
            let is_branch = page[0] == 2;
            match page.get_mut(8 + 16 * others..8 + 24 * others).filter(|_| is_branch) {
                Some(numbers) => {
                    numbers.chunks_mut(8).for_each(|other| other.copy_from_slice(&(number as u64 - 1).to_le_bytes()));
                }
                None => page[1000] ^= 1,
            }
        }
        fs::write(&path, &pages).unwrap();
        let read: Vec<_> = ids.iter().map(|id| database.document(*id)).collect();
        let unreadable = read.iter().filter(|read| read.as_ref().is_err_and(is_damage)).count();
        let whole = read.iter().flatten().filter(|read| read.as_deref() == Some(&*document)).count();
        assert_eq!((unreadable + whole, unreadable > 0), (ids.len(), true), "{unreadable} of them cannot be read");
    }

    #[test]
    fn what_is_kept_is_its_owners_alone() {
        let folder = Folder::new("owner");
        let id = JobId::of_number(3);
        let (disk, _) = open(&folder);
        disk.files.keep(id, &Backing::memory(b"{}".to_vec())).unwrap();
        for name in ["", "jobs.redb", "running-1", "results", &format!("results/{id}.columns")] {
            let mode = fs::metadata(folder.0.join(name)).unwrap().permissions().mode();
            assert_eq!(mode & 0o077, 0, "{name}: {mode:o}");
        }
    }
}
