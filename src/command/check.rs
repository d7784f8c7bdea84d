//! `dvi check`: every error of a specification, without solving it.

use super::read;
use clap::Args;
use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

/// Check a specification without solving it
///
/// All errors are told at once, each with the JSON pointer of its place.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
pub struct Arguments {
    /// The specification, a JSON file; - is standard input
    file: PathBuf,
}

const HELP: &str = "\
Exit codes:
  0   the specification is ready to be solved
  2   it has errors
  3   it could not be read
  64  the command line makes no sense

Examples:
  dvi check spring.json
  for f in *.json; do dvi check \"$f\" || echo \"$f\"; done";

/// Checks; the exit code says what was found.
pub fn run(arguments: &Arguments) -> ExitCode {
    match read(&arguments.file) {
        Ok(specification) => {
            let label = specification.label().unwrap_or("no label");
            // A closed standard output wants no answer.
            let _ = writeln!(io::stdout(), "{}: correct ({label})", arguments.file.display());
            ExitCode::SUCCESS
        }
        Err(code) => code,
    }
}
