//! The table of a sweep in other formats: CSV, JSON lines, an Arrow stream. Missing values are empty in CSV, null in
//! the others.

use super::csv::write_text;
use crate::{Solution, Table, Values, Verdict};
use arrow_array::{ArrayRef, BooleanArray, Float64Array, RecordBatch, StringArray, UInt32Array};
use arrow_ipc::writer::StreamWriter;
use arrow_schema::{ArrowError, DataType, Field, Schema};
use serde::ser::{Serialize, SerializeMap, Serializer};
use std::collections::HashMap;
use std::io::{self, Write};
use std::ops::Range;
use std::sync::Arc;

/// Rows per batch of an Arrow stream.
const BATCH: usize = 1 << 14;

/// A format of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MembersForm {
    /// CSV: a header, and one row per member.
    Csv,
    /// JSON lines: one object per member.
    Lines,
    /// Arrow: a stream of record batches.
    Arrow,
}

/// Writes the table of a sweep.
///
/// # Errors
/// Errors of writing to `out`.
pub fn write_members(solution: &Solution, form: MembersForm, out: &mut impl Write) -> io::Result<()> {
    let Some(table) = &solution.table else { return Ok(()) };
    match form {
        MembersForm::Csv => write_csv(table, out),
        MembersForm::Lines => write_lines(table, out),
        MembersForm::Arrow => write_arrow(table, &solution.verdict, out),
    }
}

fn write_csv(table: &Table, out: &mut impl Write) -> io::Result<()> {
    for (k, column) in table.columns.iter().enumerate() {
        if k > 0 {
            out.write_all(b",")?;
        }
        write_text(&column.name, out)?;
    }
    out.write_all(b"\n")?;
    for row in 0..table.rows() {
        for (k, column) in table.columns.iter().enumerate() {
            if k > 0 {
                out.write_all(b",")?;
            }
            if column.values.is_missing(row) {
                continue;
            }
            match &column.values {
                Values::Numbers(values) => serde_json::to_writer(&mut *out, &values[row])?,
                Values::Counts(values) => serde_json::to_writer(&mut *out, &values[row])?,
                Values::Flags(values) => serde_json::to_writer(&mut *out, &values[row])?,
                Values::Words(words) => write_text(words.get(row).unwrap_or_default(), out)?,
            }
        }
        out.write_all(b"\n")?;
    }
    Ok(())
}

fn write_lines(table: &Table, out: &mut impl Write) -> io::Result<()> {
    for row in 0..table.rows() {
        serde_json::to_writer(&mut *out, &Row { table, row })?;
        out.write_all(b"\n")?;
    }
    Ok(())
}

struct Row<'a> {
    table: &'a Table,
    row: usize,
}

impl Serialize for Row<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut line = serializer.serialize_map(Some(self.table.columns.len()))?;
        for column in &self.table.columns {
            line.serialize_key(&column.name)?;
            match &column.values {
                values if values.is_missing(self.row) => line.serialize_value(&None::<f64>)?,
                Values::Numbers(values) => line.serialize_value(&values[self.row])?,
                Values::Counts(values) => line.serialize_value(&values[self.row])?,
                Values::Flags(values) => line.serialize_value(&values[self.row])?,
                Values::Words(words) => line.serialize_value(&words.get(self.row))?,
            }
        }
        line.end()
    }
}

/// The schema of the table of a sweep in Arrow, with the verdict and the provenance as its metadata.
pub fn schema_of_members(table: &Table, verdict: &Verdict) -> Schema {
    let provenance = &table.provenance;
    let metadata: HashMap<String, String> = [
        ("dvi.trusted", verdict.trusted.to_string()),
        // Every number of a verdict is finite, so that serialisation cannot fail.
        ("dvi.verdict", serde_json::to_string(verdict).unwrap_or_default()),
        ("dvi.program", provenance.version.clone()),
        ("dvi.features", provenance.features.clone()),
        ("dvi.digest", provenance.digest.clone()),
        ("dvi.members", table.members.to_string()),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into();
    let fields: Vec<Field> = table
        .columns
        .iter()
        .map(|column| {
            let kind = match &column.values {
                Values::Numbers(_) => DataType::Float64,
                Values::Counts(_) => DataType::UInt32,
                Values::Flags(_) => DataType::Boolean,
                Values::Words(_) => DataType::Utf8,
            };
            Field::new(&column.name, kind, true)
        })
        .collect();
    Schema::new_with_metadata(fields, metadata)
}

fn write_arrow(table: &Table, verdict: &Verdict, out: &mut impl Write) -> io::Result<()> {
    let schema = Arc::new(schema_of_members(table, verdict));
    let mut writer = StreamWriter::try_new(&mut *out, &schema).map_err(broken)?;
    for first in (0..table.rows()).step_by(BATCH) {
        let rows = first..(first + BATCH).min(table.rows());
        let columns = table.columns.iter().map(|column| array(&column.values, rows.clone())).collect();
        writer.write(&RecordBatch::try_new(Arc::clone(&schema), columns).map_err(broken)?).map_err(broken)?;
    }
    writer.finish().map_err(broken)
}

fn array(values: &Values, rows: Range<usize>) -> ArrayRef {
    match values {
        Values::Numbers(_) => Arc::new(rows.map(|row| values.number(row)).collect::<Float64Array>()),
        Values::Counts(counts) => {
            let of = |row: usize| counts.get(row).copied().filter(|_| !values.is_missing(row));
            Arc::new(rows.map(of).collect::<UInt32Array>())
        }
        Values::Flags(flags) => Arc::new(rows.map(|row| flags.get(row).copied()).collect::<BooleanArray>()),
        Values::Words(words) => Arc::new(rows.map(|row| words.get(row)).collect::<StringArray>()),
    }
}

fn broken(error: ArrowError) -> io::Error {
    io::Error::other(error)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Column, TableProvenance, Words};
    use arrow_array::Array;
    use arrow_ipc::reader::StreamReader;

    fn solution() -> Solution {
        let column = |name: &str, values: Values| Column { name: name.to_owned(), values };
        let mut words = Words::default();
        [None, Some("a, \"b\"")].iter().for_each(|word| words.push(*word));
        let table = Table {
            columns: vec![
                column("member", Values::Counts(vec![0, 1])),
                column("x", Values::Numbers(vec![f64::NAN, 0.5])),
                column("n", Values::Counts(vec![u32::MAX, 3])),
                column("trusted", Values::Flags(vec![true, false])),
                column("error", Values::Words(words)),
            ],
            members: 2,
            failed: 0,
            swept: vec![],
            collected: vec![],
            provenance: TableProvenance { digest: "abc".to_owned(), ..TableProvenance::default() },
        };
        Solution { table: Some(table), ..Solution::default() }
    }

    fn written(form: MembersForm) -> Vec<u8> {
        let mut out = Vec::new();
        write_members(&solution(), form, &mut out).unwrap();
        out
    }

    #[test]
    fn what_is_missing_is_nothing_in_csv_and_null_in_lines() {
        let csv = String::from_utf8(written(MembersForm::Csv)).unwrap();
        assert_eq!(csv, "member,x,n,trusted,error\n0,,,true,\n1,0.5,3,false,\"a, \"\"b\"\"\"\n");
        let lines = String::from_utf8(written(MembersForm::Lines)).unwrap();
        assert!(lines.starts_with("{\"member\":0,\"x\":null,\"n\":null,\"trusted\":true,\"error\":null}\n"), "{lines}");
    }

    #[test]
    fn what_is_missing_is_null_in_arrow() {
        let bytes = written(MembersForm::Arrow);
        let mut reader = StreamReader::try_new(bytes.as_slice(), None).unwrap();
        assert_eq!(reader.schema().metadata()["dvi.digest"], "abc");
        let batch = reader.next().unwrap().unwrap();
        let nulls: Vec<usize> = (0..5).map(|k| batch.column(k).null_count()).collect();
        assert_eq!((batch.num_rows(), nulls), (2, vec![0, 1, 1, 0, 1]));
    }
}
