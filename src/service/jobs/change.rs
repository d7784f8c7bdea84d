//! Changes to the tables of jobs, and the transaction that makes a group of them.

use super::seal::seal;
use super::tables::{FORGOTTEN, JOBS, RESULTS, SPECIFICATIONS, STARTS};
use super::{JobId, Record, Results};
use redb::{Database, ReadableTable, WriteTransaction};
use std::sync::Arc;

/// A change to the rows of jobs, made as a whole or not at all.
#[derive(Debug, Default)]
pub struct Change {
    /// A job's row, to be inserted or replaced.
    pub record: Option<(JobId, Vec<u8>)>,
    /// The specification posted for that job.
    pub document: Option<Arc<[u8]>>,
    /// The results of that job.
    pub results: Option<Arc<Results>>,
    /// Jobs whose rows are to be removed. Their ids are kept until their files are removed.
    pub forgotten: Vec<JobId>,
    /// Deleted jobs whose files have been removed, so that their ids are removed too.
    pub discarded: Vec<JobId>,
}

impl Change {
    /// A change that writes a row.
    pub fn record(id: JobId, record: &Record) -> Self {
        // Strings and finite numbers always have a JSON form.
        Self { record: Some((id, serde_json::to_vec(record).unwrap_or_default())), ..Self::default() }
    }

    /// Whether the change takes hardly any room, or frees some.
    pub fn is_small(&self) -> bool {
        self.document.is_none() && self.results.is_none()
    }

    /// The size of the added data, in bytes.
    pub fn bytes(&self) -> usize {
        let document = self.document.as_ref().map_or(0, |document| document.len());
        document + self.results.as_ref().map_or(0, |results| results.bytes())
    }

    /// A change that removes every row of these jobs.
    pub fn forgotten(forgotten: Vec<JobId>) -> Self {
        Self { forgotten, ..Self::default() }
    }
}

/// Makes `changes`, in their order, and counts a start of the service if one is given, in one durable transaction: all
/// of them or none.
pub fn write<'a>(
    redb: &Database,
    changes: impl IntoIterator<Item = &'a Change>,
    start: Option<u64>,
) -> Result<(), redb::Error> {
    let mut transaction = redb.begin_write()?;
    // So that the file opens at once after a kill at any moment.
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
                // An update of a job whose insertion failed.
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
