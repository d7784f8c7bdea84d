//! A whole answer in any of its forms, of a run or of a sweep.

#[cfg(feature = "parquet")]
use super::Parquet;
use super::{Arrow, Csv, Lines, MembersForm, write_json, write_members, write_table};
use crate::Solution;
use crate::pictures::write_svg;
use std::io::{self, Write};

/// A form of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// Everything; the columns as arrays.
    Json,
    /// A row a time, or a member of a sweep.
    Csv,
    /// An object a time, or a member of a sweep, each on a line.
    Lines,
    /// An Arrow stream.
    Arrow,
    /// A file of Parquet.
    #[cfg(feature = "parquet")]
    Parquet,
    /// A picture.
    Svg,
}

impl Form {
    /// The form that files with this extension have.
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

    /// Writes an answer; a picture has its label.
    ///
    /// # Errors
    /// Those of `out`.
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
