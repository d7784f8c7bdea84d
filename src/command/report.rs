//! `dvi report`: every system of the theory at a ladder of tolerances and steps, as one HTML page with its tables.

use super::{UNWRITABLE, USAGE};
use clap::Args;
use dvi::specification::{EXAMPLES, Example};
use dvi::study::html;
use dvi::study::report::{Chapter, chapter};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Run every system of the theory and report error against run time
///
/// Writes report.html, which needs nothing else, and a JSON and a CSV file for each system.
/// A report that was interrupted goes on where it stopped: what has its JSON file is not run again.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
pub struct Arguments {
    /// Where to write
    #[arg(long, default_value = "report")]
    out: PathBuf,

    /// Run this system alone; may be given again
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,

    /// Run again what has been run before
    #[arg(long)]
    fresh: bool,
}

const HELP: &str = "\
Examples:
  dvi report
  dvi report --only friction_belt --only relay --out belt";

/// Runs and writes; progress goes to standard error.
pub fn run(arguments: &Arguments) -> ExitCode {
    let examples: Vec<&Example> = EXAMPLES
        .iter()
        .filter(|example| arguments.only.is_empty() || arguments.only.iter().any(|name| name == example.name))
        .collect();
    if let Some(unknown) = arguments.only.iter().find(|name| EXAMPLES.iter().all(|example| example.name != *name)) {
        let names: Vec<&str> = EXAMPLES.iter().map(|example| example.name).collect();
        eprintln!("dvi: no system is called `{unknown}`; there are {}", names.join(", "));
        return ExitCode::from(USAGE);
    }
    match report(&examples, &arguments.out, arguments.fresh) {
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

fn report(examples: &[&Example], out: &Path, fresh: bool) -> io::Result<PathBuf> {
    fs::create_dir_all(out)?;
    let mut chapters = Vec::with_capacity(examples.len());
    for (k, example) in examples.iter().enumerate() {
        eprintln!("[{:>2}/{}] {}", k + 1, examples.len(), example.name);
        let file = out.join(format!("{}.json", example.name));
        let known = (!fresh).then(|| fs::read(&file).ok()).flatten();
        let known = known.and_then(|text| serde_json::from_slice::<Chapter>(&text).ok());
        let Some(chapter) = known.or_else(|| chapter(example)) else { continue };
        fs::write(&file, serde_json::to_vec_pretty(&chapter)?)?;
        fs::write(out.join(format!("{}.csv", example.name)), chapter.csv())?;
        chapters.push(chapter);
    }
    let page = out.join("report.html");
    fs::write(&page, html(&chapters))?;
    Ok(page)
}
