//! `dvi check`: every error of a specification, without solving it.

use super::read;
use clap::Args;
use dvi::specification::Specification;
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
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
            // A closed standard output wants no answer.
            let _ = write!(io::stdout(), "{}", summary(&arguments.file, &specification));
            ExitCode::SUCCESS
        }
        Err(code) => code,
    }
}

/// What a correct specification comes to: its sizes, then what its author should know.
fn summary(file: &Path, specification: &Specification) -> String {
    let model = specification.model();
    let structure = model.structure();
    let label = specification.label().map(|label| format!(" ({label})")).unwrap_or_default();
    let time = specification.time();
    let mut text = format!("{}: correct{label}\n", file.display());
    // Writing to a string does not fail.
    let _ = writeln!(text, "  states          {}", structure.states);
    let _ = writeln!(text, "  variables       {}", structure.variables);
    let _ = writeln!(text, "  moving bounds   {}", structure.moving.len());
    let _ = writeln!(
        text,
        "  Jacobian        {} nonzeros{}",
        structure.pattern.len(),
        constancy(structure.constant_jacobian)
    );
    let _ = writeln!(text, "  time            {} to {}", time.start, time.end);
    for warning in &model.warnings {
        let _ = writeln!(text, "\n  warning: {} [{}]", warning.message, warning.code);
    }
    text
}

fn constancy(constant: bool) -> &'static str {
    if constant { ", constant" } else { "" }
}
