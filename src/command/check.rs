//! `dvi check`: reports every error of a specification, without solving it.

use super::read;
use clap::Args;
use dvi::specification::Specification;
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Check a specification without solving it
///
/// All errors are listed at once, each with the JSON pointer of its place.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
pub struct Arguments {
    /// The specification, a JSON file; - is standard input
    file: PathBuf,
}

const HELP: &str = "\
Exit codes:
  0   the specification has no errors
  2   the specification has errors
  3   the specification could not be read
  64  the command line is invalid

Examples:
  dvi check spring.json
  for f in *.json; do dvi check \"$f\" || echo \"$f\"; done";

/// Runs `dvi check`: checks the file and prints a summary or the errors; returns the exit code.
pub fn run(arguments: &Arguments) -> ExitCode {
    match read(&arguments.file) {
        Ok(specification) => {
            // A write error on a closed standard output is ignored.
            let _ = write!(io::stdout(), "{}", told(&arguments.file, &specification));
            ExitCode::SUCCESS
        }
        Err(code) => code,
    }
}

/// Returns the summary of a correct specification: its sizes, the results of the analysis, and warnings.
fn told(file: &Path, specification: &Specification) -> String {
    let summary = specification.summary();
    let analysis = &summary.analysis;
    let label = summary.label.map(|label| format!(" ({label})")).unwrap_or_default();
    let time = specification.time();
    let constancy = if summary.constant_jacobian { ", constant" } else { "" };
    let index = match (analysis.index, analysis.levels.iter().filter(|&&level| level > 0).count()) {
        (None, _) => "none".to_owned(),
        (Some(index), 0 | 1) => index.to_string(),
        (Some(index), _) => format!("{index}, mixed: {:?} variables by differentiation", analysis.levels),
    };
    let mut text = format!("{}: correct{label}\n", file.display());
    // Writing to a string cannot fail.
    let _ = writeln!(text, "  states          {}", summary.states);
    let _ = writeln!(text, "  variables       {}", summary.variables);
    let _ = writeln!(text, "  moving bounds   {}", summary.moving_bounds);
    let _ = writeln!(text, "  Jacobian        {} nonzeros{constancy}", summary.jacobian_nonzeros);
    let _ = writeln!(text, "  time            {:?} to {:?}", time.start, time.end);
    if summary.variables > 0 {
        let _ = writeln!(text, "  index           {index}");
    }
    let _ = writeln!(text, "  uniqueness      {}", analysis.uniqueness);
    let _ = writeln!(text, "  because         {}", analysis.because);
    let _ = writeln!(text, "  method          {} with {}", summary.method, summary.built.join(", "));
    for part in &summary.left_out {
        let _ = writeln!(text, "  left out        {part}");
    }
    for warning in &summary.warnings {
        let _ = writeln!(text, "\n  warning: {} [{}]", warning.message, warning.code);
    }
    text
}
