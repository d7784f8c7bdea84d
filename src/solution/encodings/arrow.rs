//! The streaming format of Arrow's interprocess communication (`application/vnd.apache.arrow.stream`): a schema, record
//! batches of non-null columns of doubles, and the end-of-stream marker.
//!
//! The metadata of the schema contain the verdict: `dvi.trusted` is `true` or `false`, `dvi.verdict` the whole verdict
//! as JSON; `dvi.provenance` identifies the specification that was solved.

use super::Table;
use crate::{Provenance, Trajectory, Verdict};
use arrow_array::{ArrayRef, Float64Array, RecordBatch};
use arrow_ipc::writer::StreamWriter;
use arrow_schema::{ArrowError, DataType, Schema};
use std::collections::HashMap;
use std::io::{self, Write};
use std::ops::Range;
use std::sync::Arc;

/// Writes a trajectory as an Arrow stream.
#[derive(Default)]
pub struct Arrow {
    metadata: HashMap<String, String>,
    begun: Option<(Arc<Schema>, StreamWriter<Vec<u8>>)>,
}

impl Arrow {
    /// Prepares an Arrow stream with the given verdict in its metadata.
    pub fn with(verdict: &Verdict) -> Self {
        // Every number of a verdict is finite, so that serialisation cannot fail.
        let json = serde_json::to_string(verdict).unwrap_or_default();
        let metadata = [("dvi.trusted", verdict.trusted.to_string()), ("dvi.verdict", json)];
        Self { metadata: metadata.map(|(key, value)| (key.to_owned(), value)).into(), begun: None }
    }

    /// Adds the provenance of the answer to the metadata of the Arrow stream.
    #[must_use]
    pub fn of(mut self, provenance: Option<&Provenance>) -> Self {
        if let Some(json) = provenance.and_then(|provenance| serde_json::to_string(provenance).ok()) {
            self.metadata.insert("dvi.provenance".to_owned(), json);
        }
        self
    }

    /// Returns the metadata of the Arrow schema.
    pub fn metadata(&self) -> &HashMap<String, String> {
        &self.metadata
    }

    /// Returns the Arrow schema of a trajectory.
    pub(super) fn schema(&self, trajectory: &Trajectory) -> Arc<Schema> {
        let names = std::iter::once("t").chain(trajectory.fields.iter().map(|field| field.name.as_str()));
        let columns: Vec<arrow_schema::Field> =
            names.map(|name| arrow_schema::Field::new(name, DataType::Float64, false)).collect();
        Arc::new(Schema::new_with_metadata(columns, self.metadata.clone()))
    }

    /// Flushes the bytes of the Arrow stream written so far to `out`.
    fn pass_on(&mut self, out: &mut dyn Write) -> io::Result<()> {
        let Some((_, writer)) = &mut self.begun else { return Ok(()) };
        let written = writer.get_mut();
        out.write_all(written)?;
        written.clear();
        Ok(())
    }
}

impl Table for Arrow {
    fn begin(&mut self, trajectory: &Trajectory, out: &mut dyn Write) -> io::Result<()> {
        let schema = self.schema(trajectory);
        let writer = StreamWriter::try_new(Vec::new(), &schema).map_err(broken)?;
        self.begun = Some((schema, writer));
        self.pass_on(out)
    }

    fn rows(&mut self, trajectory: &Trajectory, times: Range<usize>, out: &mut dyn Write) -> io::Result<()> {
        let Some((schema, writer)) = &mut self.begun else { return Ok(()) };
        writer.write(&batch_of(schema, trajectory, times)?).map_err(broken)?;
        self.pass_on(out)
    }

    fn end(&mut self, out: &mut dyn Write) -> io::Result<()> {
        if let Some((_, writer)) = &mut self.begun {
            writer.finish().map_err(broken)?;
        }
        self.pass_on(out)
    }
}

/// Returns the rows of a trajectory with the indices `times` as a record batch.
pub(super) fn batch_of(schema: &Arc<Schema>, trajectory: &Trajectory, times: Range<usize>) -> io::Result<RecordBatch> {
    let columns = std::iter::once(&trajectory.t).chain(trajectory.fields.iter().map(|field| &field.values));
    let columns = columns.map(|column| {
        let part = column.get(times.clone()).unwrap_or_default();
        Arc::new(Float64Array::from(part.to_vec())) as ArrayRef
    });
    RecordBatch::try_new(Arc::clone(schema), columns.collect()).map_err(broken)
}

fn broken(error: ArrowError) -> io::Error {
    io::Error::other(error)
}

#[cfg(test)]
mod tests {
    use super::super::write_table;
    use super::*;
    use crate::{CheckCode, Field, Reason};
    use arrow_array::cast::AsArray;
    use arrow_array::types::Float64Type;
    use arrow_ipc::reader::StreamReader;

    #[test]
    fn a_reader_finds_the_columns_to_the_same_bits_in_batches() {
        let t: Vec<f64> = (0..5000).map(|k| f64::from(k) / 3.0).collect();
        let values: Vec<f64> = t.iter().map(|t| -t * 1e-300).collect();
        let field = Field { name: "i(R1,a)".to_owned(), values: values.clone() };
        let trajectory = Trajectory { t: t.clone(), fields: vec![field], events: vec![] };
        let mut bytes = Vec::new();
        write_table(&mut Arrow::default(), &trajectory, &mut bytes).unwrap();
        assert_eq!(bytes[..4], [0xff; 4], "a message begins with the mark of a continuation");
        let reader = StreamReader::try_new(bytes.as_slice(), None).unwrap();
        let names: Vec<String> = reader.schema().fields().iter().map(|field| field.name().clone()).collect();
        assert_eq!(names, ["t", "i(R1,a)"]);
        let batches: Vec<RecordBatch> = reader.map(Result::unwrap).collect();
        assert!(batches.len() > 1);
        let column = |k: usize| -> Vec<u64> {
            let parts = batches.iter().map(|batch| batch.column(k).as_primitive::<Float64Type>());
            parts.flat_map(|part| part.values().iter().map(|value| value.to_bits()).collect::<Vec<_>>()).collect()
        };
        assert_eq!(column(0), t.iter().map(|t| t.to_bits()).collect::<Vec<_>>());
        assert_eq!(column(1), values.iter().map(|value| value.to_bits()).collect::<Vec<_>>());
    }

    #[test]
    fn the_schema_has_the_verdict() {
        let message = "the hinge of `arm` comes apart".to_owned();
        let reason = Reason { code: CheckCode::JointDrift, value: 0.03, allowed: 1e-3, message };
        for verdict in
            [Verdict { trusted: true, ..Verdict::default() }, Verdict { because: vec![reason], ..Verdict::default() }]
        {
            let mut bytes = Vec::new();
            write_table(&mut Arrow::with(&verdict), &Trajectory::default(), &mut bytes).unwrap();
            let schema = StreamReader::try_new(bytes.as_slice(), None).unwrap().schema();
            assert_eq!(schema.metadata()["dvi.trusted"], verdict.trusted.to_string());
            assert_eq!(serde_json::from_str::<Verdict>(&schema.metadata()["dvi.verdict"]).unwrap(), verdict);
        }
    }

    #[test]
    fn an_empty_trajectory_is_a_schema_and_an_end() {
        let mut bytes = Vec::new();
        write_table(&mut Arrow::default(), &Trajectory::default(), &mut bytes).unwrap();
        assert_eq!(StreamReader::try_new(bytes.as_slice(), None).unwrap().count(), 0);
        assert_eq!(bytes[bytes.len() - 8..], [0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0]);
    }
}
