//! Recovery of a damaged database: all that can be read is copied to a new one, which is every intact row, and the
//! specifications and results that match the digests in their rows. A lost row that the process still has in memory
//! is written from memory. The ids of other lost rows are kept, so that their jobs are reported as damaged and not as
//! unknown.

use super::database::{CACHE_BYTES, Database};
use super::ended::Held;
use super::guarded::guarded;
use super::leaves::Leaves;
use super::seal::{seal, unseal};
use super::tables::{self, FORMAT, JOBS, LOST, RESULTS, SPECIFICATIONS, STARTS};
use super::watched::{Sums, Watched};
use super::{Inspection, JobId, Record};
use crate::digest::Digest;
use redb::{Builder, Database as Redb, TableDefinition, TableHandle, Value};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::File;
use std::io;
use std::mem::take;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// The size of the rows that a rebuild of the database writes in one transaction, in bytes; they are in memory until
/// then.
const AT_ONCE: usize = 8 << 20;

/// The outcome of a rebuild of the damaged database of jobs.
#[derive(Debug, Default)]
pub struct Salvaged {
    /// The number of jobs that have a row in the rebuilt database.
    pub jobs: usize,
    /// The number of jobs whose rows in the rebuilt database come from memory.
    pub remembered: usize,
    /// The parts of each job that could not be read from the damaged database.
    pub lost: BTreeMap<JobId, Vec<&'static str>>,
    /// The path under which the damaged database file is kept.
    pub aside: PathBuf,
}

/// Rebuilds the database of the store in `folder`, as a running service does when it reads a damaged page; returns
/// `None` if the store is intact.
///
/// # Errors
/// The store is absent, in use or of another version, or the disk reports an I/O error; the store is unchanged.
pub fn repair(folder: &Path) -> io::Result<Option<Salvaged>> {
    let path = folder.join("jobs.redb");
    let known = Inspection::of(folder)?;
    if known.is_whole() {
        return Ok(None);
    }
    if known.format < FORMAT {
        let told = format!("it has format {}: start the service once, which brings it up to date", known.format);
        return Err(io::Error::new(io::ErrorKind::Unsupported, told));
    }
    let (database, _) = Database::in_file(&path, &|_| None)?;
    database.rebuild(&io::Error::new(io::ErrorKind::InvalidData, "it is to be repaired")).map(Some)
}

/// The source of the rows from which the database of jobs is rebuilt.
pub enum Source<'a> {
    /// The tables of a damaged database that can be opened.
    Tables(&'a Database),
    /// The pages of a database that cannot be opened, and the latest row of each job on them.
    Leaves(Leaves, BTreeMap<JobId, Vec<u8>>),
}

impl Source<'_> {
    /// Reads the pages of the database file at `path`.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn leaves(path: &Path) -> io::Result<Self> {
        let leaves = Leaves::of(path)?;
        let rows = leaves.rows()?;
        Ok(Self::Leaves(leaves, rows))
    }

    fn names(&self) -> BTreeSet<JobId> {
        match self {
            Self::Tables(database) => database.names(),
            Self::Leaves(leaves, _) => leaves.names().unwrap_or_default(),
        }
    }

    fn lost(&self) -> Vec<JobId> {
        match self {
            Self::Tables(database) => database.lost().unwrap_or_default(),
            Self::Leaves(..) => Vec::new(),
        }
    }

    /// Whether every value in this source belongs to the current state of its job; pages of a database that cannot be
    /// opened may contain values of earlier states.
    fn is_present(&self) -> bool {
        matches!(self, Self::Tables(_))
    }

    /// Visits the rows of a table of the damaged database, as far as they can be read.
    fn scan<V>(&self, table: TableDefinition<'static, u128, V>, visit: &dyn Fn(JobId, &[u8]) -> ControlFlow<()>)
    where
        V: for<'a> Value<SelfType<'a> = &'a [u8]> + 'static,
    {
        match self {
            Self::Tables(database) => drop(database.scan(table, visit)),
            Self::Leaves(_, rows) if table.name() == JOBS.name() => {
                let _ = rows.iter().try_for_each(|(id, row)| visit(*id, row));
            }
            Self::Leaves(leaves, _) => {
                let mut is_over = false;
                drop(leaves.scan(&mut |id, bytes| is_over = is_over || visit(id, bytes).is_break()));
            }
        }
    }

    fn find<V>(&self, table: TableDefinition<'static, u128, V>, id: JobId) -> Option<Vec<u8>>
    where
        V: for<'a> Value<SelfType<'a> = &'a [u8]> + 'static,
    {
        match self {
            Self::Tables(database) => database.find(table, id).ok().flatten(),
            Self::Leaves(..) => None,
        }
    }
}

/// The digests of the specification and the results of a job, according to its row.
struct Parts {
    /// The digest of the specification, if the row has one.
    document: Option<Digest>,
    /// The digest of the results, if they are in the database.
    results: Option<Digest>,
    /// Whether the row is in the format of another version, so that the digests are unknown.
    is_foreign: bool,
}

/// Copies what can be read of a database to a new one in `file`, with block checksums `sums` and the number `start`
/// of the latest start of the service. Lost rows are restored from `remembered`.
///
/// # Errors
/// I/O errors of the disk on which `file` is.
pub fn salvage(
    from: &Source<'_>,
    file: File,
    sums: Sums,
    start: u64,
    remembered: Vec<(JobId, Record)>,
) -> io::Result<(Redb, Salvaged)> {
    let watched = Watched::over(file, sums)?;
    let into = guarded(|| Ok(Builder::new().set_cache_size(CACHE_BYTES).create_with_backend(watched)?))?;
    guarded(|| tables::make(&into, None, &|_| None))?;
    let (mut salvaged, parts) = (Salvaged::default(), RefCell::new(HashMap::new()));
    let learn = |id, sealed: &[u8]| {
        let row = unseal(id, sealed);
        row.is_some_and(|row| parts.borrow_mut().insert(id, Parts::of(row)).is_none())
    };
    let mut names = from.names();
    names.extend(remembered.iter().map(|(id, _)| *id));
    let mut lost = copy(from, &into, JOBS, names, &learn)?;
    let mut rows = Rows::new(&into, JOBS);
    for (id, record) in remembered {
        // A record consists of strings and finite numbers, so that encoding it as JSON cannot fail.
        let row = seal(id, &serde_json::to_vec(&record).unwrap_or_default());
        if lost.remove(&id) && learn(id, &row) {
            rows.put(id, &row)?;
            salvaged.remembered += 1;
        }
    }
    rows.flush()?;
    lost.extend(from.lost());
    let parts = parts.into_inner();
    let of = |id: JobId, bytes: &[u8], part: fn(&Parts) -> Option<Digest>| {
        parts.get(&id).is_some_and(|parts| {
            (parts.is_foreign && from.is_present()) || part(parts).is_some_and(|digest| digest.vouch(bytes).is_ok())
        })
    };
    let wanted = |part: fn(&Parts) -> Option<Digest>| {
        parts.iter().filter(|(_, parts)| part(parts).is_some()).map(|(id, _)| *id).collect()
    };
    type Part = (&'static str, TableDefinition<'static, u128, &'static [u8]>, fn(&Parts) -> Option<Digest>);
    let tables: [Part; 2] =
        [("specification", SPECIFICATIONS, |parts| parts.document), ("results", RESULTS, |parts| parts.results)];
    for id in &lost {
        salvaged.lost.entry(*id).or_default().push("row");
    }
    for (name, table, part) in tables {
        let seen = RefCell::new(BTreeSet::new());
        let is_wanted = |id, bytes: &[u8]| of(id, bytes, part) && seen.borrow_mut().insert(id);
        for id in copy(from, &into, table, wanted(part), &is_wanted)? {
            salvaged.lost.entry(id).or_default().push(name);
        }
    }
    guarded(|| {
        let transaction = into.begin_write()?;
        transaction.open_table(STARTS)?.insert((), start)?;
        {
            let mut table = transaction.open_table(LOST)?;
            lost.iter().try_for_each(|id| table.insert(id.number(), ()).map(drop))?;
        }
        transaction.commit()?;
        Ok(())
    })?;
    salvaged.jobs = parts.len();
    Ok((into, salvaged))
}

impl Parts {
    fn of(row: &[u8]) -> Self {
        match serde_json::from_slice::<Record>(row) {
            Err(_) => Self { document: None, results: None, is_foreign: true },
            Ok(record) => Self {
                document: record.document,
                results: record.ended.and_then(|ended| match ended.held {
                    Some(Held::Table(json)) => Some(json.digest),
                    Some(Held::Memory(_) | Held::File(_) | Held::Columns { .. }) | None => None,
                }),
                is_foreign: false,
            },
        }
    }
}

/// Copies the rows of a table that `holds` accepts to the new database, and returns the ids of `wanted` that were not
/// copied.
fn copy<V>(
    from: &Source<'_>,
    into: &Redb,
    table: TableDefinition<'static, u128, V>,
    mut wanted: BTreeSet<JobId>,
    holds: &dyn Fn(JobId, &[u8]) -> bool,
) -> io::Result<BTreeSet<JobId>>
where
    V: for<'a> Value<SelfType<'a> = &'a [u8]> + 'static,
{
    // Errors of writing to the new database are returned; errors of reading end the scan of the damaged table.
    let (rows, failed) = (RefCell::new((Rows::new(into, table), &mut wanted)), RefCell::new(None));
    let visit = |id, bytes: &[u8]| {
        if !holds(id, bytes) {
            return ControlFlow::Continue(());
        }
        let (rows, wanted) = &mut *rows.borrow_mut();
        wanted.remove(&id);
        match rows.put(id, bytes) {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                *failed.borrow_mut() = Some(error);
                ControlFlow::Break(())
            }
        }
    };
    from.scan(table, &visit);
    let named: Vec<JobId> = rows.borrow().1.iter().copied().collect();
    for id in named {
        if let Some(bytes) = from.find(table, id) {
            let _ = visit(id, &bytes);
        }
    }
    rows.into_inner().0.flush()?;
    failed.into_inner().map_or(Ok(wanted), Err)
}

/// Rows that wait in memory to be written to a table of the new database.
struct Rows<'a, V: Value + 'static> {
    into: &'a Redb,
    table: TableDefinition<'static, u128, V>,
    rows: Vec<(JobId, Vec<u8>)>,
    bytes: usize,
}

impl<'a, V: for<'b> Value<SelfType<'b> = &'b [u8]> + 'static> Rows<'a, V> {
    fn new(into: &'a Redb, table: TableDefinition<'static, u128, V>) -> Self {
        Self { into, table, rows: Vec::new(), bytes: 0 }
    }

    fn put(&mut self, id: JobId, bytes: &[u8]) -> io::Result<()> {
        self.rows.push((id, bytes.to_vec()));
        self.bytes += bytes.len();
        if self.bytes >= AT_ONCE { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.bytes = 0;
        let rows = take(&mut self.rows);
        guarded(|| {
            let transaction = self.into.begin_write()?;
            {
                let mut table = transaction.open_table(self.table)?;
                for (id, bytes) in &rows {
                    table.insert(id.number(), bytes.as_slice())?;
                }
            }
            transaction.commit()?;
            Ok(())
        })
    }
}
