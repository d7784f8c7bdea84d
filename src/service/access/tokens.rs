//! The access tokens of a service, in a file that `dvi token` writes. A running service reads the file again when it
//! has changed, so that a token can be revoked without a restart.

use super::scope::Scope;
use super::token::Token;
use jiff::{SignedDuration, Timestamp};
use serde::{Deserialize, Serialize};
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, chown};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use subtle::ConstantTimeEq;

/// The stored properties of an access token.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// The number that identifies the access token, in hexadecimal digits.
    pub number: String,
    /// The name of the access token, given at its creation.
    pub name: String,
    /// The scopes of the token, which say what its bearer may do.
    pub scopes: Vec<Scope>,
    /// The time of the creation of the token.
    pub created: Timestamp,
    /// The time at which the access token expires, if it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expires: Option<Timestamp>,
    digest: String,
}

impl Row {
    /// Whether the expiry time of the access token has passed.
    pub fn has_expired(&self) -> bool {
        self.expires.is_some_and(|expires| expires <= Timestamp::now())
    }

    /// Whether the token grants `scope`, itself or by the scope of an administrator.
    pub fn allows(&self, scope: Scope) -> bool {
        self.scopes.contains(&scope) || self.scopes.contains(&Scope::Admin)
    }
}

/// The access tokens of a running service.
#[derive(Debug)]
pub struct Tokens {
    path: PathBuf,
    read: Mutex<Read>,
}

#[derive(Debug)]
struct Read {
    looked: Instant,
    version: Option<Version>,
    rows: Result<Arc<Vec<Row>>, Unreadable>,
}

/// The error that the file of tokens cannot be read, so that no token is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unreadable;

/// The inode and the modification time of the file of tokens, by which a change of the file is noticed: each change
/// replaces the whole file.
type Version = (u64, i64, i64);

/// The interval between two checks whether the file of tokens has changed, which cost a system call each: a revoked
/// token is refused after this time at the latest.
const STALE: Duration = Duration::from_millis(250);

impl Tokens {
    /// Reads the tokens stored in `folder`; there are none if the folder has no file of tokens yet.
    ///
    /// # Errors
    /// The file of tokens cannot be read.
    pub fn open(folder: &Path) -> io::Result<Self> {
        let path = path(folder);
        let version = version(&path);
        let rows = Ok(Arc::new(read(&path)?));
        Ok(Self { path, read: Mutex::new(Read { looked: Instant::now(), version, rows }) })
    }

    /// Whether the file of access tokens has none.
    pub fn is_empty(&self) -> bool {
        self.rows().is_ok_and(|rows| rows.is_empty())
    }

    /// Returns the number and the row of the token with this text; `None` if it is unknown or has expired.
    ///
    /// # Errors
    /// The file of tokens cannot be read.
    pub fn find(&self, text: &str) -> Result<Option<(u64, Row)>, Unreadable> {
        let rows = self.rows()?;
        let Ok(token) = text.parse::<Token>() else { return Ok(None) };
        let (number, digest) = (format!("{:016x}", token.number), token.digest());
        let row = rows.iter().find(|row| row.number == number && !row.has_expired());
        let known = row.filter(|row| bool::from(row.digest.as_bytes().ct_eq(digest.as_bytes())));
        Ok(known.map(|row| (token.number, row.clone())))
    }

    /// Whether the access token with this number is neither revoked nor expired.
    pub fn knows(&self, number: u64) -> bool {
        let number = format!("{number:016x}");
        self.rows().is_ok_and(|rows| rows.iter().any(|row| row.number == number && !row.has_expired()))
    }

    fn rows(&self) -> Result<Arc<Vec<Row>>, Unreadable> {
        let mut known = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        if known.looked.elapsed() > STALE {
            known.looked = Instant::now();
            let version = version(&self.path);
            // After a failed read, the file of tokens is read again even if it is unchanged, since its owner or mode
            // may have been corrected.
            if version != known.version || known.rows.is_err() {
                let rows = read(&self.path).map(Arc::new).map_err(|error| {
                    tracing::error!(%error, "the tokens cannot be read: does {} belong to this user?", self.path.display());
                    Unreadable
                });
                (known.version, known.rows) = (version, rows);
            }
        }
        known.rows.clone()
    }
}

/// Returns the time `days` days from the current time, as the expiry time of a token.
pub fn in_days(days: u32) -> Timestamp {
    Timestamp::now() + SignedDuration::from_hours(24 * i64::from(days))
}

/// Creates an access token that expires at `expires`, and stores the digest of its secret. Only the caller learns the
/// secret.
///
/// # Errors
/// I/O errors of the disk.
pub fn create(folder: &Path, name: &str, scopes: &[Scope], expires: Option<Timestamp>) -> io::Result<Token> {
    let token = Token::create()?;
    let (number, digest) = (format!("{:016x}", token.number), token.digest());
    let row =
        Row { number, name: name.to_owned(), scopes: scopes.to_vec(), created: Timestamp::now(), expires, digest };
    change(folder, |rows| rows.push(row))?;
    Ok(token)
}

/// Returns the access tokens stored in `folder`, oldest first.
///
/// # Errors
/// I/O errors of the disk.
pub fn list(folder: &Path) -> io::Result<Vec<Row>> {
    read(&path(folder))
}

/// Removes the access token with this number; returns false if there is none.
///
/// # Errors
/// I/O errors of the disk.
pub fn revoke(folder: &Path, number: &str) -> io::Result<bool> {
    change(folder, |rows| {
        let before = rows.len();
        rows.retain(|row| row.number != number);
        rows.len() < before
    })
}

fn path(folder: &Path) -> PathBuf {
    folder.join("tokens.json")
}

fn version(path: &Path) -> Option<Version> {
    fs::metadata(path).ok().map(|data| (data.ino(), data.mtime(), data.mtime_nsec()))
}

fn read(path: &Path) -> io::Result<Vec<Row>> {
    match fs::read(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
        text => Ok(serde_json::from_slice(&text?)?),
    }
}

/// Reads, changes and replaces the file of tokens, under a lock; readers see the old file or the new one.
fn change<T>(folder: &Path, change: impl FnOnce(&mut Vec<Row>) -> T) -> io::Result<T> {
    DirBuilder::new().recursive(true).mode(0o700).create(folder)?;
    let own = OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).clone();
    let lock = own.open(folder.join("tokens.lock"))?;
    lock.lock()?;
    let path = path(folder);
    let mut rows = read(&path)?;
    let changed = change(&mut rows);
    let unfinished = folder.join("tokens.part");
    let mut file = own.open(&unfinished)?;
    // If root creates the file for a service that runs as another user, the file must belong to that user.
    belong_as(&unfinished, folder)?;
    belong_as(&folder.join("tokens.lock"), folder)?;
    file.write_all(&serde_json::to_vec_pretty(&rows)?)?;
    file.sync_all()?;
    fs::rename(&unfinished, &path)?;
    File::open(folder)?.sync_all()?;
    Ok(changed)
}

/// Changes the owner of a file of tokens to the owner of `folder`, which contains it, if the two differ.
fn belong_as(path: &Path, folder: &Path) -> io::Result<()> {
    let (file, folder) = (fs::metadata(path)?, fs::metadata(folder)?);
    if file.uid() != folder.uid() {
        chown(path, Some(folder.uid()), Some(folder.gid()))?;
    }
    Ok(())
}
