//! Formats of a written solution. Numbers in text are the shortest decimals that read back as the same double,
//! identical on every machine.
//!
//! - JSON: one object, with columns as arrays. Only this format contains events and diagnostics.
//! - Tables, written some rows at a time: [CSV](Csv), [JSON lines](Lines), [Arrow].
//! - With the feature `parquet`, Parquet files, written some groups of rows at a time.
//!
//! The answer of a sweep is a separate table, which may have texts and missing values ([`write_members`]).
//!
//! JSON has the verdict right after `status`, and Arrow in the metadata of its schema. CSV (RFC 4180) has no
//! comments, and each of the JSON lines is a row, so readers of data frames would take anything else for data. For
//! these two formats the verdict is in the header `Dvi-Trusted` of the service and in the exit code of the program.

mod arrow;
mod csv;
mod form;
mod lines;
mod members;
#[cfg(feature = "parquet")]
mod parquet;

pub use arrow::Arrow;
pub use csv::Csv;
pub use form::Form;
pub use lines::Lines;
pub use members::{MembersForm, MembersPieces, array, schema_of_members, write_members};
#[cfg(feature = "parquet")]
pub use parquet::Parquet;

use super::{Solution, Trajectory};
use std::io::{self, Write};
use std::ops::Range;

/// Writes the whole solution as one JSON object.
///
/// # Errors
/// Errors of writing to `out`.
pub fn write_json(solution: &Solution, out: &mut impl Write) -> io::Result<()> {
    serde_json::to_writer(out, solution).map_err(io::Error::from)
}

/// Reads a solution written by [`write_json`]; its diagnostics are not read.
///
/// # Errors
/// The text is not the JSON of a solution.
pub fn read_json(text: &[u8]) -> io::Result<Solution> {
    serde_json::from_slice(text).map_err(io::Error::from)
}

/// A table format of a trajectory, written in order: its beginning, its rows, its end.
pub trait Table: Send {
    /// Writes the text before the rows of `trajectory`.
    ///
    /// # Errors
    /// Errors of writing to `out`.
    fn begin(&mut self, trajectory: &Trajectory, out: &mut dyn Write) -> io::Result<()>;

    /// Writes the rows with the indices `times`, which must exist.
    ///
    /// # Errors
    /// Errors of writing to `out`.
    fn rows(&mut self, trajectory: &Trajectory, times: Range<usize>, out: &mut dyn Write) -> io::Result<()>;

    /// Writes the text after the rows.
    ///
    /// # Errors
    /// Errors of writing to `out`.
    fn end(&mut self, out: &mut dyn Write) -> io::Result<()>;
}

/// Writes one piece of a trajectory as a table, from row `next` on, with about `PIECE` numbers; row 0 is preceded by
/// the beginning of the table. Returns the row at which to continue, if there is more.
///
/// # Errors
/// Errors of writing to `out`.
pub fn write_piece(
    table: &mut dyn Table,
    trajectory: &Trajectory,
    next: usize,
    out: &mut dyn Write,
) -> io::Result<Option<usize>> {
    let rows = trajectory.t.len();
    let last = next.saturating_add((PIECE / (trajectory.fields.len() + 1)).max(1)).min(rows);
    if next == 0 {
        table.begin(trajectory, out)?;
    }
    if next < last {
        table.rows(trajectory, next..last, out)?;
    }
    if last < rows {
        return Ok(Some(last));
    }
    table.end(out)?;
    Ok(None)
}

/// Number of numbers per piece of a table, about 64 KiB of text.
const PIECE: usize = 4096;

/// Writes a trajectory as a table.
///
/// # Errors
/// Errors of writing to `out`.
pub fn write_table(table: &mut dyn Table, trajectory: &Trajectory, out: &mut dyn Write) -> io::Result<()> {
    let mut next = Some(0);
    while let Some(row) = next {
        next = write_piece(table, trajectory, row, out)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Diagnostics, Event, EventKind, Failure, Field, Status};

    fn field(name: &str, values: &[f64]) -> Field {
        Field { name: name.to_owned(), values: values.to_vec() }
    }

    #[test]
    fn names_with_commas_and_quotes_are_quoted() {
        let fields = vec![field("x", &[]), field("i(R1,a)", &[]), field("the \"rod\"", &[])];
        let mut csv = Vec::new();
        write_table(&mut Csv, &Trajectory { fields, ..Trajectory::default() }, &mut csv).unwrap();
        assert_eq!(String::from_utf8(csv).unwrap(), "t,x,\"i(R1,a)\",\"the \"\"rod\"\"\"\n");
    }

    #[test]
    fn every_double_reads_back_to_the_same_bits() {
        let values = [0.1, 1.0 / 3.0, -0.0, 5e-324, f64::MAX, 2.2250738585072014e-308, 1e23, 123456789.0];
        let trajectory = Trajectory { t: values.to_vec(), fields: vec![field("x", &values)], ..Trajectory::default() };
        let mut csv = Vec::new();
        write_table(&mut Csv, &trajectory, &mut csv).unwrap();
        let csv = String::from_utf8(csv).unwrap();
        let read: Vec<u64> =
            csv.lines().skip(1).flat_map(|row| row.split(',')).map(|x| x.parse::<f64>().unwrap().to_bits()).collect();
        let written: Vec<u64> = values.iter().flat_map(|x| [x.to_bits(), x.to_bits()]).collect();
        assert_eq!(read, written);
        assert!(csv.contains("\n0.1,0.1\n"), "{csv}");
    }

    #[test]
    fn the_json_of_a_solution_has_its_columns_by_name() {
        let trajectory = Trajectory { t: vec![0.0, 0.5], fields: vec![field("x", &[1.0, 2.0])], events: vec![] };
        let diagnostics = Diagnostics::default();
        let solution = Solution { status: Status::Completed, trajectory, diagnostics, ..Solution::default() };
        let mut json = Vec::new();
        write_json(&solution, &mut json).unwrap();
        let read: serde_json::Value = serde_json::from_slice(&json).unwrap();
        assert_eq!(read["status"], "completed");
        assert_eq!(read["trajectory"]["t"], serde_json::json!([0.0, 0.5]));
        assert_eq!(read["trajectory"]["fields"]["x"], serde_json::json!([1.0, 2.0]));
        assert!(read.get("error").is_none());
    }

    #[test]
    fn a_table_in_pieces_is_the_whole_table() {
        let t: Vec<f64> = (0..3 * PIECE).map(|k| k as f64).collect();
        let trajectory = Trajectory { fields: vec![field("x", &t)], t, events: vec![] };
        let mut csv = Vec::new();
        write_table(&mut Csv, &trajectory, &mut csv).unwrap();
        let csv = String::from_utf8(csv).unwrap();
        let rows: Vec<String> = (0..3 * PIECE).map(|k| format!("{k}.0,{k}.0")).collect();
        assert!(csv.lines().skip(1).eq(rows.iter()));
    }

    #[test]
    fn a_line_is_an_object_with_its_time_first() {
        let trajectory = Trajectory { t: vec![0.0, 0.5], fields: vec![field("x\"", &[1.0, -0.0])], events: vec![] };
        let mut text = Vec::new();
        write_table(&mut Lines, &trajectory, &mut text).unwrap();
        let told = "{\"t\":0.0,\"x\\\"\":1.0}\n{\"t\":0.5,\"x\\\"\":-0.0}\n";
        assert_eq!(String::from_utf8(text).unwrap(), told);
    }

    #[test]
    fn a_solution_reads_back_with_its_columns_in_order_and_to_the_same_bits() {
        let event = Event { t: 0.1, kind: EventKind::LiftOff, of: "foot".to_owned() };
        let trajectory = Trajectory {
            t: vec![0.0, 1.0 / 3.0],
            fields: vec![field("z", &[1e23, -0.0]), field("a", &[5e-324, 0.3])],
            events: vec![event],
        };
        let error = Failure { code: "step_too_small".into(), message: "\"h\"".to_owned(), time: 0.1, state: vec![2.0] };
        let diagnostics = Diagnostics::default();
        let solution =
            Solution { status: Status::Failed, error: Some(error), trajectory, diagnostics, ..Solution::default() };
        let mut json = Vec::new();
        write_json(&solution, &mut json).unwrap();
        let read = read_json(&json).unwrap();
        assert_eq!(
            (read.status, &read.error, &read.trajectory),
            (solution.status, &solution.error, &solution.trajectory)
        );
        let bits = read.trajectory.fields[0].values[1].to_bits();
        assert_eq!(bits, (-0.0_f64).to_bits());
    }
}
