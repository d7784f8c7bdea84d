//! `dvi explain`: the meaning of the code of an error, a warning, a verdict or a refused request, and the remedy.

use super::USAGE;
use clap::Args;
use dvi::explanation::{Kind, Page, find, pages};
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::process::ExitCode;

/// Explain the code of an error, a warning, a verdict or a refused request
///
/// Without a code, list all codes.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
pub struct Arguments {
    /// The code, as in brackets after an error message, or under `code` in JSON
    code: Option<String>,
}

const HELP: &str = "\
Examples:
  dvi explain                  list all codes
  dvi explain unknown_key
  dvi explain queue-full       the last part of the `type` of a problem

Exit codes:
  0   done
  64  the code does not exist";

/// Runs `dvi explain`: prints the explanation; a closed standard output is ignored.
pub fn run(arguments: &Arguments) -> ExitCode {
    let text = match &arguments.code {
        None => list(),
        Some(code) => match find(code) {
            Some(page) => explained(page),
            None => {
                eprintln!("dvi: there is no code `{code}`: `dvi explain` lists all codes");
                return ExitCode::from(USAGE);
            }
        },
    };
    let _ = io::stdout().write_all(text.as_bytes());
    ExitCode::SUCCESS
}

fn explained(page: &Page) -> String {
    let Page { code, meaning, why, remedy, example, .. } = page;
    format!("{code}: {meaning}\n\nWhy:         {why}\nWhat to do:  {remedy}\nExample:     {example}\n")
}

fn list() -> String {
    let mut text = String::new();
    for (k, kind) in Kind::ALL.into_iter().enumerate() {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{}{}", if k > 0 { "\n" } else { "" }, kind.title());
        for Page { code, meaning, .. } in pages().iter().filter(|page| page.kind == kind) {
            let _ = writeln!(text, "  {code:<27} {meaning}");
        }
    }
    text
}
