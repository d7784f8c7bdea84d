//! Runs that might never end: each ends soon and reports the right reason, or reaches its end with the right
//! solution.

use crate::stability::harness::{Case, RELAY, column, last};
use dvi::problem::Control;
use dvi::solution::{Solution, Status};
use dvi::specification::Specification;
use serde_json::{Value, json};

/// Returns the problem, as JSON, that the error message of a chattering run proposes in place of the solved one.
fn problem_in(message: &str) -> Value {
    let start = message.find("{\"dvi\"").unwrap_or_else(|| panic!("no problem in: {message}"));
    serde_json::from_str(&message[start..]).expect("JSON to the end of the message")
}

/// Asserts that a run fails with chattering at about `time`, and solves the problem that the error message proposes
/// instead, up to `end`.
fn solve_instead(case: &Case, time: f64, end: f64) -> Solution {
    let solution = case.run();
    let failure = solution.error.expect("a failure");
    assert_eq!(failure.code, "chattering", "{}", failure.message);
    assert!((failure.time - time).abs() < 1e-3, "at {}, not {time}", failure.time);
    assert!(solution.diagnostics.steps.accepted < 20_000, "{:?}", solution.diagnostics.steps);
    let instead = json!({"problem": problem_in(&failure.message), "time": {"end": end}});
    let specification = Specification::from_json(instead.to_string().as_bytes()).expect("a right specification");
    let solution = dvi::solve(&specification, &Control::new());
    assert_eq!(solution.status, Status::Completed, "{:?}", solution.error);
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    solution
}

#[test]
fn steps_that_chatter_across_a_jump_end_with_the_problem_to_write_instead() {
    // The state x of x' = -sign(x) falls from 1 to zero at t = 1 and stays there.
    let solution = solve_instead(&Case::until(3.0).state("x", 1.0, "-sign(x)"), 1.0, 3.0);
    assert!(last(&solution, "x").abs() < 1e-9 && last(&solution, "u").abs() < 1e-9);
    let solution = solve_instead(&Case::until(3.0).state("x", 0.0, "1 - 2*heaviside(x - 1)"), 1.0, 3.0);
    assert!((last(&solution, "x") - 1.0).abs() < 1e-9 && (last(&solution, "u") - 0.5).abs() < 1e-9);
    // Coulomb friction with an applied force of half the friction limit: v = 1 - t/2 until the body sticks at t = 2.
    // The result does not depend on the units.
    for scale in [1.0, 1e-6, 1e6] {
        let rate = format!("{} - {scale}*sign(v)", 0.5 * scale);
        let case = Case::until(4.0).state("v", scale, &rate).method(json!({"atol": 1e-9 * scale}));
        let solution = solve_instead(&case, 2.0, 4.0);
        assert!(last(&solution, "v").abs() < 1e-9 * scale && (last(&solution, "u") - 0.5).abs() < 1e-9);
    }
}

#[test]
fn kinks_within_kinks_are_written_as_a_set() {
    // The rate of y without its term -3 sign(y) lies between 1 and 2 at y = 0, and the sign term, of size 3, outweighs
    // it: y rests at zero from about t = 0.6 on.
    let rate = "max(min(x, 2), 1, 0.5) + abs(y) - 3*sign(y)";
    let case = Case::until(2.0).state("x", 0.0, "1").state("y", 1.0, rate);
    let solution = case.run();
    let failure = solution.error.expect("a failure");
    assert_eq!(failure.code, "chattering");
    let solution = solve_instead(&case, failure.time, 2.0);
    assert!(last(&solution, "y").abs() < 1e-9, "y = {}", last(&solution, "y"));
    assert!((last(&solution, "x") - 2.0).abs() < 1e-12);
}

#[test]
fn a_jump_that_is_passed_and_a_kink_at_rest_are_no_chattering() {
    // The state x passes the jump of sign(x) once in each half period of cos t, and the sign of the state z at rest,
    // whose rate has the kink of abs(z), changes by rounding: neither is chattering.
    let case =
        Case::until(60.0).state("x", 0.0, "cos(t)").state("y", 0.0, "sign(x)").state("z", 1.0, "-z*abs(z) - 1e3*z");
    case.method(json!({"rtol": 1e-5})).solve();
}

#[test]
fn a_force_that_grows_beyond_all_bounds_ends_at_its_pole() {
    // The constraint a = 0 on the state a requires the force z = 1/cos t, which cannot be continued beyond t = pi/2.
    for rtol in [1e-4, 1e-6, 1e-9] {
        let case = Case::until(3.0).state("a", 1.0, "-1 + cos(t)*z").nonnegative("z", "a");
        let solution = case.method(json!({"rtol": rtol})).run();
        let failure = solution.error.expect("a failure");
        assert!(["step_too_small", "no_solution"].contains(&&*failure.code), "{failure:?}");
        let error = (failure.time - std::f64::consts::FRAC_PI_2).abs();
        assert!(error < 1e-4, "rtol {rtol:e}: off by {error:e}");
        assert!(solution.diagnostics.steps.accepted < 5_000, "{:?}", solution.diagnostics.steps);
    }
}

#[test]
fn twisting_comes_to_rest_or_says_what_is_not_resolved() {
    // x'' = -3 Sgn x - 1.2 Sgn x' is at rest from t = 4.544 on; the trajectory consists of arcs of parabolas whose
    // heights decrease by the factor (3 - 1.2)/(3 + 1.2).
    let [lower, upper] = RELAY;
    for (rtol, stages) in [(1e-4, json!(1)), (1e-6, json!("auto")), (1e-9, json!(5))] {
        let case = Case::until(8.0).state("x", 1.0, "v").state("v", 0.5, "-3*p - 1.2*q");
        let case = case.between("p", "-x", lower, upper).between("q", "-v", lower, upper);
        let solution = case.method(json!({"rtol": rtol, "stages": stages.clone()})).run();
        assert!(solution.diagnostics.steps.accepted < 400_000, "{:?}", solution.diagnostics.steps);
        if let Some(failure) = &solution.error {
            // With one stage, a method of order 1, the velocity at the accumulation of switches is not resolved
            // although the position is.
            assert_eq!((&*failure.code, stages), ("switches_unresolved", json!(1)), "{}", failure.message);
            assert!(failure.time > 4.5, "{failure:?}");
            continue;
        }
        assert!(last(&solution, "x").abs() < 1e-4 && last(&solution, "v").abs() < 1e-4, "rtol {rtol:e}");
    }
}

#[test]
fn a_start_is_found_however_far_the_variables_are() {
    for (equation, of) in [("z^3 + z - x", "cubic"), ("exp(z) - 1 - x", "exponential")] {
        for x0 in [2.0, 3.0, 100.0, 1e6] {
            for block in [
                json!({"free": ["z"]}),
                json!({"nonnegative": ["z"]}),
                json!({"box": {"of": ["z"], "lower": -1, "upper": 200}}),
            ] {
                for rtol in [1e-4, 1e-9] {
                    let case = Case::until(3.0).state("x", x0, "-z").variable("z", equation, block.clone());
                    let solution = case.method(json!({"rtol": rtol, "atol": 1e-3 * rtol})).solve();
                    for (x, z) in column(&solution, "x").iter().zip(column(&solution, "z")) {
                        let exact = if of == "cubic" { z.powi(3) + z } else { z.exp() - 1.0 };
                        assert!((exact - x).abs() < 1e-6 * (1.0 + x), "{of} from {x0} in {block}: z = {z} at x = {x}");
                    }
                    if of == "cubic" {
                        // The variable z satisfies (3 z^2 + 1) dz = dx = -z dt: 3/2 z^2 + ln z decreases by t.
                        let integral = |z: f64| 1.5 * z * z + z.ln();
                        let z = column(&solution, "z");
                        let gone = integral(z[0]) - integral(last(&solution, "z"));
                        assert!((gone - 3.0).abs() < 100.0 * rtol * integral(z[0]).abs().max(1.0), "from {x0}: {gone}");
                    }
                }
            }
        }
    }
}

#[test]
fn an_equation_without_a_root_is_not_said_to_have_the_wrong_sign() {
    let solution = Case::until(1.0).state("x", 1.0, "-z").free("z", "exp(z) + 1 + x").run();
    let failure = solution.error.expect("a failure");
    assert_eq!((&*failure.code, failure.time), ("start_not_found", 0.0));
    assert!(!failure.message.contains("sign"), "{}", failure.message);
}
