//! `dvi sweep`: solves all members of a sweep, or a part of the members, on all cores of this machine.

use super::result::{Format, destination, write};
use super::solve::{exit_code, on_interrupt, threads, with_progress};
use super::{USAGE, bytes, read_text, setting, verdict, with_settings};
use clap::Args;
use dvi::study::sweep;
use std::num::NonZeroUsize;
use std::ops::Range;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

/// Solve a specification for many values of its parameters
///
/// `sweep` in the specification has the values, and selects the results of each run: a table with one row per member.
/// The members run on all cores. Ctrl-C stops the sweep; the rows that are done are written.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
pub struct Arguments {
    /// The specification, a JSON file; - is standard input
    file: PathBuf,

    /// Write the table to this file instead of standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,

    /// The format of the table; by default that of the file extension, or JSON
    #[arg(long, value_enum)]
    format: Option<Format>,

    /// Replace a number: a parameter (m=2), an initial value (x.initial=1), a component (R1=100), or any number by its
    /// JSON pointer (/sweep/seed=3)
    #[arg(long, value_name = "NAME=VALUE", value_parser = setting)]
    set: Vec<(String, String)>,

    /// Solve only part K of N of the members, such as 1/4; `dvi merge` joins the parts
    #[arg(long, value_name = "K/N", value_parser = shard)]
    shard: Option<Shard>,

    /// Threads that solve members; by default one per core
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
}

const HELP: &str = "\
Exit codes:
  0   all members are in the table, including those that failed, and those that reached their end are trusted
  1   the sweep was stopped; the rows that were done were written
  2   the specification has errors, listed on standard error with their JSON pointers
  3   the specification could not be read
  4   the table could not be written
  7   all members are in the table, but some that reached their end are not trusted
  64  the command line is invalid

Examples:
  dvi sweep belts.json > table.json
  dvi sweep --set k=2 -o belts.csv belts.json
  dvi sweep -o map.svg belts.json
  dvi sweep --shard 1/4 -o part1.json belts.json";

/// Part `number` of the members of a sweep, which are divided into `of` parts.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shard {
    number: usize,
    of: usize,
}

fn shard(text: &str) -> Result<Shard, String> {
    let numbers = text.split_once('/').and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
    match numbers {
        Some((number, of)) if (1..=of).contains(&number) => Ok(Shard { number, of }),
        _ => Err("write K/N with K from 1 to N, such as 1/4".to_owned()),
    }
}

impl Shard {
    /// Returns the indices of the members in this part, for a sweep with `all` members.
    fn members(self, all: usize) -> Range<usize> {
        let begin = |number: usize| (all as u128 * number as u128 / self.of as u128) as usize;
        begin(self.number - 1)..begin(self.number)
    }
}

/// Runs `dvi sweep`: solves the members and writes the table; returns the exit code.
pub fn run(arguments: &Arguments) -> ExitCode {
    let format = match Format::of(arguments.format, arguments.output.as_deref()) {
        Ok(format) => format,
        Err(code) => return code,
    };
    let file = &arguments.file;
    let text = bytes(file).and_then(|text| with_settings(file, text, &arguments.set));
    let specification = match text.and_then(|text| read_text(file, &text)) {
        Ok(specification) => specification,
        Err(code) => return code,
    };
    let Some(plan) = specification.sweep() else {
        eprintln!(
            "dvi: {} has no `sweep`: add one, such as \"sweep\": {{\"over\": {{\"m\": {{\"linspace\": [1, 2, 11]}}}}}}",
            file.display()
        );
        return ExitCode::from(USAGE);
    };
    let members = arguments.shard.map_or(0..plan.members(), |shard| shard.members(plan.members()));
    let control = Arc::new(specification.control());
    let interrupted = Arc::clone(&control);
    on_interrupt(move || interrupted.cancel());
    let threads = arguments.threads.unwrap_or_else(threads);
    let solution = with_progress(&control, || sweep(&specification, members, threads, &control));
    if let Some(error) = &solution.error {
        eprintln!("dvi: {}: {}", error.code, error.message);
    }
    eprint!("{}", verdict::lines(&solution.verdict));
    let out = destination(arguments.output.as_deref());
    let written = out.and_then(|mut out| write(&solution, specification.label(), format, &mut out));
    exit_code(written, solution.status, &solution.verdict)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_all_members_once() {
        for (all, of) in [(10, 3), (2, 5), (1_000_003, 7)] {
            let parts: Vec<Range<usize>> = (1..=of).map(|number| Shard { number, of }.members(all)).collect();
            assert!(parts[0].start == 0 && parts[of - 1].end == all);
            assert!(parts.windows(2).all(|pair| pair[0].end == pair[1].start));
        }
        assert_eq!(shard("2/4"), Ok(Shard { number: 2, of: 4 }));
        assert!(["0/4", "5/4", "1", "a/b", "1/0"].iter().all(|text| shard(text).is_err()));
    }
}
