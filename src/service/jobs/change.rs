//! Changes to the database of jobs, and the transaction that makes a group of changes.

use super::seal::seal;
use super::tables::{FORGOTTEN, JOBS, RESULTS, SPECIFICATIONS, STARTS};
use super::{JobId, Record, Results};
use redb::{Database, ReadableTable, WriteTransaction};
use std::sync::Arc;

/// A change to the database of jobs, made as a whole or not at all.
#[derive(Debug, Default)]
pub struct Change {
    /// The id and the encoded row of a job, to be inserted or replaced.
    pub record: Option<(JobId, Vec<u8>)>,
    /// The specification posted for the job of `record`.
    pub document: Option<Arc<[u8]>>,
    /// The results of the job of `record`, if they are short.
    pub results: Option<Arc<Results>>,
    /// The jobs whose rows are to be removed. Their ids are kept until their files are removed.
    pub forgotten: Vec<JobId>,
    /// The deleted jobs whose files have been removed, so that their ids can be removed from the database too.
    pub discarded: Vec<JobId>,
}

impl Change {
    /// Creates a change that writes the row of a job.
    pub fn record(id: JobId, record: &Record) -> Self {
        // A record consists of strings and finite numbers, so that encoding it as JSON cannot fail.
        Self { record: Some((id, serde_json::to_vec(record).unwrap_or_default())), ..Self::default() }
    }

    /// Whether the change takes hardly any disk space, or frees some.
    pub fn is_small(&self) -> bool {
        self.document.is_none() && self.results.is_none()
    }

    /// Returns the size of the specification and the results that the change adds, in bytes.
    pub fn bytes(&self) -> usize {
        let document = self.document.as_ref().map_or(0, |document| document.len());
        document + self.results.as_ref().map_or(0, |results| results.bytes())
    }

    /// Creates a change that removes every row of the jobs `forgotten`.
    pub fn forgotten(forgotten: Vec<JobId>) -> Self {
        Self { forgotten, ..Self::default() }
    }
}

/// Makes `changes`, in their order, in one durable transaction, all of them or none; `start` is stored as the number
/// of starts of the service, if it is given.
pub fn write<'a>(
    redb: &Database,
    changes: impl IntoIterator<Item = &'a Change>,
    start: Option<u64>,
) -> Result<(), redb::Error> {
    let mut transaction = redb.begin_write()?;
    // With quick repair, the database opens at once after a kill at any moment.
    transaction.set_quick_repair(true);
    make(&transaction, changes, start)?;
    transaction.commit()?;
    Ok(())
}

fn make<'a>(
    transaction: &WriteTransaction,
    changes: impl IntoIterator<Item = &'a Change>,
    start: Option<u64>,
) -> Result<(), redb::Error> {
    let mut jobs = transaction.open_table(JOBS)?;
    let mut specifications = transaction.open_table(SPECIFICATIONS)?;
    let mut results = transaction.open_table(RESULTS)?;
    let mut starts = transaction.open_table(STARTS)?;
    let mut forgotten = transaction.open_table(FORGOTTEN)?;
    for change in changes {
        if let Some((id, record)) = &change.record {
            if let Some(document) = &change.document {
                specifications.insert(id.number(), &**document)?;
            } else if jobs.get(id.number())?.is_none() {
                // The row to update is missing: the insertion of the job failed, and the change is skipped.
                continue;
            }
            jobs.insert(id.number(), seal(*id, record).as_slice())?;
            if let Some(json) = change.results.as_ref().and_then(|results| results.text()) {
                results.insert(id.number(), json)?;
            }
        }
        for id in &change.forgotten {
            jobs.remove(id.number())?;
            specifications.remove(id.number())?;
            if results.remove(id.number())?.is_none() {
                forgotten.insert(id.number(), ())?;
            }
        }
        for id in &change.discarded {
            forgotten.remove(id.number())?;
        }
    }
    if let Some(start) = start {
        starts.insert((), start)?;
    }
    Ok(())
}
