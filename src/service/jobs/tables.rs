//! The tables of the job database, and the version of their format.
//!
//! | format | since | contents |
//! |---|---|---|
//! | 1 | 0.1 | rows as JSON; no table `format` |
//! | 2 | | rows behind a digest, with the digests of specifications and results in them; long results as JSON |
//! | 3 | | long results as columns, in chunks |
//! | 4 | | long results as columns, in blocks; those in chunks stay as they are |
//!
//! A database of an earlier format is converted in one transaction when it is opened. A database of a later format is
//! refused. Versions that do not know the table `format` refuse a later database as well, since the type of its rows
//! has another name.

use super::JobId;
use super::seal::{seal, unseal};
use crate::digest::{Digest, Fingerprint};
use redb::{Database, ReadableDatabase, ReadableTable, TableDefinition, TableHandle, TypeName, Value};
use serde_json::json;

/// The current version of the format of the database of jobs.
pub const FORMAT: u64 = 4;

/// The table of the rows of jobs, each stored behind a digest.
pub const JOBS: TableDefinition<'_, u128, Sealed> = TableDefinition::new("jobs");
/// The table of the posted specifications.
pub const SPECIFICATIONS: TableDefinition<'_, u128, &[u8]> = TableDefinition::new("specifications");
/// The table of the short results of jobs.
pub const RESULTS: TableDefinition<'_, u128, &[u8]> = TableDefinition::new("results");
/// The table with the number of the latest start of the service.
pub const STARTS: TableDefinition<'_, (), u64> = TableDefinition::new("starts");
/// The table of the jobs whose rows were lost in a rebuild of the database; absent if it was never rebuilt.
pub const LOST: TableDefinition<'_, u128, ()> = TableDefinition::new("lost");
/// The table of deleted jobs that may still have a file of results; absent if no job was deleted.
pub const FORGOTTEN: TableDefinition<'_, u128, ()> = TableDefinition::new("forgotten");

const FORMATS: TableDefinition<'_, (), u64> = TableDefinition::new("format");
const JOBS_OF_FORMAT_1: TableDefinition<'_, u128, &[u8]> = TableDefinition::new("jobs");
const JOBS_ON_THE_WAY: TableDefinition<'_, u128, &[u8]> = TableDefinition::new("jobs of format 1");

/// The type of a row of a job behind its digest.
#[derive(Debug)]
pub struct Sealed;

impl Value for Sealed {
    type SelfType<'a> = &'a [u8];
    type AsBytes<'a> = &'a [u8];

    fn fixed_width() -> Option<usize> {
        None
    }

    fn from_bytes<'a>(data: &'a [u8]) -> &'a [u8]
    where
        Self: 'a,
    {
        data
    }

    fn as_bytes<'a, 'b: 'a>(value: &'a &'b [u8]) -> &'a [u8]
    where
        Self: 'b,
    {
        value
    }

    fn type_name() -> TypeName {
        TypeName::new("dvi::Sealed")
    }
}

/// Returns the format version of the database of jobs; `None` if the database is empty.
pub fn format(redb: &Database) -> Result<Option<u64>, redb::Error> {
    let transaction = redb.begin_read()?;
    let names: Vec<String> = transaction.list_tables()?.map(|table| table.name().to_owned()).collect();
    let has = |table: &str| names.iter().any(|name| name == table);
    if has(FORMATS.name()) {
        return Ok(transaction.open_table(FORMATS)?.get(())?.map(|format| format.value()));
    }
    Ok(has(JOBS.name()).then_some(1))
}

/// Whether the database has rows of jobs in format 1, which have no digests.
pub fn has_first_rows(redb: &Database) -> Result<bool, redb::Error> {
    Ok(redb.begin_read()?.open_table(JOBS_OF_FORMAT_1).is_ok())
}

/// The fingerprints (length and digest) of a file of results as JSON.
#[derive(Clone, Copy, Debug)]
pub struct InFile {
    /// The fingerprint (length and digest) of the results as JSON.
    pub json: Fingerprint,
    /// The fingerprint of the index of the columnar file beside the JSON file, if there is one.
    pub index: Option<Fingerprint>,
}

/// Creates the tables of the database, converting those of an earlier format if there are any, in one transaction.
/// `file` examines the results file of a job, and may write columns beside it.
pub fn make(redb: &Database, format: Option<u64>, file: &dyn Fn(JobId) -> Option<InFile>) -> Result<(), redb::Error> {
    let mut transaction = redb.begin_write()?;
    transaction.set_quick_repair(true);
    if format == Some(1) {
        transaction.rename_table(JOBS_OF_FORMAT_1, JOBS_ON_THE_WAY)?;
        {
            let earlier = transaction.open_table(JOBS_ON_THE_WAY)?;
            let (specifications, results) = (transaction.open_table(SPECIFICATIONS)?, transaction.open_table(RESULTS)?);
            let mut jobs = transaction.open_table(JOBS)?;
            for row in earlier.iter()? {
                let (number, row) = row?;
                let (number, id) = (number.value(), JobId::of_number(number.value()));
                let document = specifications.get(number)?.map(|document| Digest::of(document.value()));
                let in_table = results.get(number)?.map(|json| Fingerprint::of(json.value()));
                let row = with_digests(row.value(), document, |place| match place {
                    "table" => in_table,
                    _ => file(id).map(|found| found.json),
                });
                jobs.insert(number, seal(id, &row).as_slice())?;
            }
        }
        transaction.delete_table(JOBS_ON_THE_WAY)?;
    }
    if matches!(format, Some(1 | 2)) {
        let mut jobs = transaction.open_table(JOBS)?;
        let mut changed = Vec::new();
        for row in jobs.iter()? {
            let (number, sealed) = row?;
            let id = JobId::of_number(number.value());
            // The row of a job stays unchanged if it is damaged.
            if let Some(row) = unseal(id, sealed.value()).and_then(|row| with_columns(row, || file(id))) {
                changed.push((number.value(), seal(id, &row)));
            }
        }
        for (number, sealed) in changed {
            jobs.insert(number, sealed.as_slice())?;
        }
    }
    for table in [SPECIFICATIONS, RESULTS] {
        transaction.open_table(table)?;
    }
    transaction.open_table(JOBS)?;
    transaction.open_table(STARTS)?;
    transaction.open_table(FORMATS)?.insert((), FORMAT)?;
    transaction.commit()?;
    Ok(())
}

/// Converts the row of a job from format 1 to format 2; a row that cannot be read stays unchanged. Results that are
/// missing, or of another length, get the digest of the empty string, by which they will be found damaged.
fn with_digests(row: &[u8], document: Option<Digest>, find: impl Fn(&str) -> Option<Fingerprint>) -> Vec<u8> {
    let Ok(mut value) = serde_json::from_slice::<serde_json::Value>(row) else { return row.to_vec() };
    if !value.is_object() {
        return row.to_vec();
    }
    if let Some(document) = document {
        value["document"] = json!(document);
    }
    for place in ["table", "file"] {
        let pointer = format!("/ended/held/{place}");
        if let Some(held) = value.pointer_mut(&pointer)
            && let Some(bytes) = held.as_u64()
        {
            let found = find(place).filter(|found| found.bytes as u64 == bytes);
            let digest = found.map_or_else(|| Digest::of(&[]), |found| found.digest);
            *held = json!({"bytes": bytes, "digest": digest});
        }
    }
    // A value parsed from JSON can always be encoded.
    serde_json::to_vec(&value).unwrap_or_else(|_| row.to_vec())
}

/// Converts the row of a job from format 2 to format 3, with its results as columns, if its results were an intact
/// JSON file; `None` if the row does not change.
fn with_columns(row: &[u8], file: impl Fn() -> Option<InFile>) -> Option<Vec<u8>> {
    let mut value = serde_json::from_slice::<serde_json::Value>(row).ok()?;
    let held = value.pointer_mut("/ended/held")?;
    let InFile { json, index } = file().filter(|found| held["file"] == json!(found.json))?;
    *held = json!({"columns": {"json": json, "index": index?}});
    serde_json::to_vec(&value).ok()
}

/// Marks a database of jobs as one of another format version.
#[cfg(test)]
pub fn set_format(path: &std::path::Path, format: u64) -> Result<(), redb::Error> {
    let transaction = Database::open(path)?.begin_write()?;
    transaction.open_table(FORMATS)?.insert((), format)?;
    transaction.commit()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::Held;
    use crate::jobs::database::Database as Jobs;
    use std::path::PathBuf;
    use std::sync::Arc;
    use std::{fs, io};

    /// A temporary database file, removed when it is dropped.
    struct File(PathBuf);

    impl File {
        fn new(name: &str) -> Self {
            Self(std::env::temp_dir().join(format!("dvi-tables-{name}-{}.redb", std::process::id())))
        }

        fn write(&self, write: impl FnOnce(&redb::WriteTransaction) -> Result<(), redb::Error>) {
            let redb = Database::create(&self.0).unwrap();
            let transaction = redb.begin_write().unwrap();
            write(&transaction).unwrap();
            transaction.commit().unwrap();
        }
    }

    impl Drop for File {
        fn drop(&mut self) {
            let _ = fs::remove_file(&self.0);
        }
    }

    /// The row of a job in format 1 of the database.
    const ROW: &str = r#"{"client":{"address":"127.0.0.1"},"label":null,"horizon":{"start":0.0,"end":1.0},
        "estimate":{"problem":"dvi","memory":1000},"created":"2026-01-01T00:00:00Z","document_bytes":8,"key":null,
        "crashes":0,"underway":false,"dismissed":false,"ended":{"started":"2026-01-01T00:00:00Z",
        "finished":"2026-01-01T00:00:01Z","fraction":1.0,"steps":8,"ending":"successful","verdict":null,
        "held":{"HELD":7}}}"#;

    #[test]
    fn a_store_of_the_first_format_is_brought_up_to_date() {
        let file = File::new("first");
        file.write(|transaction| {
            let mut jobs = transaction.open_table(JOBS_OF_FORMAT_1)?;
            let mut specifications = transaction.open_table(SPECIFICATIONS)?;
            for (id, held) in [(1, "table"), (2, "file"), (3, "file")] {
                jobs.insert(id, ROW.replace("HELD", held).as_bytes())?;
                specifications.insert(id, &b"document"[..])?;
            }
            jobs.insert(4, &b"of another version"[..])?;
            transaction.open_table(RESULTS)?.insert(1, &b"results"[..])?;
            Ok(())
        });
        // The results file of the third job is missing.
        let json = Fingerprint::of(b"results");
        let in_file = |id: JobId| (id.number() == 2).then_some(InFile { json, index: Some(Fingerprint::of(b"index")) });
        for _ in 0..2 {
            let jobs = Jobs::open(Jobs::at(&file.0, Arc::default()), &in_file).unwrap().0;
            let rows = jobs.records();
            assert_eq!(rows.unreadable, [JobId::of_number(4)]);
            let told: Vec<_> = rows
                .records
                .iter()
                .map(|(_, record)| {
                    let held = record.ended.as_ref().and_then(|ended| ended.held.as_ref()).unwrap();
                    let place = match held {
                        Held::Memory(_) => "memory",
                        Held::Table(_) => "table",
                        Held::File(_) => "file",
                        Held::Columns { .. } => "columns",
                    };
                    (record.document == Some(Digest::of(b"document")), place, held.digest() == json.digest)
                })
                .collect();
            assert_eq!(told, [(true, "table", true), (true, "columns", true), (true, "file", false)]);
        }
    }

    #[test]
    fn a_store_of_a_later_format_is_refused_and_left_as_it_is() {
        let file = File::new("later");
        drop(Jobs::open(Jobs::at(&file.0, Arc::default()), &|_| None).unwrap());
        file.write(|transaction| {
            transaction.open_table(FORMATS)?.insert((), FORMAT + 1)?;
            Ok(())
        });
        let error = Jobs::open(Jobs::at(&file.0, Arc::default()), &|_| None).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::Unsupported);
        assert!(error.to_string().contains("a later version of dvi"), "{error}");
        let redb = Database::open(&file.0).unwrap();
        assert_eq!(format(&redb).unwrap(), Some(FORMAT + 1));
    }

    #[test]
    fn a_store_is_refused_by_versions_before_formats_were_told() {
        let file = File::new("earlier");
        drop(Jobs::open(Jobs::at(&file.0, Arc::default()), &|_| None).unwrap());
        let redb = Database::open(&file.0).unwrap();
        let transaction = redb.begin_write().unwrap();
        assert!(matches!(transaction.open_table(JOBS_OF_FORMAT_1), Err(redb::TableError::TableTypeMismatch { .. })));
    }
}
