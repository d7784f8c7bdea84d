//! The table of stiff and extreme test cases that `dvi report` shows: each case must pass, except the known failures.

use dvi::problem::Control;
use dvi::study::stability::{Outcome, cases, parts, run};

/// Cases that fail, and are shown as failures in the table. In an impact shorter than the fixed step, the force acts
/// at only one of the two stages, and the bar rebounds faster than it arrives: a rigid body with 5/4 of its speed.
/// With a Young's modulus of 9e8 or more, the rounding error of `K u` also exceeds the tolerance when the body is far
/// from its initial position.
const KNOWN_FAILURES: [&str; 3] = ["stiff_bar young=9e7", "stiff_bar young=9e8", "stiff_bar young=9e12"];

fn check(part: &str) {
    let outcomes: Vec<Outcome> =
        cases().iter().filter(|case| case.part == part).map(|case| run(case, &Control::new())).collect();
    assert!(!outcomes.is_empty(), "there is no part `{part}`");
    let wrong: Vec<&Outcome> =
        outcomes.iter().filter(|outcome| outcome.passed() == KNOWN_FAILURES.contains(&outcome.name.as_str())).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn stiff_problems_come_out_as_they_must() {
    check("stiff");
}

#[test]
fn problems_at_any_scale_come_out_as_they_must() {
    check("scales");
}

#[test]
fn inequalities_come_out_as_they_must() {
    check("inequalities");
}

#[test]
fn contacts_come_out_as_they_must() {
    check("contact");
}

#[test]
fn bodies_come_out_as_they_must() {
    check("bodies");
}

#[test]
fn circuits_and_memory_come_out_as_they_must() {
    check("circuits_and_memory");
}

#[test]
fn what_cannot_be_solved_is_refused_as_it_must() {
    check("refusals");
}

#[test]
fn every_part_of_the_table_is_checked_and_it_is_large() {
    let parts: Vec<&str> = parts().collect();
    assert_eq!(parts, ["stiff", "scales", "inequalities", "contact", "bodies", "circuits_and_memory", "refusals"]);
    assert!(cases().len() >= 40, "{} rows", cases().len());
}
