//! Writes answers in pieces of bounded size: JSON one column after another, tables one row after another. The
//! concatenated pieces equal the answer written as a whole.

use super::{Columns, Members, Rows, Skeleton};
use crate::encodings::Table;
use crate::excerpt::Selection;
use crate::{Field, Trajectory};
use std::io::{self, Write};

/// Number of numbers per piece of an answer, about 64 KiB of text.
const PIECE: usize = 4096;

/// JSON of the selected fields and rows of a solution, written piece by piece.
pub struct JsonPieces {
    selection: Selection,
    skeleton: Skeleton,
    /// The column and row of the trajectory at which the next piece begins; `None` before the first piece.
    next: Option<(usize, usize)>,
    /// The column and the part of the table of a sweep that are written next; `None` before the table begins.
    of_table: Option<(usize, usize)>,
}

impl JsonPieces {
    /// Prepares the JSON of the selected fields and rows; everything in it other than columns is taken from
    /// `skeleton`.
    pub fn new(selection: Selection, skeleton: Skeleton) -> Self {
        Self { selection, skeleton, next: None, of_table: None }
    }

    /// Writes the next piece of the JSON; returns whether there is more.
    ///
    /// # Errors
    /// Errors of reading the columns and of writing to `out`.
    pub fn write(&mut self, columns: &dyn Columns, out: &mut dyn Write) -> io::Result<bool> {
        let [before, between, after] = self.skeleton.around_columns();
        let table = columns.members().zip(Skeleton::around_table(after));
        if let (Some((members, (_, after))), Some(next)) = (table, &mut self.of_table) {
            return write_part(members, next, after, out);
        }
        let (mut column, mut row) = self.next.unwrap_or_default();
        if self.next.is_none() {
            out.write_all(before.as_bytes())?;
        }
        let (rows, fields) = (self.selection.rows.len(), &self.selection.fields);
        let mut room = PIECE;
        while room > 0 && column <= fields.len() {
            if row == 0 {
                begin(column.checked_sub(1).map(|k| (k, columns.names()[fields[k]])), out)?;
            }
            let part = self.selection.rows.part(row, room);
            let of = column.checked_sub(1).map_or(0, |k| fields[k] + 1);
            for (k, value) in columns.values(of, part)?.iter().enumerate() {
                if row + k > 0 {
                    out.write_all(b",")?;
                }
                serde_json::to_writer(&mut *out, value)?;
            }
            // Each column counts as at least one number, so that many empty columns are split into pieces as well.
            room = room.saturating_sub(part.len().max(1));
            row += part.len();
            if row < rows {
                break;
            }
            out.write_all(b"]")?;
            if column == 0 {
                out.write_all(between.as_bytes())?;
                out.write_all(b"{")?;
            }
            (column, row) = (column + 1, 0);
        }
        self.next = Some((column, row));
        if column <= fields.len() {
            return Ok(true);
        }
        out.write_all(b"}")?;
        let (after, is_more) = table.map_or((after, false), |(_, (before, _))| (before, true));
        out.write_all(after.as_bytes())?;
        self.of_table = is_more.then_some((0, 0));
        Ok(is_more)
    }
}

/// Writes the next part of a column of the table of a sweep, and the text `after` at the end of the table; returns
/// whether there is more.
fn write_part(
    members: &dyn Members,
    (column, part): &mut (usize, usize),
    after: &str,
    out: &mut dyn Write,
) -> io::Result<bool> {
    let Some(named) = members.head().columns.get(*column) else {
        out.write_all(after.as_bytes())?;
        return Ok(false);
    };
    if *part == 0 {
        begin(Some((*column, &named.name)), out)?;
    }
    if *part < members.parts() {
        let values = members.values(*part, *column)?;
        for row in 0..values.len() {
            if *part + row > 0 {
                out.write_all(b",")?;
            }
            values.write_json(row, out)?;
        }
        *part += 1;
    }
    if *part >= members.parts() {
        out.write_all(b"]")?;
        (*column, *part) = (*column + 1, 0);
    }
    Ok(true)
}

/// Writes the JSON text before the numbers of a column: of the times if `field` is `None`, or of a field with its index
/// and name.
fn begin(field: Option<(usize, &str)>, out: &mut dyn Write) -> io::Result<()> {
    if let Some((place, name)) = field {
        if place > 0 {
            out.write_all(b",")?;
        }
        serde_json::to_writer(&mut *out, name)?;
        out.write_all(b":")?;
    }
    out.write_all(b"[")
}

/// The selected fields and rows of a solution in a table format (such as CSV), written piece by piece.
pub struct TablePieces {
    selection: Selection,
    table: Box<dyn Table>,
    /// The index in the selection of the row at which the next piece begins.
    next: usize,
}

impl TablePieces {
    /// Prepares the selected fields and rows of a solution in the given table format.
    pub fn new(selection: Selection, table: Box<dyn Table>) -> Self {
        Self { selection, table, next: 0 }
    }

    /// Writes the next piece of the table; returns whether there is more.
    ///
    /// # Errors
    /// Errors of reading the columns and of writing to `out`.
    pub fn write(&mut self, columns: &dyn Columns, out: &mut dyn Write) -> io::Result<bool> {
        let count = (PIECE / (self.selection.fields.len() + 1)).max(1);
        let rows = self.selection.rows.part(self.next, count);
        let block = self.selection.block(columns, rows)?;
        if self.next == 0 {
            self.table.begin(&block, out)?;
        }
        if !rows.is_empty() {
            self.table.rows(&block, 0..rows.len(), out)?;
        }
        self.next += rows.len();
        let more = self.next < self.selection.rows.len();
        if !more {
            self.table.end(out)?;
        }
        Ok(more)
    }
}

/// Writes the whole answer as JSON.
///
/// # Errors
/// Errors of reading the columns and of writing to `out`.
pub fn write_whole(columns: &dyn Columns, skeleton: &Skeleton, out: &mut dyn Write) -> io::Result<()> {
    let mut pieces = JsonPieces::new(Selection::whole(columns), skeleton.clone());
    while pieces.write(columns, out)? {}
    Ok(())
}

impl Selection {
    /// Selects all rows and fields of a solution.
    pub fn whole(columns: &dyn Columns) -> Self {
        let rows = Rows { first: 0, end: columns.rows(), every: 1 };
        Self { fields: (0..columns.names().len()).collect(), rows }
    }

    /// Returns the selected fields at the given rows, without events.
    ///
    /// # Errors
    /// Errors of reading the columns.
    pub fn block(&self, columns: &dyn Columns, rows: Rows) -> io::Result<Trajectory> {
        let names = columns.names();
        let field =
            |&field: &usize| Ok(Field { name: names[field].to_owned(), values: columns.values(field + 1, rows)? });
        let fields = self.fields.iter().map(field).collect::<io::Result<_>>()?;
        Ok(Trajectory { t: columns.values(0, rows)?, fields, events: Vec::new() })
    }

    /// Verifies the checksums of the selected rows and fields.
    ///
    /// # Errors
    /// Errors of reading the columns.
    pub fn verify(&self, columns: &dyn Columns) -> io::Result<()> {
        let all: Vec<usize> = std::iter::once(0).chain(self.fields.iter().map(|field| field + 1)).collect();
        columns.verify(&all, self.rows)
    }
}
