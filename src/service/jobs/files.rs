//! Large results, a file each. A file has its name only when all of it is on the disk: written under another, synced,
//! renamed, and the folder synced (Pillai et al. 2014, "All file systems are not created equal").

use super::JobId;
use std::collections::HashSet;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// A folder of results.
#[derive(Debug)]
pub struct Files {
    folder: PathBuf,
}

impl Files {
    /// The folder, made if it is not there.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn open(folder: PathBuf) -> io::Result<Self> {
        fs::create_dir_all(&folder)?;
        Ok(Self { folder })
    }

    /// Puts away the results of a job, for good when it returns.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn write(&self, id: JobId, json: &[u8]) -> io::Result<()> {
        let unfinished = self.folder.join(format!("{id}.part"));
        let mut file = File::create(&unfinished)?;
        file.write_all(json)?;
        file.sync_all()?;
        fs::rename(&unfinished, self.path(id))?;
        sync(&self.folder)
    }

    /// The results of a job.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn read(&self, id: JobId) -> io::Result<Vec<u8>> {
        fs::read(self.path(id))
    }

    /// Removes the results of a job, if there are any.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn remove(&self, id: JobId) -> io::Result<()> {
        match fs::remove_file(self.path(id)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        }
    }

    /// Removes whatever does not belong to one of `jobs`: what was being written when the process ended.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn sweep(&self, jobs: &HashSet<JobId>) -> io::Result<()> {
        for entry in fs::read_dir(&self.folder)? {
            let path = entry?.path();
            let name = path.file_name().and_then(|name| name.to_str()).and_then(|name| name.strip_suffix(".json"));
            if !name.and_then(|id| id.parse().ok()).is_some_and(|id| jobs.contains(&id)) {
                fs::remove_file(path)?;
            }
        }
        Ok(())
    }

    fn path(&self, id: JobId) -> PathBuf {
        self.folder.join(format!("{id}.json"))
    }
}

/// Makes the names in a folder last.
///
/// # Errors
/// Those of the disk.
pub fn sync(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}
