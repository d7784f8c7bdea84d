//! A solution as text. Numbers are the shortest decimals that read back to the same double, the same digits in both.
//!
//! - JSON: one object, columns as arrays.
//! - CSV (RFC 4180, lines ended by a line feed): the header `t,name,...`, then a row a time. Events and diagnostics
//!   are in the JSON alone.

use super::{Solution, Trajectory};
use std::io::{self, Write};
use std::ops::Range;

/// Writes the whole solution as one JSON object.
///
/// # Errors
/// Those of `out`.
pub fn write_json(solution: &Solution, out: &mut impl Write) -> io::Result<()> {
    serde_json::to_writer(out, solution).map_err(io::Error::from)
}

/// Reads a solution that [`write_json`] wrote; its diagnostics are left out.
///
/// # Errors
/// The text is another.
pub fn read_json(text: &[u8]) -> io::Result<Solution> {
    serde_json::from_slice(text).map_err(io::Error::from)
}

/// Writes the trajectory as CSV.
///
/// # Errors
/// Those of `out`.
pub fn write_csv(trajectory: &Trajectory, out: &mut impl Write) -> io::Result<()> {
    write_csv_header(trajectory, out)?;
    write_csv_rows(trajectory, 0..trajectory.t.len(), out)
}

/// Writes the header of the CSV: `t` and the names of the fields.
///
/// # Errors
/// Those of `out`.
pub fn write_csv_header(trajectory: &Trajectory, out: &mut impl Write) -> io::Result<()> {
    out.write_all(b"t")?;
    for field in &trajectory.fields {
        out.write_all(b",")?;
        write_text(&field.name, out)?;
    }
    out.write_all(b"\n")
}

/// Writes the rows of those `times` that there are; a value that is missing is left empty.
///
/// # Errors
/// Those of `out`.
pub fn write_csv_rows(trajectory: &Trajectory, times: Range<usize>, out: &mut impl Write) -> io::Result<()> {
    for (row, t) in trajectory.t.iter().enumerate().take(times.end).skip(times.start) {
        serde_json::to_writer(&mut *out, t)?;
        for field in &trajectory.fields {
            out.write_all(b",")?;
            if let Some(value) = field.values.get(row) {
                serde_json::to_writer(&mut *out, value)?;
            }
        }
        out.write_all(b"\n")?;
    }
    Ok(())
}

/// A field of text, quoted where RFC 4180, section 2, asks for it.
fn write_text(text: &str, out: &mut impl Write) -> io::Result<()> {
    if text.contains(['"', ',', '\n', '\r']) {
        write!(out, "\"{}\"", text.replace('"', "\"\""))
    } else {
        out.write_all(text.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solution::{Diagnostics, Event, EventKind, Failure, Field, Status};

    fn field(name: &str, values: &[f64]) -> Field {
        Field { name: name.to_owned(), values: values.to_vec() }
    }

    #[test]
    fn names_with_commas_and_quotes_are_quoted() {
        let fields = vec![field("x", &[]), field("i(R1,a)", &[]), field("the \"rod\"", &[])];
        let mut csv = Vec::new();
        write_csv(&Trajectory { fields, ..Trajectory::default() }, &mut csv).unwrap();
        assert_eq!(String::from_utf8(csv).unwrap(), "t,x,\"i(R1,a)\",\"the \"\"rod\"\"\"\n");
    }

    #[test]
    fn every_double_reads_back_to_the_same_bits() {
        let values = [0.1, 1.0 / 3.0, -0.0, 5e-324, f64::MAX, 2.2250738585072014e-308, 1e23, 123456789.0];
        let trajectory = Trajectory { t: values.to_vec(), fields: vec![field("x", &values)], ..Trajectory::default() };
        let mut csv = Vec::new();
        write_csv(&trajectory, &mut csv).unwrap();
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
        let solution = Solution { status: Status::Completed, error: None, trajectory, diagnostics, study: None };
        let mut json = Vec::new();
        write_json(&solution, &mut json).unwrap();
        let read: serde_json::Value = serde_json::from_slice(&json).unwrap();
        assert_eq!(read["status"], "completed");
        assert_eq!(read["trajectory"]["t"], serde_json::json!([0.0, 0.5]));
        assert_eq!(read["trajectory"]["fields"]["x"], serde_json::json!([1.0, 2.0]));
        assert!(read.get("error").is_none());
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
        let solution = Solution { status: Status::Failed, error: Some(error), trajectory, diagnostics, study: None };
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
