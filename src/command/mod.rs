//! Code shared by the subcommands: exit codes, and the reading of specifications with reports of their errors.

pub mod check;
pub mod completions;
mod confined;
pub mod data;
pub mod explain;
pub mod healthcheck;
pub mod man;
pub mod merge;
pub mod methods;
mod peers;
mod progress;
mod remote;
pub mod report;
mod result;
pub mod serve;
mod several;
pub mod solve;
mod spans;
pub mod store;
pub mod sweep;
mod tls;
pub mod token;
pub mod usage;
mod verdict;
pub mod worker;

use dvi::specification::{Specification, SpecificationError, document_of, edited};
use serde::Deserialize;
use std::fmt::Write as _;
use std::io::{self, Read};
use std::path::Path;
use std::process::ExitCode;

/// Exit code: a solve did not reach the end time.
pub const UNFINISHED: u8 = 1;
/// Exit code: the service is not alive.
pub const UNHEALTHY: u8 = 1;
/// Exit code: the specification has errors.
pub const BAD_SPECIFICATION: u8 = 2;
/// Exit code: the file of the specification could not be read.
pub const UNREADABLE: u8 = 3;
/// Exit code: the file of the result could not be written.
pub const UNWRITABLE: u8 = 4;
/// Exit code: the service could not start.
pub const UNSERVABLE: u8 = 5;
/// Exit code: a server did not answer, or refused the request.
pub const UNANSWERED: u8 = 6;
/// Exit code: a solve reached the end time, but its verdict does not trust the solution.
pub const UNTRUSTED: u8 = 7;
/// Exit code: the child process that solved was killed, for instance for want of memory.
pub const ENDED: u8 = 8;
/// Exit code: the command line is invalid (`EX_USAGE` of sysexits).
pub const USAGE: u8 = 64;

/// An error of a specification, found by this program or by a server.
#[derive(Deserialize)]
pub struct Told {
    pointer: String,
    code: String,
    detail: String,
    expected: Option<String>,
    did_you_mean: Option<String>,
}

impl From<SpecificationError> for Told {
    fn from(error: SpecificationError) -> Self {
        let SpecificationError { pointer, code, detail, expected, did_you_mean } = error;
        Self { pointer, code: code.to_owned(), detail, expected, did_you_mean }
    }
}

/// Reads and checks the specification in a file, or on standard input if the name is `-`. Errors are printed to
/// standard error.
pub fn read(file: &Path) -> Result<Specification, ExitCode> {
    read_text(file, &bytes(file)?)
}

/// Checks the text of a specification that was read from `file`. Errors are printed to standard error.
pub fn read_text(file: &Path, text: &[u8]) -> Result<Specification, ExitCode> {
    Specification::from_json(text).map_err(|errors| told(file, errors))
}

/// Sets some numbers of a specification, given by their names with new values, as `--set` does. Errors are printed to
/// standard error.
pub fn with_settings(file: &Path, text: Vec<u8>, settings: &[(String, String)]) -> Result<Vec<u8>, ExitCode> {
    if settings.is_empty() {
        return Ok(text);
    }
    edited(&text, settings).map_err(|errors| told(file, errors))
}

/// Parses an argument NAME=VALUE of `--set`.
pub fn setting(text: &str) -> Result<(String, String), String> {
    // Split at the first equals sign: a value that is a condition may contain another.
    let (name, value) = text.split_once('=').ok_or("write NAME=VALUE, such as m=2 or /method/rtol=1e-9")?;
    Ok((name.trim().to_owned(), value.trim().to_owned()))
}

fn told(file: &Path, errors: Vec<SpecificationError>) -> ExitCode {
    let errors: Vec<Told> = errors.into_iter().map(Told::from).collect();
    eprint!("{}", report(file, &errors));
    ExitCode::from(BAD_SPECIFICATION)
}

/// Reads the specification from a file, or from standard input if the name is `-`; a SPICE deck is converted.
pub fn bytes(file: &Path) -> Result<Vec<u8>, ExitCode> {
    bytes_of(file).map_err(|error| {
        eprintln!("dvi: cannot read {}: {error}", file.display());
        ExitCode::from(UNREADABLE)
    })
}

fn bytes_of(file: &Path) -> io::Result<Vec<u8>> {
    if file == Path::new("-") {
        let mut text = Vec::new();
        io::stdin().lock().read_to_end(&mut text)?;
        return Ok(document_of(&text).into_owned());
    }
    std::fs::read(file).map(|text| document_of(&text).into_owned())
}

/// Formats the errors of a specification for people: one paragraph per error, which begins with the JSON pointer.
fn report(file: &Path, errors: &[Told]) -> String {
    let count = if errors.len() == 1 { "1 error".to_owned() } else { format!("{} errors", errors.len()) };
    let mut text = format!("{}: {count}\n", file.display());
    for error in errors {
        let place = if error.pointer.is_empty() { "(the whole document)" } else { &error.pointer };
        let detail = error.detail.replace('\n', "\n    ");
        // Writing to a string cannot fail.
        let _ = writeln!(text, "\n  {place}: {} [{}]", detail, error.code);
        if let Some(expected) = &error.expected {
            let _ = writeln!(text, "    expected: {expected}");
        }
        if let Some(name) = &error.did_you_mean {
            let _ = writeln!(text, "    did you mean {name}?");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_error_is_told_with_its_place_and_its_remedy() {
        let errors = [
            SpecificationError {
                pointer: "/problem/dvi/sates".to_owned(),
                code: "unknown_key",
                detail: "unknown key sates".to_owned(),
                expected: Some("states, variables or set".to_owned()),
                did_you_mean: Some("states".to_owned()),
            },
            SpecificationError {
                pointer: String::new(),
                code: "syntax",
                detail: "x + * y\n    ^".to_owned(),
                expected: None,
                did_you_mean: None,
            },
        ];
        let told = "\
spring.json: 2 errors

  /problem/dvi/sates: unknown key sates [unknown_key]
    expected: states, variables or set
    did you mean states?

  (the whole document): x + * y
        ^ [syntax]
";
        assert_eq!(report(Path::new("spring.json"), &errors.map(Told::from)), told);
    }
}
