//! Problems from outside the project, to which nothing was tuned, each with its correct solution
//! (`tests/reference/strangers`). Each is solved as it is and classified; those with wrong results are listed, and
//! the lists may only shrink. The most important list is [`SILENT`]: wrong results that the verdict trusts.

mod truth;

use crate::computing_time::{self, Ended};
use crate::known::{Failure, Known, assert_known};
use dvi::solution::Status;
use std::fs;
use std::path::Path;
use std::sync::{LazyLock, Mutex};
use std::thread;
use std::time::Duration;
use truth::Problem;

const FOLDER: &str = "tests/reference/strangers";

/// Factor by which the computing time of a run may exceed its limit, which holds for an optimised build on an
/// otherwise idle machine.
const PATIENCE: u32 = if cfg!(debug_assertions) { 4 } else { 2 };

/// Known failures of problems from outside the project, except wrong results that the verdict trusts.
const KNOWN: Known =
    &[("a9_steep_saturation", "failed"), ("block_by_long_steps", "wrong"), ("elastic_2d_hertz_slow", "stopped")];

/// Problems whose wrong results the verdict is known to trust.
const SILENT: Known = &[];

/// Problems whose right results the verdict is known not to trust.
const DOUBTED: Known = &[
    // Chain of 20 links on ball joints: its energies are right, but the positions of its light links are not accurate
    // to two digits, and a run with half the step size differs by more.
    ("chain20_ball_joints_explodes", "doubted"),
];

/// The outcome of the solve of a problem from outside the project.
struct Outcome {
    name: String,
    class: char,
    /// `right`, or a keyword for how the result is wrong.
    how: &'static str,
    detail: String,
    /// Whether the run has reached its end and its verdict trusts the result.
    trusted: bool,
}

impl Outcome {
    /// Whether the result of the problem is wrong although the verdict trusts it.
    fn is_silent(&self) -> bool {
        self.how == "wrong" && self.trusted
    }

    fn failure(&self) -> Failure {
        Failure { name: self.name.clone(), how: self.how, detail: self.detail.clone() }
    }
}

static OUTCOMES: LazyLock<Vec<Outcome>> = LazyLock::new(solve_all);

/// Solves all problems from outside the project, two at a time.
fn solve_all() -> Vec<Outcome> {
    let folder = fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(FOLDER)).expect("the folder");
    let mut names: Vec<String> = folder
        .map(|entry| entry.expect("an entry").path().file_stem().expect("a name").to_string_lossy().into_owned())
        .collect();
    // Threads take names from the end of the list. A run that ignores the request to stop occupies its thread for as
    // long as the program runs: the `elastic_3d` problems, where this may happen, are therefore taken last.
    names.sort();
    names.reverse();
    names.sort_by_key(|name| !name.starts_with("elastic_3d"));
    let (left, outcomes) = (Mutex::new(names), Mutex::new(Vec::new()));
    let work = || {
        while let Some(name) = { left.lock().expect("the names").pop() } {
            let outcome = outcome(name);
            outcomes.lock().expect("the outcomes").push(outcome);
        }
    };
    thread::scope(|scope| {
        scope.spawn(work);
        scope.spawn(work);
    });
    let mut outcomes = outcomes.into_inner().expect("the outcomes");
    outcomes.sort_by(|a, b| a.name.cmp(&b.name));
    outcomes
}

fn outcome(name: String) -> Outcome {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(FOLDER).join(format!("{name}.json"));
    let text = fs::read_to_string(path).unwrap_or_else(|error| panic!("{name}: {error}"));
    let problem: Problem = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
    let (how, detail, trusted) = classify(&problem);
    println!("{} {name}: {how}, trusted {trusted}. {detail}", problem.class);
    Outcome { name, class: problem.class, how, detail, trusted }
}

fn classify(problem: &Problem) -> (&'static str, String, bool) {
    let truth = &problem.truth;
    let allowed = Duration::from_secs(problem.seconds.into()) * PATIENCE;
    let solution = match computing_time::solve(problem.specification.get(), allowed) {
        Ended::Solved(solution) => solution,
        Ended::Refused(errors) if truth.may_be_refused => return ("right", format!("{errors:?}"), false),
        Ended::Refused(errors) => return ("refused", format!("{errors:?}"), false),
        Ended::Deaf => return ("deaf", "goes on after it was asked to stop".to_owned(), false),
    };
    let trusted = solution.verdict.trusted;
    let cause =
        solution.error.as_ref().map_or_else(String::new, |error| format!("{} at t = {}", error.code, error.time));
    match solution.status {
        Status::Completed => {
            if let Some(fault) = truth.fault(&solution) {
                return ("wrong", fault, trusted);
            }
            truth
                .misleading(&solution)
                .map_or(("right", String::new(), trusted), |fault| ("misleading", fault, trusted))
        }
        Status::Failed if truth.ends_early(&solution) => ("right", cause, trusted),
        Status::Failed => ("failed", cause, trusted),
        Status::Stopped if truth.stops => ("right", cause, trusted),
        Status::Stopped => ("stopped", cause, trusted),
    }
}

#[test]
fn what_is_not_right_is_known() {
    let is_told = |outcome: &&Outcome| outcome.how != "right" && !outcome.is_silent();
    let failures: Vec<Failure> = OUTCOMES.iter().filter(is_told).map(Outcome::failure).collect();
    assert_known("KNOWN in tests/regression/strangers/mod.rs", KNOWN, &failures);
}

#[test]
fn what_is_wrong_in_silence_is_known() {
    let failures: Vec<Failure> = OUTCOMES.iter().filter(|outcome| outcome.is_silent()).map(Outcome::failure).collect();
    assert_known("SILENT in tests/regression/strangers/mod.rs", SILENT, &failures);
}

#[test]
fn what_is_right_to_the_end_is_trusted() {
    let doubted = |outcome: &&Outcome| outcome.how == "right" && !outcome.trusted && matches!(outcome.class, 'A' | 'C');
    let failures: Vec<Failure> =
        OUTCOMES.iter().filter(doubted).map(|outcome| Failure { how: "doubted", ..outcome.failure() }).collect();
    assert_known("DOUBTED in tests/regression/strangers/mod.rs", DOUBTED, &failures);
}
