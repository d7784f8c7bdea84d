//! The table of a sweep in parts of some thousand rows, in memory or on a disk: a reader has one column of one part at a time,
//! however many members there are.
//!
//! The stored form is, for each part, the values of each column as [`Values::put`] writes them, each with a checksum in the
//! index.

use super::checksum;
use super::stored::Source;
use crate::{Column, Table, Values};
use serde::{Deserialize, Serialize};
use std::io::{self, Write};
use std::sync::{Arc, Mutex, PoisonError};

/// The rows of a part: with its kind, a column of numbers takes no more than 8 KiB, as a chunk of a trajectory does, and is
/// what an allocator hands out from what was freed.
pub const PART: usize = 1000;

/// A table, a part of its rows at a time.
pub trait Members: Send + Sync {
    /// All but the rows: names, counts, provenance.
    fn head(&self) -> &Table;

    /// How many parts there are.
    fn parts(&self) -> usize;

    /// The values of a column in a part.
    ///
    /// # Errors
    /// Those of the disk; [`io::ErrorKind::InvalidData`] where the column is not as it was written.
    fn values(&self, part: usize, column: usize) -> io::Result<Values>;

    /// Compares the checksums of all that is stored.
    ///
    /// # Errors
    /// As of [`Members::values`].
    fn verify(&self) -> io::Result<()> {
        Ok(())
    }
}

impl dyn Members + '_ {
    /// The rows of a part.
    ///
    /// # Errors
    /// As of [`Members::values`].
    pub fn part(&self, part: usize) -> io::Result<Table> {
        let mut table = self.head().head();
        for (k, column) in table.columns.iter_mut().enumerate() {
            column.values = self.values(part, k)?;
        }
        Ok(table)
    }

    /// All rows.
    ///
    /// # Errors
    /// As of [`Members::values`].
    pub fn whole(&self) -> io::Result<Table> {
        let mut table = self.head().emptied();
        for part in 0..self.parts() {
            let part = Table { failed: 0, ..self.part(part)? };
            table.append(part).map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error.0))?;
        }
        Ok(Table { failed: self.head().failed, ..table })
    }

    /// Visits the values of the column of that name, from the first part to the last.
    ///
    /// # Errors
    /// As of [`Members::values`].
    pub fn visit(&self, name: &str, mut visit: impl FnMut(&Values)) -> io::Result<()> {
        let Some(column) = self.head().columns.iter().position(|column| column.name == name) else { return Ok(()) };
        (0..self.parts()).try_for_each(|part| self.values(part, column).map(|values| visit(&values)))
    }
}

impl Members for Table {
    fn head(&self) -> &Table {
        self
    }

    fn parts(&self) -> usize {
        self.rows().div_ceil(PART)
    }

    fn values(&self, part: usize, column: usize) -> io::Result<Values> {
        let rows = part * PART..((part + 1) * PART).min(self.rows());
        let column = self.columns.get(column).ok_or(io::ErrorKind::InvalidInput)?;
        Ok(column.values.part(rows))
    }
}

/// Where the parts of a stored table are.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PartsIndex {
    /// The table without rows.
    head: Table,
    parts: Vec<PartIndex>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct PartIndex {
    rows: usize,
    /// Of each column its bytes and their checksum.
    columns: Vec<(u64, u64)>,
}

/// A writer of a table, from its first part to its last.
#[derive(Debug, Default)]
pub struct PartsWriter {
    index: Option<PartsIndex>,
    /// Rows that do not make a part yet.
    rest: Option<Table>,
}

impl PartsWriter {
    /// Adds rows, which may be few.
    ///
    /// # Errors
    /// Those of `out`; [`io::ErrorKind::InvalidData`] if they are rows of another table.
    pub fn add(&mut self, rows: Table, out: &mut impl Write) -> io::Result<()> {
        match &mut self.rest {
            Some(rest) => rest.append(rows).map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error.0))?,
            None => self.rest = Some(rows),
        }
        if self.rest.as_ref().is_some_and(|rest| rest.rows() >= PART) { self.put(out) } else { Ok(()) }
    }

    /// Writes the rows that are left; returns the index, or nothing if no table was added.
    ///
    /// # Errors
    /// The same as those of [`PartsWriter::add`].
    pub fn end(mut self, out: &mut impl Write) -> io::Result<Option<PartsIndex>> {
        self.put(out)?;
        Ok(self.index)
    }

    fn put(&mut self, out: &mut impl Write) -> io::Result<()> {
        let Some(rest) = self.rest.take() else { return Ok(()) };
        let index = self.index.get_or_insert_with(|| PartsIndex { head: rest.emptied(), parts: Vec::new() });
        index.head.failed += rest.failed;
        if rest.rows() == 0 {
            return Ok(());
        }
        let (mut columns, mut bytes) = (Vec::with_capacity(rest.columns.len()), Vec::new());
        for Column { values, .. } in &rest.columns {
            bytes.clear();
            values.put(&mut bytes)?;
            columns.push((bytes.len() as u64, checksum(&bytes)));
            out.write_all(&bytes)?;
        }
        index.parts.push(PartIndex { rows: rest.rows(), columns });
        Ok(())
    }
}

/// Writes a table that is in memory; gives the index.
///
/// # Errors
/// Those of `out`.
pub fn write_parts(table: &Table, out: &mut impl Write) -> io::Result<Option<PartsIndex>> {
    let (members, mut writer): (&dyn Members, _) = (table, PartsWriter::default());
    // A table without rows has a head all the same.
    writer.add(table.head(), out)?;
    for part in 0..members.parts() {
        writer.add(Table { failed: 0, ..members.part(part)? }, out)?;
    }
    writer.end(out)
}

/// A table where it is stored.
pub struct StoredMembers {
    source: Arc<dyn Source>,
    index: PartsIndex,
    /// Where each column of each part begins.
    offsets: Vec<u64>,
    end: u64,
    /// What was read last: one allocation for all columns, of which there may be many thousand.
    bytes: Mutex<Vec<u8>>,
}

impl StoredMembers {
    /// The table in `source`, from `start` on.
    pub fn new(source: Arc<dyn Source>, index: PartsIndex, start: u64) -> Self {
        let mut end = start;
        let mut offsets = Vec::with_capacity(index.parts.len() * index.head.columns.len());
        for (bytes, _) in index.parts.iter().flat_map(|part| &part.columns) {
            offsets.push(end);
            end = end.saturating_add(*bytes);
        }
        Self { source, index, offsets, end, bytes: Mutex::default() }
    }

    /// Where it ends.
    pub fn end(&self) -> u64 {
        self.end
    }

    /// Its index.
    pub fn index(&self) -> &PartsIndex {
        &self.index
    }

    /// Calls `read` with the rows of a part and the bytes of a column of it, which are as they were written.
    fn read<T>(&self, part: usize, column: usize, read: impl FnOnce(usize, &[u8]) -> io::Result<T>) -> io::Result<T> {
        let damaged = || io::Error::new(io::ErrorKind::InvalidData, "a table is not as it was written");
        let of = self.index.parts.get(part).ok_or_else(damaged)?;
        let (length, sum) = *of.columns.get(column).ok_or_else(damaged)?;
        let offset = *self.offsets.get(part * self.index.head.columns.len() + column).ok_or_else(damaged)?;
        let mut bytes = self.bytes.lock().unwrap_or_else(PoisonError::into_inner);
        bytes.resize(usize::try_from(length).map_err(|_| damaged())?, 0);
        self.source.read_at(offset, &mut bytes).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => damaged(),
            _ => error,
        })?;
        if checksum(&bytes) == sum { read(of.rows, &bytes) } else { Err(damaged()) }
    }
}

impl Members for StoredMembers {
    fn head(&self) -> &Table {
        &self.index.head
    }

    fn parts(&self) -> usize {
        self.index.parts.len()
    }

    fn values(&self, part: usize, column: usize) -> io::Result<Values> {
        self.read(part, column, |rows, bytes| Values::of_bytes(bytes, rows))
    }

    fn verify(&self) -> io::Result<()> {
        let columns = self.index.head.columns.len();
        (0..self.parts())
            .try_for_each(|part| (0..columns).try_for_each(|column| self.read(part, column, |_, _| Ok(()))))
    }
}
