//! A pendulum in Cartesian coordinates, with its tension as a free variable: `K = R` gives a differential-algebraic
//! equation.

use crate::systems::harness::{column, last, solve};
use crate::systems::reference::{digits, example, read};
use serde_json::json;

#[test]
fn the_pendulum_reaches_its_reference_and_keeps_its_length() {
    let problems = read("tests/reference/smooth.json")["problems"].take();
    let reference = problems
        .as_array()
        .and_then(|problems| problems.iter().find(|problem| problem["name"] == "pend_i1"))
        .map(|problem| problem["reference"].clone())
        .expect("the pendulum");
    let mut specification = example("pendulum");
    specification["method"]["rtol"] = json!(1e-9);
    let solution = solve(&specification);
    for (k, name) in ["x", "y", "u", "v"].iter().enumerate() {
        let error = (last(&solution, name) - digits(&reference[k])).abs();
        assert!(error < 3e-7, "`{name}` is off by {error:e}");
    }
    // The reported tension of the rod is computed from the states; the stage value would be of lower order.
    let tension = last(&solution, "tension") - digits(&reference[4]);
    assert!(tension.abs() < 3e-6, "the tension is off by {tension:e}");
    for (x, y) in column(&solution, "x").iter().zip(column(&solution, "y")) {
        assert!((x.hypot(*y) - 1.0).abs() < 1e-7);
    }
}

#[test]
fn an_inconsistent_velocity_is_an_error_that_says_by_how_much() {
    let mut specification = example("pendulum");
    specification["problem"]["dvi"]["states"]["u"]["initial"] = json!(0.5);
    let text = specification.to_string();
    let specification = dvi::specification::Specification::from_json(text.as_bytes()).expect("a specification");
    let solution = dvi::solve(&specification, &dvi::problem::Control::new());
    let error = solution.error.expect("an error");
    assert_eq!(error.code, "inconsistent_start");
    // The component of the initial velocity along the rod has to vanish, and the error message states the whole
    // amount by which it does not.
    assert!(error.message.contains("`u`") && error.message.contains("-5e-1"), "{}", error.message);
}
