//! Marks of running jobs: a file which says what job each worker runs, so that the next process knows which jobs were
//! running when this process died.
//!
//! The id of a job is written into its worker's slot of the file before the job starts. The write is not synced: data
//! written by a process outlive it, and a power failure, in which a mark may be lost, is no evidence against a job.
//! So a mark costs a microsecond, while a commit would wait for the disk.
//!
//! The header of the file contains the number of processes that the system had killed for lack of memory, up to the
//! last kill that this process has noticed: if the process itself is killed, the system's count is larger.

use super::JobId;
use super::files::OWN;
use super::shortage::Taken;
use std::fs::{self, DirEntry, File, OpenOptions};
use std::io;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// The prefix of the name of a file of marks (which job each worker runs); the name ends with the number of the
/// service's start.
const PREFIX: &str = "running-";

/// The size of a worker's slot in the file of marks, in bytes: the id of a job and a line feed.
const SLOT: usize = 37;

/// The size of the header of a file of marks, in bytes: that of two slots, since versions before 0.2 read the whole
/// file as slots.
const HEAD: usize = 2 * SLOT;

/// The open file of the marks of one service process, which say which job each worker runs.
#[derive(Debug)]
pub struct Marks {
    file: File,
}

impl Marks {
    /// Returns the path in `folder` of the file of marks of the service's start number `start`.
    pub fn path(folder: &Path, start: u64) -> PathBuf {
        folder.join(format!("{PREFIX}{start}"))
    }

    /// Returns the number and the path of the marks of every start of the service in `folder`.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn all(folder: &Path) -> io::Result<Vec<(u64, PathBuf)>> {
        let number = |entry: &DirEntry| entry.file_name().to_str()?.strip_prefix(PREFIX)?.parse().ok();
        let entries = fs::read_dir(folder)?.collect::<io::Result<Vec<_>>>()?;
        Ok(entries.iter().filter_map(|entry| Some((number(entry)?, entry.path()))).collect())
    }

    /// Creates a file for the marks of running jobs, without marks.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(path: &Path) -> io::Result<Self> {
        let file = OpenOptions::new().write(true).create(true).truncate(true).mode(OWN).open(path)?;
        let marks = Self { file };
        if let Some(taken) = Taken::now() {
            marks.account(&taken)?;
        }
        Ok(marks)
    }

    /// Writes the number of kills for lack of memory that this process has noticed.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn account(&self, taken: &Taken) -> io::Result<()> {
        self.file.write_all_at(format!("{:<1$}\n", taken.line(), HEAD - 1).as_bytes(), 0)
    }

    /// Reads the marked jobs (none if there is no such file), and whether the system has run out of memory since the
    /// header was written.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn read(path: &Path) -> io::Result<(Vec<JobId>, bool)> {
        let text = match fs::read(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok((Vec::new(), false)),
            text => text?,
        };
        let head = text.split_first_chunk::<HEAD>().and_then(|(head, _)| Taken::read(str::from_utf8(head).ok()?));
        let was_short = head.zip(Taken::now()).is_some_and(|(then, now)| now.since(&then) > 0);
        let jobs = text.chunks(SLOT).filter_map(|slot| str::from_utf8(slot).ok()?.trim_end().parse().ok());
        Ok((jobs.collect(), was_short))
    }

    /// Marks `id` as the running job of a worker.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn set(&self, worker: usize, id: JobId) -> io::Result<()> {
        self.write(worker, &format!("{id}\n"))
    }

    /// Marks a worker as idle, after its job has left it.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn clear(&self, worker: usize) -> io::Result<()> {
        self.write(worker, &format!("{:>1$}", '\n', SLOT))
    }

    fn write(&self, worker: usize, text: &str) -> io::Result<()> {
        self.file.write_all_at(text.as_bytes(), (HEAD + worker * SLOT) as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_marked_and_not_cleared_is_found_again() {
        let path = std::env::temp_dir().join(format!("dvi-marks-{}", std::process::id()));
        let ids = [1, 2, 3].map(JobId::of_number);
        let marks = Marks::create(&path).unwrap();
        marks.set(3, ids[0]).unwrap();
        marks.set(0, ids[1]).unwrap();
        marks.set(1, ids[2]).unwrap();
        marks.clear(0).unwrap();
        assert_eq!(Marks::read(&path).unwrap(), (vec![ids[2], ids[0]], false));
        fs::remove_file(&path).unwrap();
        assert_eq!(Marks::read(&path).unwrap(), (vec![], false));
    }
}
