//! Large results, a file each. A file has its name only when all of it is on the disk: written under another, synced,
//! renamed, and the folder synced (Pillai et al. 2014, "All file systems are not created equal").

use super::JobId;
use super::digest::Digest;
use std::collections::HashSet;
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
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
        create(&folder)?;
        Ok(Self { folder })
    }

    /// A folder that is there.
    pub fn at(folder: PathBuf) -> Self {
        Self { folder }
    }

    /// The jobs that have a file of results.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn names(&self) -> io::Result<impl Iterator<Item = JobId>> {
        let entries = fs::read_dir(&self.folder)?.flatten();
        Ok(entries.filter_map(|entry| entry.file_name().to_str()?.strip_suffix(".json")?.parse().ok()))
    }

    /// Puts away the results of a job, for good when it returns.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn write(&self, id: JobId, json: &[u8]) -> io::Result<()> {
        let unfinished = self.folder.join(format!("{id}.part"));
        let written = self.write_as(&unfinished, json).and_then(|()| fs::rename(&unfinished, self.path(id)));
        if written.is_err() {
            // On a full disk, what has been written of it takes the room.
            let _ = fs::remove_file(&unfinished);
        }
        written?;
        sync(&self.folder)
    }

    fn write_as(&self, path: &Path, json: &[u8]) -> io::Result<()> {
        let mut file = OpenOptions::new().write(true).create(true).truncate(true).mode(OWN).open(path)?;
        file.write_all(json)?;
        file.sync_all()
    }

    /// Removes a result whose job is forgotten.
    pub fn discard(&self, id: JobId) {
        if let Err(error) = self.remove(id) {
            tracing::warn!(job.id = %id, %error, "a file of results is left behind until the next start");
        }
    }

    /// The results of a job, if there are any.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn find(&self, id: JobId) -> io::Result<Option<Vec<u8>>> {
        match fs::read(self.path(id)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            json => json.map(Some),
        }
    }

    /// The length and the digest of the results of a job, if they can be read.
    pub fn digest(&self, id: JobId) -> Option<(usize, Digest)> {
        let json = self.find(id).ok()??;
        Some((json.len(), Digest::of(&json)))
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

    /// Removes what was being written when the process ended, and sets aside into `orphans` whatever else does not belong
    /// to one of `jobs`; says how much that was. Nothing that was ever whole is removed.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn sweep(&self, jobs: &HashSet<JobId>, orphans: &Path) -> io::Result<usize> {
        let mut set_aside = 0;
        for entry in fs::read_dir(&self.folder)? {
            let entry = entry?;
            let (path, name) = (entry.path(), entry.file_name());
            let of = |suffix| name.to_str().and_then(|name| name.strip_suffix(suffix)?.parse::<JobId>().ok());
            if of(".part").is_some() {
                fs::remove_file(path)?;
            } else if !of(".json").is_some_and(|id| jobs.contains(&id)) {
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

    fn path(&self, id: JobId) -> PathBuf {
        self.folder.join(format!("{id}.json"))
    }
}

/// Files are their owner's alone, and so are folders: specifications and results are nobody else's business.
pub const OWN: u32 = 0o600;
const OWN_FOLDER: u32 = 0o700;

/// Makes a folder, if it is not there.
///
/// # Errors
/// Those of the disk.
pub fn create(folder: &Path) -> io::Result<()> {
    DirBuilder::new().recursive(true).mode(OWN_FOLDER).create(folder)
}

/// Makes the names in a folder last.
///
/// # Errors
/// Those of the disk.
pub fn sync(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}
