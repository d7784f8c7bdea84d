//! Calls into the database library, with its panics turned into errors.

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Calls the database library by `work`; a panic in it, for instance over a damaged page, is returned as an error.
/// The panic is logged by the panic hook.
pub fn guarded<T>(work: impl FnOnce() -> Result<T, redb::Error>) -> io::Result<T> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(done)) => Ok(done),
        Ok(Err(redb::Error::DatabaseAlreadyOpen)) => Err(in_use()),
        Ok(Err(redb::Error::Io(error))) if error.kind() != io::ErrorKind::UnexpectedEof => Err(error),
        // Tables and their types are fixed at creation, so that errors about them are damage as well.
        Ok(Err(
            error @ (redb::Error::Corrupted(_)
            | redb::Error::Io(_)
            | redb::Error::UnorderedKey
            | redb::Error::TransactionPoisoned
            | redb::Error::TableDoesNotExist(_)
            | redb::Error::TableIsMultimap(_)
            | redb::Error::TableTypeMismatch { .. }
            | redb::Error::TypeDefinitionChanged { .. }),
        )) => Err(io::Error::new(io::ErrorKind::InvalidData, format!("the database is damaged: {error}"))),
        Ok(Err(error)) => Err(io::Error::other(error)),
        Err(_) => Err(io::Error::new(io::ErrorKind::InvalidData, "a page of the database is damaged")),
    }
}

/// Returns the error for a job store that another process uses.
pub fn in_use() -> io::Error {
    io::Error::new(io::ErrorKind::ResourceBusy, "the store is in use by another process")
}
