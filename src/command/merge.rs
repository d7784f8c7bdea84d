//! `dvi merge`: the parts of a sweep joined to one table.

use super::result::{Format, destination, write};
use super::solve::exit_code;
use super::{BAD_SPECIFICATION, UNREADABLE, bytes, verdict};
use clap::Args;
use dvi::solution::{Table, encodings};
use dvi::study;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Join the parts of a sweep
///
/// The parts are JSON files, as `dvi sweep --shard K/N -o part.json` writes them, in any order.
/// Parts are refused that differ in the specification, the program version or the instruction set of the machine.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
pub struct Arguments {
    /// The JSON files of the parts
    #[arg(required = true)]
    parts: Vec<PathBuf>,

    /// Write the table to this file instead of standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,

    /// The format of the table; by default that of the file extension, or JSON
    #[arg(long, value_enum)]
    format: Option<Format>,
}

const HELP: &str = "\
Exit codes:
  0   all members are in the table, and those that reached their end are trusted
  1   parts are missing; the rows of the others were written
  2   the parts are not of one sweep
  3   a part could not be read
  4   the table could not be written
  7   all members are in the table, but some that reached their end are not trusted
  64  the command line is invalid

Example:
  dvi merge -o belts.csv part1.json part2.json part3.json part4.json";

/// Runs `dvi merge`: reads the parts, joins them and writes the table; returns the exit code.
pub fn run(arguments: &Arguments) -> ExitCode {
    let format = match Format::of(arguments.format, arguments.output.as_deref()) {
        Ok(format) => format,
        Err(code) => return code,
    };
    let tables: Result<Vec<Table>, ExitCode> = arguments.parts.iter().map(|part| table(part)).collect();
    let merged = match tables.map(study::merge) {
        Ok(Ok(merged)) => merged,
        Ok(Err(why)) => {
            eprintln!("dvi: {why}");
            return ExitCode::from(BAD_SPECIFICATION);
        }
        Err(code) => return code,
    };
    if let Some(error) = &merged.error {
        eprintln!("dvi: {}: {}", error.code, error.message);
    }
    eprint!("{}", verdict::lines(&merged.verdict));
    let written = destination(arguments.output.as_deref()).and_then(|mut out| write(&merged, None, format, &mut out));
    exit_code(written, merged.status, &merged.verdict)
}

fn table(part: &Path) -> Result<Table, ExitCode> {
    let refuse = |why: &str| {
        eprintln!("dvi: {}: {why}", part.display());
        ExitCode::from(UNREADABLE)
    };
    let solution =
        encodings::read_json(&bytes(part)?).map_err(|error| refuse(&format!("not the result of a sweep: {error}")))?;
    solution.table.ok_or_else(|| refuse("not the result of a sweep: there is no `table`"))
}
