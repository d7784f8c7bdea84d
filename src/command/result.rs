//! Formats of a result, and where a result is written.

use super::USAGE;
use clap::ValueEnum;
use dvi::solution::Solution;
use dvi::solution::encodings::Form;
use std::ffi::OsStr;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::process::ExitCode;

/// A format of the result.
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
    /// The trajectory, or the table of a sweep, as a file of Parquet
    #[cfg(feature = "parquet")]
    Parquet,
    /// The trajectory, or the table of a sweep, as a picture
    Svg,
}

impl Format {
    /// Returns the requested format of a result, or that of a file by its extension; JSON if neither is given.
    pub fn of(asked: Option<Self>, file: Option<&Path>) -> Result<Self, ExitCode> {
        let extension = file.and_then(Path::extension).and_then(OsStr::to_str);
        let Some(extension) = extension.filter(|_| asked.is_none()) else { return Ok(asked.unwrap_or(Self::Json)) };
        match Form::of_extension(extension) {
            Some(Form::Json) => Ok(Self::Json),
            Some(Form::Csv) => Ok(Self::Csv),
            Some(Form::Lines) => Ok(Self::Ndjson),
            Some(Form::Arrow) => Ok(Self::Arrow),
            #[cfg(feature = "parquet")]
            Some(Form::Parquet) => Ok(Self::Parquet),
            Some(Form::Svg) => Ok(Self::Svg),
            #[cfg(not(feature = "parquet"))]
            None if extension == "parquet" => {
                eprintln!(
                    "dvi: this program was built without the feature `parquet`: build it with `cargo build --release \
                     --features parquet`, or use .arrow"
                );
                Err(ExitCode::from(USAGE))
            }
            None => {
                eprintln!(
                    "dvi: .{extension} is not the extension of a result format: use .json, .csv, .ndjson, .arrow or .svg, \
                     or --format"
                );
                Err(ExitCode::from(USAGE))
            }
        }
    }

    fn form(self) -> Form {
        match self {
            Self::Json => Form::Json,
            Self::Csv => Form::Csv,
            Self::Ndjson => Form::Lines,
            Self::Arrow => Form::Arrow,
            #[cfg(feature = "parquet")]
            Self::Parquet => Form::Parquet,
            Self::Svg => Form::Svg,
        }
    }

    /// Returns the extension of files in this format of a result.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Json => "json",
            Self::Csv => "csv",
            Self::Ndjson => "ndjson",
            Self::Arrow => "arrow",
            #[cfg(feature = "parquet")]
            Self::Parquet => "parquet",
            Self::Svg => "svg",
        }
    }

    /// Returns the media type of this format of a result.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Json => "application/json",
            Self::Csv => "text/csv",
            Self::Ndjson => "application/x-ndjson",
            Self::Arrow => "application/vnd.apache.arrow.stream",
            #[cfg(feature = "parquet")]
            Self::Parquet => "application/vnd.apache.parquet",
            Self::Svg => "image/svg+xml",
        }
    }
}

/// Opens the file that a result is written to, or standard output.
pub fn destination(file: Option<&Path>) -> io::Result<BufWriter<Box<dyn Write>>> {
    let out: Box<dyn Write> = match file.filter(|file| *file != Path::new("-")) {
        Some(file) => Box::new(File::create(file)?),
        None => Box::new(io::stdout().lock()),
    };
    Ok(BufWriter::new(out))
}

/// Writes a result in the given format.
pub fn write(solution: &Solution, label: Option<&str>, format: Format, out: &mut impl Write) -> io::Result<()> {
    format.form().write(solution, label, out)?;
    if format == Format::Json {
        out.write_all(b"\n")?;
    }
    out.flush()
}
