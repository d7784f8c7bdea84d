//! Which job each worker is at, so that the next process knows which jobs were running when this one ended.
//!
//! A worker writes the name of its job into its slot of a file before it starts. The write is not synced: what a
//! process has written outlives it, and a loss of power, in which the mark may be lost, is not the fault of a job.
//! So the mark costs a microsecond where a commit would cost a turn of the disk.
//!
//! Before the slots stands how many processes the system had ended for want of memory, up to the last one that this process
//! has met: where it was one of them itself, there is one more.

use super::JobId;
use super::files::OWN;
use super::shortage::Taken;
use std::fs::{self, DirEntry, File, OpenOptions};
use std::io;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// What the names of their files begin with; the number of the start follows.
const PREFIX: &str = "running-";

/// The name of a job and a line feed.
const SLOT: usize = 37;

/// The line before them, of what the system has ended for want of memory; of the length of two of them, since versions before
/// 0.2 take all for slots.
const HEAD: usize = 2 * SLOT;

/// The marks of one process.
#[derive(Debug)]
pub struct Marks {
    file: File,
}

impl Marks {
    /// Their file in `folder`, of that start.
    pub fn path(folder: &Path, start: u64) -> PathBuf {
        folder.join(format!("{PREFIX}{start}"))
    }

    /// The files of all starts in `folder`, with the numbers of those.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn all(folder: &Path) -> io::Result<Vec<(u64, PathBuf)>> {
        let number = |entry: &DirEntry| entry.file_name().to_str()?.strip_prefix(PREFIX)?.parse().ok();
        let entries = fs::read_dir(folder)?.collect::<io::Result<Vec<_>>>()?;
        Ok(entries.iter().filter_map(|entry| Some((number(entry)?, entry.path()))).collect())
    }

    /// No marks yet, in a new file.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn create(path: &Path) -> io::Result<Self> {
        let file = OpenOptions::new().write(true).create(true).truncate(true).mode(OWN).open(path)?;
        let marks = Self { file };
        if let Some(taken) = Taken::now() {
            marks.account(&taken)?;
        }
        Ok(marks)
    }

    /// Notes what the system has ended up to now, of which this process knows.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn account(&self, taken: &Taken) -> io::Result<()> {
        self.file.write_all_at(format!("{:<1$}\n", taken.line(), HEAD - 1).as_bytes(), 0)
    }

    /// The jobs that are marked in a file, none if there is no such file; and whether the system has run out of memory since.
    ///
    /// # Errors
    /// Those of the disk.
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

    /// Marks `id` as the job of a worker.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn set(&self, worker: usize, id: JobId) -> io::Result<()> {
        self.write(worker, &format!("{id}\n"))
    }

    /// Marks a worker as idle.
    ///
    /// # Errors
    /// Those of the disk.
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
