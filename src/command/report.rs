//! `dvi report`: error and run time of every example system over a range of tolerances and step sizes, and stability at
//! the limits, as one HTML page with its tables.

use super::UNWRITABLE;
use super::peers::Peers;
use super::progress::Progress;
use clap::Args;
use clap::builder::PossibleValuesParser;
use dvi::specification::{EXAMPLES, Example};
use dvi::study::html;
use dvi::study::report::{Chapter, chapter, picture};
use dvi::study::stability::{Stability, parts};
use jiff::Timestamp;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Run all example systems and report error against run time, and the stability tests
///
/// Writes the self-contained report.html, its main picture report.svg, and a JSON and a CSV file for each system and
/// for the stability table.
/// An interrupted report continues where it stopped: a system with a JSON file is not run again.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
pub struct Arguments {
    /// The folder to write to
    #[arg(long, default_value = "report")]
    out: PathBuf,

    /// Run only this system; may be repeated
    #[arg(long, value_name = "NAME", value_parser = names(), hide_possible_values = true)]
    only: Vec<String>,

    /// Run only the stability chapter
    #[arg(long, conflicts_with = "only")]
    stability: bool,

    /// Python programs that run the same systems, and whose points join the plots (`tests/peers/install` installs them)
    #[arg(long, value_name = "DIR", default_value = "tests/peers")]
    peers: PathBuf,

    /// Run all systems again, also those with a JSON file
    #[arg(long)]
    fresh: bool,

    /// Leave out run times, machine and date: figures show error against steps, and do not depend on the machine
    #[arg(long)]
    fixed: bool,
}

const HELP: &str = "\
Examples:
  dvi report
  dvi report --stability
  dvi report --only friction_belt --only relay --out belt";

/// Number of progress steps of the stability chapter besides one for each part of its table: stability functions,
/// contraction, energies.
const MEASUREMENTS: usize = 3;

/// Returns the parser of the names of example systems, which suggests the nearest name for an unknown one.
fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(EXAMPLES.iter().map(|example| example.name))
}

/// Runs the examples and writes the report, with progress on standard error; returns the exit code.
pub fn run(arguments: &Arguments) -> ExitCode {
    let wanted = |name: &str| arguments.only.is_empty() || arguments.only.iter().any(|only| only == name);
    let examples: Vec<&Example> =
        EXAMPLES.iter().filter(|example| !arguments.stability && wanted(example.name)).collect();
    match report(&examples, arguments) {
        Ok(page) => {
            println!("{}", page.display());
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("dvi: cannot write to {}: {error}", arguments.out.display());
            ExitCode::from(UNWRITABLE)
        }
    }
}

fn report(examples: &[&Example], arguments: &Arguments) -> io::Result<PathBuf> {
    let Arguments { out, only, fresh, fixed, .. } = arguments;
    let peers = if examples.is_empty() { Peers::default() } else { Peers::in_folder(&arguments.peers) };
    fs::create_dir_all(out)?;
    let with_limits = only.is_empty();
    let limits_steps = if with_limits { parts().count() + MEASUREMENTS } else { 0 };
    let mut progress = Progress::new(examples.len() + limits_steps);
    let mut chapters = Vec::with_capacity(examples.len());
    for example in examples {
        progress.next(example.name);
        let found = kept(out, example.name, *fresh, || {
            let mut chapter: Chapter = chapter(example, &today())?;
            if !chapter.is_exact_for_all() {
                chapter.peers = peers.solve(&chapter);
            }
            Some(chapter)
        })?;
        if let Some(chapter) = found {
            fs::write(out.join(format!("{}.csv", example.name)), chapter.csv())?;
            chapters.push(chapter);
        }
    }
    let mut limits: Option<Stability> = None;
    if with_limits {
        let measure =
            || Some(Stability::measure(|part| progress.next(&format!("stability: {}", part.replace('_', " ")))));
        limits = kept(out, "stability", *fresh, measure)?;
        fs::write(out.join("stability.csv"), limits.as_ref().map(Stability::csv).unwrap_or_default())?;
    }
    progress.end();
    if !chapters.is_empty() {
        fs::write(out.join("report.svg"), picture(&chapters, *fixed))?;
    }
    let page = out.join("report.html");
    fs::write(&page, html(&chapters, limits.as_ref(), peers.all(), *fixed))?;
    Ok(page)
}

/// Returns the present day, in UTC, as the date of the report.
fn today() -> String {
    Timestamp::now().strftime("%Y-%m-%d").to_string()
}

/// Returns the contents of the JSON file `name` that an earlier run has left in the folder `out`, or else a new
/// measurement, which is written to that file.
fn kept<T: Serialize + DeserializeOwned>(
    out: &Path,
    name: &str,
    fresh: bool,
    measure: impl FnOnce() -> Option<T>,
) -> io::Result<Option<T>> {
    let file = out.join(format!("{name}.json"));
    let known = (!fresh).then(|| fs::read(&file).ok()).flatten();
    if let Some(known) = known.and_then(|text| serde_json::from_slice(&text).ok()) {
        return Ok(Some(known));
    }
    let found = measure();
    if let Some(found) = &found {
        // Write the measurement under another name, and then rename the file, so that it is complete after an
        // interruption, too.
        let part = out.join(format!("{name}.json.part"));
        fs::write(&part, serde_json::to_vec_pretty(found)?)?;
        fs::rename(&part, &file)?;
    }
    Ok(found)
}
