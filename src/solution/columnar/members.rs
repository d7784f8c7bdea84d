//! The table of a sweep in parts of some thousand rows, in memory or on disk: a reader holds one column of one part
//! at a time, however many members there are.
//!
//! The stored form consists, for each part, of the values of each column as [`Values::put`] writes them, with their
//! checksums in the index.

use super::checksum;
use super::stored::Source;
use crate::{Column, Table, Values};
use serde::{Deserialize, Serialize};
use std::io::{self, Write};
use std::sync::{Arc, Mutex, PoisonError};

/// Number of rows in a part of a table: a column of numbers then takes no more than 8 KiB with its header, as a chunk
/// of a trajectory does, a size for which allocators reuse freed memory.
pub const PART: usize = 1000;

/// A table that is read one part of its rows at a time.
pub trait Members: Send + Sync {
    /// Returns the table without rows: names, counts, provenance.
    fn head(&self) -> &Table;

    /// Returns the number of parts into which the rows of the table are divided.
    fn parts(&self) -> usize;

    /// Returns the values of a column in a part.
    ///
    /// # Errors
    /// Errors of the disk; [`io::ErrorKind::InvalidData`] if the column has changed since it was written.
    fn values(&self, part: usize, column: usize) -> io::Result<Values>;

    /// Verifies the checksums of all stored columns and parts.
    ///
    /// # Errors
    /// Same as for [`Members::values`].
    fn verify(&self) -> io::Result<()> {
        Ok(())
    }
}

impl dyn Members + '_ {
    /// Returns the rows of a part.
    ///
    /// # Errors
    /// Same as for [`Members::values`].
    pub fn part(&self, part: usize) -> io::Result<Table> {
        let mut table = self.head().head();
        for (k, column) in table.columns.iter_mut().enumerate() {
            column.values = self.values(part, k)?;
        }
        Ok(table)
    }

    /// Returns the table with all rows.
    ///
    /// # Errors
    /// Same as for [`Members::values`].
    pub fn whole(&self) -> io::Result<Table> {
        let mut table = self.head().emptied();
        for part in 0..self.parts() {
            let part = Table { failed: 0, ..self.part(part)? };
            table.append(part).map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error.0))?;
        }
        Ok(Table { failed: self.head().failed, ..table })
    }

    /// Visits the values of the column `name`, from the first part to the last.
    ///
    /// # Errors
    /// Same as for [`Members::values`].
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

/// The index of the parts of a stored table: their numbers of rows and bytes, and the checksums of their columns.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PartsIndex {
    /// The table without its rows: names, counts, provenance.
    head: Table,
    parts: Vec<PartIndex>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct PartIndex {
    rows: usize,
    /// For each column of the part, the number of its bytes and their checksum.
    columns: Vec<(u64, u64)>,
}

/// Writes a table part by part.
#[derive(Debug, Default)]
pub struct PartsWriter {
    index: Option<PartsIndex>,
    /// Rows that have been added but do not fill a part of the table yet.
    rest: Option<Table>,
}

impl PartsWriter {
    /// Adds rows, of any number.
    ///
    /// # Errors
    /// Errors of writing to `out`; [`io::ErrorKind::InvalidData`] if the rows belong to another table.
    pub fn add(&mut self, rows: Table, out: &mut impl Write) -> io::Result<()> {
        match &mut self.rest {
            Some(rest) => rest.append(rows).map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error.0))?,
            None => self.rest = Some(rows),
        }
        if self.rest.as_ref().is_some_and(|rest| rest.rows() >= PART) { self.put(out) } else { Ok(()) }
    }

    /// Writes the remaining rows; returns the index, or `None` if no table was added.
    ///
    /// # Errors
    /// Same as for [`PartsWriter::add`].
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

/// Writes a table from memory; returns the index.
///
/// # Errors
/// Errors of writing to `out`.
pub fn write_parts(table: &Table, out: &mut impl Write) -> io::Result<Option<PartsIndex>> {
    let (members, mut writer): (&dyn Members, _) = (table, PartsWriter::default());
    // A table without rows has an index of its parts too.
    writer.add(table.head(), out)?;
    for part in 0..members.parts() {
        writer.add(Table { failed: 0, ..members.part(part)? }, out)?;
    }
    writer.end(out)
}

/// The table of a sweep in its stored form, read one column of one part at a time.
pub struct StoredMembers {
    source: Arc<dyn Source>,
    index: PartsIndex,
    /// The offset in bytes of each column of each part of the table.
    offsets: Vec<u64>,
    end: u64,
    /// The bytes that were read last from the stored table, in one buffer for all columns, of which there may be many
    /// thousand.
    bytes: Mutex<Vec<u8>>,
}

impl StoredMembers {
    /// Creates the table that is stored in `source` from the offset `start` on.
    pub fn new(source: Arc<dyn Source>, index: PartsIndex, start: u64) -> Self {
        let mut end = start;
        let mut offsets = Vec::with_capacity(index.parts.len() * index.head.columns.len());
        for (bytes, _) in index.parts.iter().flat_map(|part| &part.columns) {
            offsets.push(end);
            end = end.saturating_add(*bytes);
        }
        Self { source, index, offsets, end, bytes: Mutex::default() }
    }

    /// Returns the offset in bytes of the end of the stored table.
    pub fn end(&self) -> u64 {
        self.end
    }

    /// Returns the index of the parts of the table.
    pub fn index(&self) -> &PartsIndex {
        &self.index
    }

    /// Reads a column of a part of the table, verifies its checksum, and calls `read` with the number of rows of the
    /// part and the bytes of the column.
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
