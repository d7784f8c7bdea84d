//! Writes a whole answer, of a run or of a sweep, in any of its formats.

#[cfg(feature = "parquet")]
use super::Parquet;
use super::{Arrow, Csv, Lines, MembersForm, write_json, write_members, write_table};
use crate::Solution;
use crate::pictures::write_svg;
use std::io::{self, Write};

/// A format of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// JSON: the whole answer, with columns as arrays.
    Json,
    /// CSV: one row per time, or per member of a sweep.
    Csv,
    /// JSON lines: one object per time, or per member of a sweep, each on a line.
    Lines,
    /// Arrow: a stream of record batches.
    Arrow,
    /// Parquet: groups of rows in a file.
    #[cfg(feature = "parquet")]
    Parquet,
    /// SVG: a plot of the answer.
    Svg,
}

impl Form {
    /// Returns the format of files with this extension; `None` if there is none.
    pub fn of_extension(extension: &str) -> Option<Self> {
        Some(match extension {
            "json" => Self::Json,
            "csv" => Self::Csv,
            "ndjson" | "jsonl" => Self::Lines,
            "arrow" | "arrows" => Self::Arrow,
            #[cfg(feature = "parquet")]
            "parquet" => Self::Parquet,
            "svg" => Self::Svg,
            _ => return None,
        })
    }

    /// Writes an answer; a plot has the label `label`.
    ///
    /// # Errors
    /// Errors of writing to `out`.
    pub fn write(self, solution: &Solution, label: Option<&str>, out: &mut impl Write) -> io::Result<()> {
        let arrow = || Arrow::with(&solution.verdict).of(solution.provenance.as_ref());
        match (self, solution.table.is_some()) {
            (Self::Json, _) => write_json(solution, out),
            (Self::Svg, _) => write_svg(solution, label, out),
            (Self::Csv, true) => write_members(solution, MembersForm::Csv, out),
            (Self::Lines, true) => write_members(solution, MembersForm::Lines, out),
            (Self::Arrow, true) => write_members(solution, MembersForm::Arrow, out),
            (Self::Csv, false) => write_table(&mut Csv, &solution.trajectory, out),
            (Self::Lines, false) => write_table(&mut Lines, &solution.trajectory, out),
            #[cfg(feature = "parquet")]
            (Self::Parquet, true) => write_members(solution, MembersForm::Parquet, out),
            #[cfg(feature = "parquet")]
            (Self::Parquet, false) => write_table(&mut Parquet::like(arrow()), &solution.trajectory, out),
            (Self::Arrow, false) => write_table(&mut arrow(), &solution.trajectory, out),
        }
    }
}
