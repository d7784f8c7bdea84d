//! Other programs that solve the example systems: each file `*_peer.py` of a folder is one. Called with `--name`, a
//! program prints the name and version of the software that it runs, or fails if the software is not installed; with
//! `--install`, it prints the name and how to install the software, on a line each. Otherwise it reads a request as
//! JSON from standard input and prints its answers (`dvi::study::report::Answer`).

use dvi::study::Peer;
use dvi::study::report::{Answer, Chapter, Ladder, request};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Returns the Python interpreters with which a program is tried, in order: that of the virtual environment in the
/// folder, which `tests/peers/install` makes; that of the user; and that of the system, for which distributions
/// package modules.
fn interpreters(folder: &Path) -> [PathBuf; 3] {
    [folder.join("venv/bin/python3"), PathBuf::from("python3"), PathBuf::from("/usr/bin/python3")]
}

/// Environment variables that limit the threads of the linear algebra libraries that the compared programs use.
const THREADS: [&str; 3] = ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"];

/// The programs in a folder that solve the example systems with other software.
#[derive(Default)]
pub struct Peers {
    /// The compared programs whose software is installed: Python interpreter and script of each.
    found: Vec<(PathBuf, PathBuf)>,
    all: Vec<Peer>,
}

impl Peers {
    /// Finds the programs in a folder that solve the example systems with other software; none if the folder does not
    /// exist.
    pub fn in_folder(folder: &Path) -> Self {
        let files = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let mut scripts: Vec<PathBuf> = files.filter(|path| path.to_string_lossy().ends_with("_peer.py")).collect();
        scripts.sort();
        let mut peers = Self::default();
        for script in scripts {
            let mut programs = interpreters(folder).into_iter();
            match programs.find_map(|program| Some((said(&program, &script, "--name")?, program))) {
                Some((name, program)) => {
                    peers.all.push(Peer { name, install: None });
                    peers.found.push((program, script));
                }
                None => peers.all.extend(missing(folder, &script)),
            }
        }
        peers
    }

    /// All programs that solve the example systems with other software, including those that are not installed.
    pub fn all(&self) -> &[Peer] {
        &self.all
    }

    /// Has every program solve the system of a chapter of the report. Returns a ladder (series of runs of one method,
    /// from coarse to fine) for each answer; programs without the system have no answer.
    pub fn solve(&self, chapter: &Chapter) -> Vec<Ladder> {
        let request = request(chapter).to_string();
        let answers = self.found.iter().flat_map(|(program, script)| ask(program, script, &request));
        answers.map(|answer| answer.ladder(chapter)).collect()
    }
}

/// Returns the name of a compared program whose software is not installed, and how to install it.
fn missing(folder: &Path, script: &Path) -> Option<Peer> {
    let told = interpreters(folder).iter().find_map(|program| said(program, script, "--install"))?;
    let (name, install) = told.split_once('\n')?;
    Some(Peer { name: name.to_owned(), install: Some(install.trim().to_owned()) })
}

/// Returns the output of a compared program that is called with an option; `None` if the program fails.
fn said(program: &Path, script: &Path, option: &str) -> Option<String> {
    let told = Command::new(program).arg(script).arg(option).stderr(Stdio::null()).output().ok()?;
    let text = String::from_utf8_lossy(&told.stdout).trim().to_owned();
    (told.status.success() && !text.is_empty()).then_some(text)
}

/// Returns the answers of another program to the request to solve an example system. Its standard error is passed on,
/// so that a failing program is noticed.
fn ask(program: &Path, script: &Path, request: &str) -> Vec<Answer> {
    let answers = || {
        let mut command = Command::new(program);
        command.arg(script).stdin(Stdio::piped()).stdout(Stdio::piped());
        // Give another program one thread, like the runs of this program that it is compared with.
        command.envs(THREADS.map(|name| (name, "1")));
        let mut process = command.spawn().ok()?;
        // Close the standard input of the other program once the request has been written, so that it reads the end of
        // its input.
        let sent = process.stdin.take().map(|mut input| input.write_all(request.as_bytes()));
        let told = process.wait_with_output().ok()?;
        sent?.ok()?;
        serde_json::from_slice(&told.stdout).ok()
    };
    answers().unwrap_or_else(|| {
        eprintln!("dvi: {} gave no answer", script.display());
        Vec::new()
    })
}
