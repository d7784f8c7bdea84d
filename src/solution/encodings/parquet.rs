//! Parquet files: groups of rows, compressed by Snappy, with their positions at the end of the file. The metadata are
//! those of the Arrow schema, with the verdict.

use super::Table;
use super::arrow::{Arrow, batch_of};
use crate::Trajectory;
use arrow_array::RecordBatch;
use arrow_schema::Schema;
use parquet::arrow::ArrowWriter;
use parquet::basic::Compression;
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use std::io::{self, Write};
use std::ops::Range;
use std::sync::Arc;

/// Number of rows that are collected in memory before they are written as a group.
const ROWS: usize = 1 << 16;

/// A Parquet file in the process of being written.
pub struct ParquetFile {
    writer: ArrowWriter<Vec<u8>>,
}

impl ParquetFile {
    /// Begins a file of tables with the given schema.
    ///
    /// # Errors
    /// A column has a type that Parquet cannot represent.
    pub fn new(schema: &Arc<Schema>) -> io::Result<Self> {
        let pair = |(key, value): (&String, &String)| KeyValue::new(key.clone(), value.clone());
        let mut pairs: Vec<KeyValue> = schema.metadata().iter().map(pair).collect();
        pairs.sort_by(|a, b| a.key.cmp(&b.key));
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_max_row_group_row_count(Some(ROWS))
            .set_key_value_metadata(Some(pairs))
            .build();
        let writer = ArrowWriter::try_new(Vec::new(), Arc::clone(schema), Some(properties)).map_err(broken)?;
        Ok(Self { writer })
    }

    /// Adds rows; complete groups of rows are written to `out`.
    ///
    /// # Errors
    /// Errors of the conversion of `rows` and of writing to `out`.
    pub fn write(&mut self, rows: &RecordBatch, out: &mut dyn Write) -> io::Result<()> {
        self.writer.write(rows).map_err(broken)?;
        self.pass_on(out)
    }

    /// Writes the last group of rows and the end of the file.
    ///
    /// # Errors
    /// Errors of the conversion of the rows and of writing to `out`.
    pub fn finish(&mut self, out: &mut dyn Write) -> io::Result<()> {
        self.writer.finish().map_err(broken)?;
        self.pass_on(out)
    }

    fn pass_on(&mut self, out: &mut dyn Write) -> io::Result<()> {
        let written = self.writer.inner_mut();
        out.write_all(written)?;
        written.clear();
        Ok(())
    }
}

/// Writes a trajectory as a Parquet file.
#[derive(Default)]
pub struct Parquet {
    like: Arrow,
    begun: Option<(Arc<Schema>, ParquetFile)>,
}

impl Parquet {
    /// Prepares a Parquet file with the columns and the metadata of an Arrow stream.
    pub fn like(arrow: Arrow) -> Self {
        Self { like: arrow, begun: None }
    }
}

impl Table for Parquet {
    fn begin(&mut self, trajectory: &Trajectory, _: &mut dyn Write) -> io::Result<()> {
        let schema = self.like.schema(trajectory);
        let file = ParquetFile::new(&schema)?;
        self.begun = Some((schema, file));
        Ok(())
    }

    fn rows(&mut self, trajectory: &Trajectory, times: Range<usize>, out: &mut dyn Write) -> io::Result<()> {
        let Some((schema, file)) = &mut self.begun else { return Ok(()) };
        file.write(&batch_of(schema, trajectory, times)?, out)
    }

    fn end(&mut self, out: &mut dyn Write) -> io::Result<()> {
        self.begun.as_mut().map_or(Ok(()), |(_, file)| file.finish(out))
    }
}

fn broken(error: ParquetError) -> io::Error {
    io::Error::other(error)
}

#[cfg(test)]
mod tests {
    use super::super::{Form, MembersForm, write_members};
    use super::*;
    use crate::{Field, Provenance, Solution};
    use arrow_array::cast::AsArray;
    use arrow_array::types::Float64Type;
    use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

    fn file_of(solution: &Solution) -> std::fs::File {
        let mut bytes = Vec::new();
        Form::Parquet.write(solution, None, &mut bytes).unwrap();
        let path = std::env::temp_dir().join(format!("dvi-parquet-{}", std::process::id()));
        std::fs::write(&path, bytes).unwrap();
        let file = std::fs::File::open(&path).unwrap();
        std::fs::remove_file(path).unwrap();
        file
    }

    #[test]
    fn a_reader_finds_the_columns_to_the_same_bits_and_the_verdict() {
        let t: Vec<f64> = (0..ROWS as u32 + 10).map(|k| f64::from(k) / 3.0).collect();
        let field = Field { name: "i(R1,a)".to_owned(), values: t.iter().map(|t| -t * 1e-300).collect() };
        let trajectory = Trajectory { t: t.clone(), fields: vec![field.clone()], events: vec![] };
        let provenance = Some(Provenance::default());
        let builder = ParquetRecordBatchReaderBuilder::try_new(file_of(&Solution {
            trajectory,
            provenance,
            ..Solution::default()
        }));
        let builder = builder.unwrap();
        assert_eq!(builder.metadata().num_row_groups(), 2);
        assert_eq!(builder.schema().metadata()["dvi.trusted"], "false");
        let batches: Vec<RecordBatch> = builder.build().unwrap().map(Result::unwrap).collect();
        for (k, expected) in [t, field.values].iter().enumerate() {
            let parts = batches.iter().map(|batch| batch.column(k).as_primitive::<Float64Type>());
            let found: Vec<u64> =
                parts.flat_map(|part| part.values().iter().map(|value| value.to_bits()).collect::<Vec<_>>()).collect();
            assert_eq!(found, expected.iter().map(|value| value.to_bits()).collect::<Vec<_>>());
        }
    }

    #[test]
    fn an_answer_without_a_table_has_no_members() {
        let mut bytes = Vec::new();
        write_members(&Solution::default(), MembersForm::Parquet, &mut bytes).unwrap();
        assert!(bytes.is_empty());
    }
}
