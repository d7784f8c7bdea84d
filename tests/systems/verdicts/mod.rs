//! Verdicts (whether the result of a run is to be trusted) on problems with contacts, obstacles and memory: accurate
//! answers are trusted and wrong ones are not, in any units.

mod bodies;
mod compared;
mod given_steps;
mod impacts;
mod narrow;
mod obstacle;
mod squeezed;

use super::harness::{last, solve};
use dvi::solution::{CheckCode, Solution};
use serde_json::{Value, json};

/// Returns the codes of the reasons why the verdict does not trust a solution.
fn reasons(solution: &Solution) -> Vec<CheckCode> {
    solution.verdict.because.iter().map(|reason| reason.code).collect()
}

/// Returns the measured value of a numerical check on which the verdict is based, relative to its permitted value.
fn excess(solution: &Solution, code: CheckCode) -> f64 {
    let (value, allowed) = solution.diagnostics.checks.get(code).unwrap_or_else(|| panic!("no check {code:?}"));
    value / allowed
}

fn assert_trusted(solution: &Solution) {
    assert!(solution.verdict.trusted, "{:#?}", solution.verdict);
}
