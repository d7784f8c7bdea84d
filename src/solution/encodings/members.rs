//! The table of a sweep in formats other than a JSON solution: CSV, JSON lines, an Arrow stream. Missing values are
//! empty in CSV and null in the other formats.

use super::csv::write_text;
#[cfg(feature = "parquet")]
use super::parquet::ParquetFile;
use crate::columnar::Members;
use crate::{Column, Solution, Table, Values, Verdict};
use arrow_array::types::Float64Type;
use arrow_array::{ArrayRef, BooleanArray, FixedSizeListArray, Float64Array, RecordBatch, StringArray, UInt32Array};
use arrow_ipc::writer::StreamWriter;
use arrow_schema::{ArrowError, DataType, Field, Schema};
use serde::ser::{Serialize, SerializeMap, Serializer};
use std::collections::HashMap;
use std::io::{self, Write};
use std::sync::Arc;

/// A format of the table of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MembersForm {
    /// CSV: a header, and one row per member.
    Csv,
    /// JSON lines: one object per member.
    Lines,
    /// Arrow: a stream of record batches.
    Arrow,
    /// Parquet: groups of rows, with their positions at the end of the file.
    #[cfg(feature = "parquet")]
    Parquet,
}

/// Writes the table of a sweep.
///
/// # Errors
/// Errors of writing to `out`.
pub fn write_members(solution: &Solution, form: MembersForm, out: &mut impl Write) -> io::Result<()> {
    let Some(table) = &solution.table else { return Ok(()) };
    let mut pieces = MembersPieces::new(form, &solution.verdict);
    while pieces.write(table, out)? {}
    Ok(())
}

/// Writes the table of a sweep piece by piece, one part of its rows at a time.
pub struct MembersPieces {
    form: MembersForm,
    verdict: Verdict,
    /// The index of the part of the rows that is written next.
    part: usize,
    arrow: Option<(Arc<Schema>, StreamWriter<Vec<u8>>)>,
    #[cfg(feature = "parquet")]
    parquet: Option<(Arc<Schema>, ParquetFile)>,
}

impl MembersPieces {
    /// Prepares the table of an answer with the given verdict.
    pub fn new(form: MembersForm, verdict: &Verdict) -> Self {
        Self {
            form,
            verdict: verdict.clone(),
            part: 0,
            arrow: None,
            #[cfg(feature = "parquet")]
            parquet: None,
        }
    }

    /// Writes the next piece; returns whether there is more.
    ///
    /// # Errors
    /// Errors of reading `members` and of writing to `out`.
    pub fn write(&mut self, members: &dyn Members, out: &mut dyn Write) -> io::Result<bool> {
        let is_first = self.part == 0;
        let rows = if self.part < members.parts() { members.part(self.part)? } else { members.head().head() };
        self.part += 1;
        let is_last = self.part >= members.parts();
        match self.form {
            MembersForm::Csv => {
                if is_first {
                    write_header(&rows, out)?;
                }
                write_csv(&rows, out)?;
            }
            MembersForm::Lines => write_lines(&rows, out)?,
            MembersForm::Arrow => {
                if is_first {
                    self.begin_arrow(&rows)?;
                }
                if let Some((schema, writer)) = &mut self.arrow {
                    if rows.rows() > 0 {
                        writer.write(&batch_of(schema, &rows)?).map_err(broken)?;
                    }
                    if is_last {
                        writer.finish().map_err(broken)?;
                    }
                    let written = writer.get_mut();
                    out.write_all(written)?;
                    written.clear();
                }
            }
            #[cfg(feature = "parquet")]
            MembersForm::Parquet => {
                let (schema, file) = match &mut self.parquet {
                    Some(begun) => begun,
                    begun @ None => {
                        let schema = Arc::new(schema_of_members(&rows, &self.verdict));
                        let file = ParquetFile::new(&schema)?;
                        begun.insert((schema, file))
                    }
                };
                file.write(&batch_of(schema, &rows)?, out)?;
                if is_last {
                    file.finish(out)?;
                }
            }
        }
        Ok(!is_last)
    }

    fn begin_arrow(&mut self, table: &Table) -> io::Result<()> {
        let schema = Arc::new(schema_of_members(table, &self.verdict));
        let writer = StreamWriter::try_new(Vec::new(), &schema).map_err(broken)?;
        self.arrow = Some((schema, writer));
        Ok(())
    }
}

fn batch_of(schema: &Arc<Schema>, rows: &Table) -> io::Result<RecordBatch> {
    let columns = rows.columns.iter().map(|column| array(&column.values)).collect();
    RecordBatch::try_new(Arc::clone(schema), columns).map_err(broken)
}

/// Returns the Arrow schema of the table of a sweep, with the verdict and the provenance as its metadata.
pub fn schema_of_members(table: &Table, verdict: &Verdict) -> Schema {
    let provenance = &table.provenance;
    let metadata: HashMap<String, String> = [
        ("dvi.trusted", verdict.trusted.to_string()),
        // Every number of a verdict is finite, so that the verdict can be written as JSON.
        ("dvi.verdict", serde_json::to_string(verdict).unwrap_or_default()),
        ("dvi.program", provenance.version.clone()),
        ("dvi.features", provenance.features.clone()),
        ("dvi.digest", provenance.digest.clone()),
        ("dvi.members", table.members.to_string()),
        ("dvi.times", serde_json::to_string(&table.times).unwrap_or_default()),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into();
    let field = |column: &Column| {
        let kind = match &column.values {
            Values::Numbers(_) => DataType::Float64,
            Values::Counts(_) => DataType::UInt32,
            Values::Flags(_) => DataType::Boolean,
            Values::Words(_) => DataType::Utf8,
            Values::Lists(lists) => {
                let length = i32::try_from(lists.length()).unwrap_or(i32::MAX);
                DataType::new_fixed_size_list(DataType::Float64, length, true)
            }
        };
        Field::new(&column.name, kind, true)
    };
    let fields: Vec<Field> = table.columns.iter().map(field).collect();
    Schema::new_with_metadata(fields, metadata)
}

fn write_header(table: &Table, out: &mut dyn Write) -> io::Result<()> {
    for (k, column) in table.columns.iter().enumerate() {
        if k > 0 {
            out.write_all(b",")?;
        }
        write_text(&column.name, out)?;
    }
    out.write_all(b"\n")
}

fn write_csv(table: &Table, out: &mut dyn Write) -> io::Result<()> {
    for row in 0..table.rows() {
        for (k, column) in table.columns.iter().enumerate() {
            if k > 0 {
                out.write_all(b",")?;
            }
            match &column.values {
                values if values.is_missing(row) => {}
                Values::Words(words) => write_text(words.get(row).unwrap_or_default(), out)?,
                Values::Lists(_) => {
                    // CSV has no lists: a list is written as JSON in quotes.
                    let mut list = Vec::new();
                    column.values.write_json(row, &mut list)?;
                    write_text(&String::from_utf8_lossy(&list), out)?;
                }
                values => values.write_json(row, out)?,
            }
        }
        out.write_all(b"\n")?;
    }
    Ok(())
}

fn write_lines(table: &Table, out: &mut dyn Write) -> io::Result<()> {
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
                Values::Counts(values) => line.serialize_value(&values.get(self.row))?,
                Values::Flags(values) => line.serialize_value(&values[self.row])?,
                Values::Words(words) => line.serialize_value(&words.get(self.row))?,
                Values::Lists(lists) => {
                    line.serialize_value(&lists.numbers(self.row).map(|list| list.collect::<Vec<_>>()))?;
                }
            }
        }
        line.end()
    }
}

/// Returns the values of a column as an Arrow array; missing values are null.
pub fn array(values: &Values) -> ArrayRef {
    let rows = 0..values.len();
    match values {
        Values::Numbers(_) => Arc::new(rows.map(|row| values.number(row)).collect::<Float64Array>()),
        Values::Counts(counts) => {
            let of = |row: usize| counts.get(row).filter(|_| !values.is_missing(row));
            Arc::new(rows.map(of).collect::<UInt32Array>())
        }
        Values::Flags(flags) => Arc::new(rows.map(|row| flags.get(row).copied()).collect::<BooleanArray>()),
        Values::Words(words) => Arc::new(rows.map(|row| words.get(row)).collect::<StringArray>()),
        Values::Lists(lists) => {
            let length = i32::try_from(lists.length()).unwrap_or(i32::MAX);
            let of = rows.map(|row| lists.numbers(row).map(|list| list.collect::<Vec<_>>()));
            Arc::new(FixedSizeListArray::from_iter_primitive::<Float64Type, _, _>(of, length))
        }
    }
}

fn broken(error: ArrowError) -> io::Error {
    io::Error::other(error)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TableProvenance, Words};
    use arrow_array::Array;
    use arrow_ipc::reader::StreamReader;

    fn solution() -> Solution {
        let column = |name: &str, values: Values| Column { name: name.to_owned(), values };
        let mut words = Words::default();
        [None, Some("a, \"b\"")].iter().for_each(|word| words.push(*word));
        let table = Table {
            columns: vec![
                column("member", Values::Counts([0, 1].into_iter().collect())),
                column("x", Values::Numbers(vec![f64::NAN, 0.5])),
                column("n", Values::Counts([u32::MAX, 3].into_iter().collect())),
                column("trusted", Values::Flags(vec![true, false])),
                column("error", Values::Words(words)),
            ],
            members: 2,
            failed: 0,
            swept: vec![],
            collected: vec![],
            times: vec![],
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
