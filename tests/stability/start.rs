//! Consistent initial values: of variables that occur nonlinearly and have no initial guess, and with a singular mass
//! matrix.

use crate::stability::harness::{Case, column, distance, last};
use serde_json::json;

/// The real root of `z^3 + z = 1`.
const ROOT: f64 = 0.682_327_803_828_019_3;

#[test]
fn a_variable_that_enters_nonlinearly_is_found_without_a_guess() {
    let free = Case::until(1.0).state("x", 1.0, "-x + z").free("z", "z^3 + z - x");
    let bounded = Case::until(1.0).state("x", 1.0, "-x + z").nonnegative("z", "z^3 + z - x");
    for case in [free, bounded] {
        let solution = case.method(json!({"rtol": 1e-9})).solve();
        assert!((column(&solution, "z")[0] - ROOT).abs() < 1e-9, "z = {}", column(&solution, "z")[0]);
        for (x, z) in column(&solution, "x").iter().zip(column(&solution, "z")) {
            assert!((z.powi(3) + z - x).abs() < 1e-8);
        }
    }
    // The state is x = z + z^3 and x' = -z^3, so that (1 + 3 z^2) z' = -z^3, with the integral 1/(2 z^2) - 3 ln z = c +
    // t.
    let case = Case::until(1.0).state("x", 1.0, "-x + z").nonnegative("z", "z^3 + z - x");
    let solution = case.method(json!({"rtol": 1e-9})).solve();
    let integral = |z: f64| 0.5 / (z * z) - 3.0 * z.ln();
    assert!((integral(last(&solution, "z")) - integral(ROOT) - 1.0).abs() < 1e-7);
    // The initial variable satisfies exp(z) = 5 x with x = 1: the first Newton step from z = 0 leads to z = 4, and the
    // root is ln 5.
    let case = Case::until(1.0).state("x", 1.0, "-x").nonnegative("z", "exp(z) - 5*x");
    let solution = case.method(json!({"rtol": 1e-9})).solve();
    let error = distance(&solution, "z", |t| 5.0_f64.ln() - t);
    assert!(error < 1e-8, "off by {error:e}");
}

#[test]
fn a_singular_mass_matrix_makes_an_algebraic_state() {
    let case = Case::until(2.0).state("x", 1.0, "-x + y").state("y", 0.5, "x - 2*y");
    let solution = case.mass(json!([[1, 0], [0, 0]])).method(json!({"rtol": 1e-8})).solve();
    let error = distance(&solution, "y", |t| 0.5 * (-0.5 * t).exp());
    assert!(error < 1e-8, "off by {error:e}");
    let case = Case::until(2.0).state("x", 1.0, "-x + y").state("y", 0.7, "x - 2*y");
    let failure = case.mass(json!([[1, 0], [0, 0]])).run().error.expect("a failure");
    assert_eq!(failure.code, "inconsistent_start");
    assert!(failure.message.contains("`y` by -2"), "{}", failure.message);
}

#[test]
fn a_steep_start_is_no_jump() {
    // The state of x' = k (-z - x), with the constraint z = 2, falls to -2 in a transient far shorter than the run.
    for k in [1e9, 1e12, 1e15] {
        let case = Case::until(1e-3).state("x", 0.0, &format!("{k:e}*(-z - x)")).free("z", "z - 2");
        let solution = case.method(json!({"rtol": 1e-6})).solve();
        assert!((last(&solution, "x") + 2.0).abs() < 1e-6, "{k:e}: {}", last(&solution, "x"));
    }
}
