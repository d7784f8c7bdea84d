//! Long results in transit from a worker, and the place where they are stored. A durable service writes them to a
//! file as they arrive, so that they take little memory however long they wait; without a data folder, or on a full
//! disk, they are kept in memory.

use super::files::OWN;
use rustix::fs::{Advice, fadvise};
use solution::columnar::Source;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::num::NonZeroU64;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The number of bytes of a job's results that are kept in memory before a scratch file is begun.
const IN_MEMORY: usize = 1 << 20;

/// The place where the long results of a job are stored.
#[derive(Clone, Debug)]
pub enum Backing {
    /// The results of the job are in memory.
    Memory(Arc<Vec<u8>>),
    /// The results are in a file that is removed when the last reference to it is dropped.
    Scratch(Arc<Scratch>),
    /// The results of the job are in a permanent file.
    File(PathBuf),
}

impl Backing {
    /// Stores `bytes`, the results of a job, in memory.
    pub fn memory(bytes: Vec<u8>) -> Self {
        Self::Memory(Arc::new(bytes))
    }

    /// Returns the number of bytes of the results that are in memory.
    pub fn resident(&self) -> usize {
        match self {
            Self::Memory(bytes) => bytes.len(),
            Self::Scratch(_) | Self::File(_) => 0,
        }
    }

    /// Opens the results for reading at any offset; also returns their length in bytes.
    ///
    /// # Errors
    /// I/O errors of the disk; [`io::ErrorKind::InvalidData`] if the file is missing.
    pub fn open(&self) -> io::Result<(Arc<dyn Source>, u64)> {
        let path = match self {
            Self::Memory(bytes) => return Ok((Arc::<Vec<u8>>::clone(bytes), bytes.len() as u64)),
            Self::Scratch(scratch) => &scratch.0,
            Self::File(path) => path,
        };
        let file = File::open(path).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => io::Error::new(io::ErrorKind::InvalidData, "the file of results is gone"),
            _ => error,
        })?;
        let length = file.metadata()?.len();
        Ok((Arc::new(OnDisk(file)), length))
    }
}

impl Backing {
    /// Appends `bytes` to the results; moves them to memory, if the disk does not accept the bytes.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn append(self, bytes: &[u8]) -> io::Result<Self> {
        match &self {
            Self::Memory(memory) => Ok(Self::memory([memory.as_slice(), bytes].concat())),
            Self::Scratch(scratch) => {
                let written =
                    OpenOptions::new().append(true).open(scratch.path()).and_then(|mut file| file.write_all(bytes));
                match written {
                    Ok(()) => Ok(self),
                    Err(error) => {
                        tracing::warn!(%error, "long results are kept in memory");
                        let (source, length) = self.open()?;
                        let mut memory = vec![0; usize::try_from(length).map_err(io::Error::other)?];
                        source.read_at(0, &mut memory)?;
                        memory.extend_from_slice(bytes);
                        Ok(Self::memory(memory))
                    }
                }
            }
            Self::File(_) => Err(io::ErrorKind::ReadOnlyFilesystem.into()),
        }
    }
}

/// An open file of results, which stays readable even after it has been removed.
struct OnDisk(File);

impl Source for OnDisk {
    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<()> {
        self.0.read_exact_at(bytes, offset)
    }

    fn fetch(&self, offset: u64, length: u64) {
        // A range of length zero is not prefetched: the system would take it to mean everything up to the end of the
        // file.
        let Some(length) = NonZeroU64::new(length) else { return };
        // The advice to prefetch is only a hint: if it fails, the reads are slower.
        let _ = fadvise(&self.0, offset, Some(length), Advice::WillNeed);
    }
}

/// A scratch file with results of a job, removed when this value is dropped; the next start of the service removes
/// files that a crash has left.
#[derive(Debug)]
pub struct Scratch(PathBuf);

impl Scratch {
    /// The path of the scratch file with results of a job.
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // Removal of the scratch file fails if its folder has been removed, which is harmless.
        let _ = fs::remove_file(&self.0);
    }
}

/// A writer of the results of a job that keeps a few bytes in memory and more of them in a scratch file.
#[derive(Debug)]
pub struct Spool {
    /// The path for a scratch file that has not been begun; `None` without a data folder.
    path: Option<PathBuf>,
    memory: Vec<u8>,
    file: Option<(File, Scratch)>,
}

impl Spool {
    /// Creates an empty spool for results, which begins a file at `path` once it has more than `IN_MEMORY` bytes.
    pub fn new(path: Option<PathBuf>) -> Self {
        Self { path, memory: Vec::new(), file: None }
    }

    /// Ends the writing of the results, and returns the place where they are stored.
    pub fn end(mut self) -> Backing {
        match self.file.take() {
            Some((_, scratch)) => Backing::Scratch(Arc::new(scratch)),
            None => {
                self.memory.shrink_to_fit();
                Backing::memory(self.memory)
            }
        }
    }

    /// Moves the bytes of the results from memory to a new scratch file, if there is a path for one.
    fn begin_file(&mut self) {
        let Some(path) = self.path.take() else { return };
        let opened = OpenOptions::new().read(true).write(true).create(true).truncate(true).mode(OWN).open(&path);
        let file = opened.map(|file| (file, Scratch(path)));
        match file.and_then(|(mut file, scratch)| file.write_all(&self.memory).map(|()| (file, scratch))) {
            Ok(file) => {
                self.memory = Vec::new();
                self.file = Some(file);
            }
            Err(error) => tracing::warn!(%error, "long results are kept in memory"),
        }
    }

    /// Reads the first `length` bytes of the results from their file back into memory.
    fn take_back(&mut self, file: &File, length: u64) -> io::Result<()> {
        self.memory.resize(usize::try_from(length).map_err(io::Error::other)?, 0);
        file.read_exact_at(&mut self.memory, 0)
    }
}

impl Write for Spool {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.file.is_none() && self.memory.len() + bytes.len() > IN_MEMORY {
            self.begin_file();
        }
        let Some((mut file, scratch)) = self.file.take() else {
            self.memory.extend_from_slice(bytes);
            return Ok(bytes.len());
        };
        let before = file.metadata()?.len();
        if let Err(error) = file.write_all(bytes) {
            tracing::warn!(%error, "long results are kept in memory");
            self.take_back(&file, before)?;
            self.memory.extend_from_slice(bytes);
        } else {
            self.file = Some((file, scratch));
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(backing: &Backing) -> Vec<u8> {
        let (source, length) = backing.open().unwrap();
        let mut bytes = vec![0; usize::try_from(length).unwrap()];
        source.read_at(0, &mut bytes).unwrap();
        bytes
    }

    #[test]
    fn what_was_written_is_there_as_long_as_it_is_needed() {
        let path = std::env::temp_dir().join(format!("dvi-spool-{}", std::process::id()));
        for (path, pieces, on_disk) in
            [(None, 40, false), (Some(path.clone()), 2, false), (Some(path.clone()), 40, true)]
        {
            let mut spool = Spool::new(path.clone());
            let mut written = Vec::new();
            for k in 0..pieces {
                let piece = vec![k; 100_000];
                spool.write_all(&piece).unwrap();
                written.extend(piece);
            }
            let backing = spool.end();
            assert_eq!((bytes(&backing) == written, matches!(backing, Backing::Scratch(_))), (true, on_disk));
            drop(backing);
            assert!(path.is_none_or(|path| !path.exists()));
        }
    }

    #[test]
    fn where_no_file_can_be_made_memory_keeps_it() {
        let mut spool = Spool::new(Some("/no/such/folder/file".into()));
        spool.write_all(&vec![7; 3 << 20]).unwrap();
        assert_eq!(bytes(&spool.end()), vec![7; 3 << 20]);
    }
}
