//! Other programs that solve the same systems: each Python file of a folder is one. Called with `--name`, a program
//! prints its name, or fails if it cannot run; otherwise it reads `{"system", "exact", "tolerances"}` as JSON from
//! standard input and prints the measured series, in the form of the report.

use dvi::solution::Series;
use dvi::study::report::{TOLERANCES, exact_end};
use serde_json::json;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const PYTHON: &str = "python3";

/// The programs that can run.
#[derive(Default)]
pub struct Peers {
    found: Vec<(PathBuf, String)>,
}

impl Peers {
    /// The programs of a folder; none if the folder does not exist.
    pub fn in_folder(folder: &Path) -> Self {
        let files = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let mut scripts: Vec<PathBuf> =
            files.filter(|path| path.extension().is_some_and(|extension| extension == "py")).collect();
        scripts.sort();
        let named = |script: PathBuf| {
            let told = Command::new(PYTHON).arg(&script).arg("--name").stderr(Stdio::null()).output().ok()?;
            let name = String::from_utf8_lossy(&told.stdout).trim().to_owned();
            (told.status.success() && !name.is_empty()).then_some((script, name))
        };
        Self { found: scripts.into_iter().filter_map(named).collect() }
    }

    /// The names of the programs, for people.
    pub fn names(&self) -> String {
        let names: Vec<&str> = self.found.iter().map(|(_, name)| name.as_str()).collect();
        if names.is_empty() { "not found".to_owned() } else { names.join(", ") }
    }

    /// The series that the programs measure for a system; none from programs that do not have the system.
    pub fn solve(&self, system: &str) -> Vec<Series> {
        let Some(exact) = exact_end(system) else { return Vec::new() };
        let request = json!({"system": system, "exact": exact, "tolerances": TOLERANCES}).to_string();
        self.found.iter().flat_map(|(script, _)| ask(script, &request).unwrap_or_default()).collect()
    }
}

fn ask(script: &Path, request: &str) -> Option<Vec<Series>> {
    let mut command = Command::new(PYTHON);
    command.arg(script).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut process = command.spawn().ok()?;
    // Drop the input at once, so that the program reads its end.
    let sent = process.stdin.take().map(|mut input| input.write_all(request.as_bytes()));
    let told = process.wait_with_output().ok()?;
    sent?.ok()?;
    serde_json::from_slice(&told.stdout).ok()
}
