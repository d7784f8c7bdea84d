//! The forms of a result, and where it goes.

use super::USAGE;
use clap::ValueEnum;
use dvi::solution::encodings::{self, MembersForm, write_members};
use dvi::solution::{Solution, pictures};
use std::ffi::OsStr;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::process::ExitCode;

/// A form of the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// Verdict, trajectory, events and diagnostics; of a sweep the table in columns
    Json,
    /// The trajectory as a table; of a sweep, one row per member
    Csv,
    /// The trajectory as JSON lines, one object per time; of a sweep, one object per member
    Ndjson,
    /// The trajectory, or the table of a sweep, as an Arrow stream
    Arrow,
    /// The trajectory, or the table of a sweep, as a picture
    Svg,
}

impl Format {
    /// The one that was asked for, or that of a file by its extension; JSON, where neither says.
    pub fn of(asked: Option<Self>, file: Option<&Path>) -> Result<Self, ExitCode> {
        let extension = file.and_then(Path::extension).and_then(OsStr::to_str);
        match (asked, extension) {
            (Some(format), _) => Ok(format),
            (None, None | Some("json")) => Ok(Self::Json),
            (None, Some("csv")) => Ok(Self::Csv),
            (None, Some("ndjson" | "jsonl")) => Ok(Self::Ndjson),
            (None, Some("arrow" | "arrows")) => Ok(Self::Arrow),
            (None, Some("svg")) => Ok(Self::Svg),
            (None, Some(other)) => {
                eprintln!(
                    "dvi: .{other} is not the extension of a result format: use .json, .csv, .ndjson, .arrow or .svg, \
                     or --format"
                );
                Err(ExitCode::from(USAGE))
            }
        }
    }

    /// The end of the name of a file that has it.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Json => "json",
            Self::Csv => "csv",
            Self::Ndjson => "ndjson",
            Self::Arrow => "arrow",
            Self::Svg => "svg",
        }
    }

    /// Its media type.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Json => "application/json",
            Self::Csv => "text/csv",
            Self::Ndjson => "application/x-ndjson",
            Self::Arrow => "application/vnd.apache.arrow.stream",
            Self::Svg => "image/svg+xml",
        }
    }
}

/// The file that a result goes to, or standard output.
pub fn destination(file: Option<&Path>) -> io::Result<BufWriter<Box<dyn Write>>> {
    let out: Box<dyn Write> = match file.filter(|file| *file != Path::new("-")) {
        Some(file) => Box::new(File::create(file)?),
        None => Box::new(io::stdout().lock()),
    };
    Ok(BufWriter::new(out))
}

/// Writes a result.
pub fn write(solution: &Solution, label: Option<&str>, format: Format, out: &mut impl Write) -> io::Result<()> {
    let is_sweep = solution.table.is_some();
    match format {
        Format::Json => {
            encodings::write_json(solution, out)?;
            out.write_all(b"\n")?;
        }
        Format::Csv if is_sweep => write_members(solution, MembersForm::Csv, out)?,
        Format::Ndjson if is_sweep => write_members(solution, MembersForm::Lines, out)?,
        Format::Arrow if is_sweep => write_members(solution, MembersForm::Arrow, out)?,
        Format::Csv => encodings::write_table(&mut encodings::Csv, &solution.trajectory, out)?,
        Format::Ndjson => encodings::write_table(&mut encodings::Lines, &solution.trajectory, out)?,
        Format::Arrow => {
            let mut table = encodings::Arrow::with(&solution.verdict).of(solution.provenance.as_ref());
            encodings::write_table(&mut table, &solution.trajectory, out)?;
        }
        Format::Svg => pictures::write_svg(solution, label, out)?,
    }
    out.flush()
}
