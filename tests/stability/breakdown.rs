//! Runs that cannot reach their end: each reports the reason and the time, and keeps the trajectory so far.

use crate::stability::harness::{Case, column, last};
use dvi::solution::{Failure, Solution, Status};
use serde_json::json;

/// Solves a problem whose run must fail at about `time`, and returns the solution, whose trajectory ends there, and the
/// failure.
fn failure(case: &Case, time: f64) -> (Solution, Failure) {
    let solution = case.run();
    assert_eq!(solution.status, Status::Failed);
    let failure = solution.error.clone().expect("a failure");
    assert!((failure.time - time).abs() < 1e-5, "at {}, not {time}", failure.time);
    let reached = *solution.trajectory.t.last().expect("a trajectory");
    assert_eq!(reached, failure.time, "the trajectory ends before the failure");
    assert!(solution.trajectory.t.is_sorted_by(|a, b| a < b), "times repeat");
    (solution, failure)
}

#[test]
fn a_finite_blow_up_ends_at_its_time() {
    let (solution, failure) = failure(&Case::until(2.0).state("x", 1.0, "x^2"), 1.0);
    assert_eq!(failure.code, "step_too_small");
    assert!(failure.message.contains("blow-up"), "{}", failure.message);
    assert!(failure.state[0] > 1e12 && last(&solution, "x") == failure.state[0]);
    for (&t, &x) in solution.trajectory.t.iter().zip(column(&solution, "x")).filter(|(t, _)| **t < 0.99) {
        assert!((x * (1.0 - t) - 1.0).abs() < 1e-4, "x = {x} at t = {t}");
    }
    let (_, failure) = self::failure(&Case::until(1e3).state("x", 1.0, "exp(x)"), (-1.0_f64).exp());
    assert_eq!(failure.code, "step_too_small");
}

#[test]
fn a_pole_in_time_ends_before_it() {
    let (solution, failure) = failure(&Case::until(2.0).state("x", 0.0, "1/(1 - t)"), 1.0);
    assert_eq!(failure.code, "step_too_small");
    for (&t, &x) in solution.trajectory.t.iter().zip(column(&solution, "x")).filter(|(t, _)| **t < 0.99) {
        assert!((x + (1.0 - t).ln()).abs() < 1e-5, "x = {x} at t = {t}");
    }
}

#[test]
fn leaving_the_domain_of_a_function_names_the_state() {
    // The solution of x' = -1 - sqrt(x), x(0) = 1, reaches 0 at t = 2 - 2 ln 2.
    let time = 2.0 - 2.0 * 2.0_f64.ln();
    let (solution, failure) = failure(&Case::until(3.0).state("level", 1.0, "-1 - sqrt(level)"), time);
    assert_eq!(failure.code, "not_finite");
    assert!(failure.message.contains("rate of `level`"), "{}", failure.message);
    assert!(last(&solution, "level").abs() < 1e-6);
    let (_, failure) = self::failure(&Case::until(2.0).state("x", 0.0, "ln(1 - t)"), 1.0);
    assert_eq!(failure.code, "not_finite");
}

#[test]
fn a_tank_that_runs_dry_beside_its_formula_names_the_derivative() {
    // Torricelli's law x' = -sqrt(x) has no derivative at x = 0, which the solution reaches at t = 2.
    let solution = Case::until(3.0).state("level", 1.0, "-sqrt(level)").run();
    let failure = solution.error.expect("a failure");
    assert_eq!(failure.code, "not_finite");
    assert!(failure.message.contains("`level`"), "{}", failure.message);
    assert!((failure.time - 2.0).abs() < 1e-2, "at {}", failure.time);
}

#[test]
fn an_overflow_is_an_end_not_an_infinity() {
    // The solution e^t of x' = x exceeds the largest double at t = 709.78.
    let solution = Case::until(1e3).state("x", 1.0, "x").run();
    assert_eq!(solution.status, Status::Failed);
    assert!(last(&solution, "x") > 1e300);
    assert!(solution.error.expect("a failure").time > 700.0);
}

#[test]
fn an_inequality_that_nothing_can_keep_ends_at_its_time() {
    // The variable z >= 0 can only push x down, but x >= 0 requires a push up: no solution exists after t = 1.
    for rate in ["-1 - z", "-1"] {
        let case = Case::until(3.0).state("x", 1.0, rate).nonnegative("z", "x");
        let (solution, failed) = failure(&case, 1.0);
        assert!(last(&solution, "x").abs() < 1e-9);
        assert_eq!(failed.code, "no_solution");
        assert!(failed.message.contains("the inequality of `z` is violated"), "{}", failed.message);
    }
    let solution = Case::until(3.0).state("x", -1.0, "-1").nonnegative("z", "x").run();
    assert_eq!(solution.error.expect("a failure").code, "no_solution");
}

#[test]
fn a_fixed_step_that_meets_a_pole_says_so() {
    let case = Case::until(2.0).state("x", 0.0, "sin(t - 1)/(t - 1)");
    let solution = case.method(json!({"step": 0.5, "stages": 3})).run();
    let failure = solution.error.expect("a failure");
    assert_eq!((&*failure.code, failure.time), ("not_finite", 0.5));
    assert!(failure.message.contains("rate of `x`"), "{}", failure.message);
}
