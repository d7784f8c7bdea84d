//! The files of long results. A file gets its final name only once it is complete on the disk: it is written under
//! another name, synced and renamed, and the folder is synced (Pillai et al. 2014, "All file systems are not created
//! equal").

use super::JobId;
use super::results::Long;
use super::spool::Backing;
use super::tables::InFile;
use crate::digest::{Fingerprint, Measure};
use solution::columnar::{Skeleton, write_columns, write_whole};
use std::collections::{BTreeSet, HashSet};
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// The suffixes of file names: results as columns and as JSON, unfinished files, and scratch files of results.
const COLUMNS: &str = ".columns";
const JSON: &str = ".json";
const PART: &str = ".part";
const SCRATCH: &str = ".scratch";
/// The suffix of files with the rows of a sweep that has not ended.
const ROWS: &str = ".rows";

/// The suffixes of files with results of ended jobs.
const KINDS: [&str; 2] = [COLUMNS, JSON];

/// A folder with the files of the long results of jobs.
#[derive(Debug)]
pub struct Files {
    folder: PathBuf,
}

impl Files {
    /// Opens the folder of results, creating it if needed.
    ///
    /// # Errors
    /// The folder cannot be created.
    pub fn open(folder: PathBuf) -> io::Result<Self> {
        create(&folder)?;
        Ok(Self { folder })
    }

    /// Refers to an existing folder with files of results.
    pub fn at(folder: PathBuf) -> Self {
        Self { folder }
    }

    /// Returns the jobs that have a file of results.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn names(&self) -> io::Result<BTreeSet<JobId>> {
        let entries = fs::read_dir(&self.folder)?.flatten();
        Ok(entries.filter_map(|entry| of_any(entry.file_name().to_str()?, &KINDS)).collect())
    }

    /// Stores the columns of a job's results, durably.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn keep(&self, id: JobId, backing: &Backing) -> io::Result<()> {
        let scratch = match backing {
            Backing::Memory(bytes) => return self.write(id, bytes),
            Backing::Scratch(scratch) => scratch.path(),
            Backing::File(_) => return Ok(()),
        };
        File::open(scratch)?.sync_all()?;
        let path = self.path(id, COLUMNS);
        match fs::hard_link(scratch, &path) {
            Ok(()) => sync(&self.folder),
            // The existing file has the results of an earlier solve of the job, whose end was not recorded in the
            // database.
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                fs::remove_file(&path)?;
                fs::hard_link(scratch, &path)?;
                sync(&self.folder)
            }
            // On a file system without hard links, the columns of the results are copied from the scratch file.
            Err(_) => self.write(id, &fs::read(scratch)?),
        }
    }

    /// Writes the columns of a job's results to their file, durably.
    fn write(&self, id: JobId, bytes: &[u8]) -> io::Result<()> {
        let unfinished = self.path(id, PART);
        let written = write_as(&unfinished, bytes).and_then(|()| fs::rename(&unfinished, self.path(id, COLUMNS)));
        if written.is_err() {
            // The write may have failed on a full disk, where the unfinished file must not occupy the remaining
            // space.
            let _ = fs::remove_file(&unfinished);
        }
        written?;
        sync(&self.folder)
    }

    /// Returns the path of a scratch file for the columns of a job's results.
    pub fn scratch(&self, id: JobId) -> PathBuf {
        self.path(id, SCRATCH)
    }

    /// Returns a reference to the stored columns of a job's results, which are opened when they are read.
    pub fn columns(&self, id: JobId, json: Fingerprint, index: Fingerprint) -> Long {
        Long { backing: Backing::File(self.path(id, COLUMNS)), json, index }
    }

    /// Removes the files of the results of a deleted job; a failure is logged.
    pub fn discard(&self, id: JobId) {
        if let Err(error) = self.remove(id) {
            tracing::warn!(job.id = %id, %error, "a file of results is left behind until the next start");
        }
    }

    /// Reads the results of a job as JSON, if the job has a JSON file.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn find(&self, id: JobId) -> io::Result<Option<Vec<u8>>> {
        match fs::read(self.path(id, JSON)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            json => json.map(Some),
        }
    }

    /// Returns the fingerprint (length and digest) of the JSON file of a job's results, as a version before format 3
    /// wrote it, if it can be read.
    pub fn look(&self, id: JobId) -> Option<InFile> {
        Some(InFile { json: Fingerprint::of(&self.find(id).ok()??), index: None })
    }

    /// Writes columns that encode the identical JSON beside the JSON file of a job, and returns the fingerprints of
    /// both; without columns if such columns do not exist or cannot be written.
    ///
    /// The JSON file stays until the row of the job refers to the columns.
    pub fn put_beside(&self, id: JobId) -> Option<InFile> {
        let text = self.find(id).ok()??;
        let json = Fingerprint::of(&text);
        let index = self.write_beside(id, &text, json).unwrap_or_else(|error| {
            tracing::warn!(job.id = %id, %error, "the results of job {id} stay as they are");
            None
        });
        Some(InFile { json, index })
    }

    fn write_beside(&self, id: JobId, text: &[u8], json: Fingerprint) -> io::Result<Option<Fingerprint>> {
        let (skeleton, trajectory) = Skeleton::read(text)?;
        let mut measure = Measure::new(text.len());
        let same = write_whole(&trajectory, &skeleton, &mut measure).is_ok() && measure.fingerprint() == json;
        if !same {
            return Ok(None);
        }
        let mut bytes = Vec::new();
        let index = Fingerprint::of(&write_columns(&trajectory, None, &skeleton, &mut bytes)?);
        self.write(id, &bytes)?;
        Ok(Some(index))
    }

    /// Removes the JSON file of the results of a job whose row in the database refers to columns.
    pub fn remove_json(&self, id: JobId) {
        if let Err(error) = remove(&self.path(id, JSON)) {
            tracing::warn!(job.id = %id, %error, "a file of results is left behind");
        }
    }

    /// Returns the path of the file with the rows of the sweep `id`.
    pub fn rows(&self, id: JobId) -> PathBuf {
        self.path(id, ROWS)
    }

    /// Removes the file with the rows of a sweep that has ended, if there is one; a failure is logged.
    pub fn remove_rows(&self, id: JobId) {
        if let Err(error) = remove(&self.rows(id)) {
            tracing::warn!(job.id = %id, %error, "a file of rows is left behind");
        }
    }

    /// Removes the results of a job, if there are any.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn remove(&self, id: JobId) -> io::Result<()> {
        KINDS.iter().chain([&ROWS]).try_for_each(|kind| remove(&self.path(id, kind)))
    }

    /// Removes unfinished and scratch files of an earlier process, and moves all other files that belong to none of
    /// `jobs` to the folder `orphans`; returns the number of moved files. No complete file is removed.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn sweep(&self, jobs: &HashSet<JobId>, orphans: &Path) -> io::Result<usize> {
        let mut set_aside = 0;
        for entry in fs::read_dir(&self.folder)? {
            let entry = entry?;
            let (path, name) = (entry.path(), entry.file_name());
            let of = |kinds: &[&str]| name.to_str().and_then(|name| of_any(name, kinds));
            if of(&[PART, SCRATCH]).is_some() {
                fs::remove_file(path)?;
            } else if !of(&KINDS).or(of(&[ROWS])).is_some_and(|id| jobs.contains(&id)) {
                create(orphans)?;
                fs::rename(path, orphans.join(&name))?;
                set_aside += 1;
            }
        }
        if set_aside > 0 {
            sync(orphans)?;
            sync(&self.folder)?;
        }
        Ok(set_aside)
    }

    fn path(&self, id: JobId, kind: &str) -> PathBuf {
        self.folder.join(format!("{id}{kind}"))
    }
}

fn write_as(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = OpenOptions::new().write(true).create(true).truncate(true).mode(OWN).open(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Removes the file at `path`, if it exists.
fn remove(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// Returns the job whose file has this name, with one of the suffixes `kinds`.
fn of_any(name: &str, kinds: &[&str]) -> Option<JobId> {
    kinds.iter().find_map(|kind| name.strip_suffix(kind)?.parse().ok())
}

/// The access modes of files and folders: for the owner only, since specifications and results are confidential.
pub const OWN: u32 = 0o600;
const OWN_FOLDER: u32 = 0o700;

/// Creates a folder with access for the owner only, if it does not exist.
///
/// # Errors
/// I/O errors of the disk.
pub fn create(folder: &Path) -> io::Result<()> {
    DirBuilder::new().recursive(true).mode(OWN_FOLDER).create(folder)
}

/// Syncs a folder, so that its entries are durable.
///
/// # Errors
/// I/O errors of the disk.
pub fn sync(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}
