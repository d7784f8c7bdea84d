//! Complementarity problems whose inequalities are redundant, nearly singular, of the wrong sign or not symmetric.

use crate::stability::harness::{Case, RELAY, distance, last};
use serde_json::json;

fn method() -> serde_json::Value {
    json!({"rtol": 1e-8})
}

#[test]
fn the_same_inequality_twice_leaves_the_states_unique() {
    let case = Case::until(3.0).state("x", 1.0, "-1 + a + b").nonnegative("a", "x").nonnegative("b", "x");
    let solution = case.method(method()).solve();
    let error = distance(&solution, "x", |t| (1.0 - t).max(0.0));
    assert!(error < 1e-13, "off by {error:e}");
    // The inequalities of two relays are the same, so that only the sum of their multipliers a and b is determined: it
    // is 1.
    assert!((last(&solution, "a") + last(&solution, "b") - 1.0).abs() < 1e-12);
    let case = Case::until(3.0).state("x", 1.0, "0.3 - a - b");
    let case = case.between("a", "-x", RELAY[0], RELAY[1]).between("b", "-x", RELAY[0], RELAY[1]);
    let solution = case.method(method()).solve();
    let error = distance(&solution, "x", |t| (1.0 - 1.7 * t).max(0.0));
    assert!(error < 1e-13, "off by {error:e}");
    assert!((last(&solution, "a") + last(&solution, "b") - 0.3).abs() < 1e-12);
}

#[test]
fn a_cb_that_is_not_symmetric_takes_the_solution_that_exists() {
    // The matrix CB is [[1, 4], [-4, 1]]: x reaches zero at t = 1, and y at t = 1.1; afterwards only the multiplier b
    // = 1 is positive, and x' = -1 + 4 b = 3.
    let case = Case::until(5.0).state("x", 1.0, "-1 + a + 4*b").state("y", 1.5, "-1 + b - 4*a");
    let solution = case.nonnegative("a", "x").nonnegative("b", "y").method(method()).solve();
    let error = distance(&solution, "x", |t| (1.0 - t).max(0.0).max(3.0 * (t - 1.1)));
    assert!(error < 1e-11, "off by {error:e}");
    let error = distance(&solution, "y", |t| if t < 1.0 { 1.5 - t } else { (0.5 - 5.0 * (t - 1.0)).max(0.0) });
    assert!(error < 1e-11, "off by {error:e}");
    // The diagnostics of the complementarity conditions must not report a violation, since the solution satisfies
    // them.
    let evidence = solution.diagnostics.complementarity.expect("evidence");
    assert!(evidence.smallest_g > -1e-9, "{evidence:?}");
}

#[test]
fn many_stages_rest_where_every_state_is_rounding() {
    // w' = M z - 1 with a circulant matrix M, from a point near the equilibrium z = 1/4: steps too long to resolve
    // the spiral stay at the equilibrium, where w is only the rounding error of the transformation to nine stages.
    for (stages, step) in [(7, 0.1), (8, 0.05), (9, 0.1), (9, 0.05)] {
        let case = Case::until(4.0).state("w1", 0.0, "a + 3*b - 1").state("w2", 1e-6, "b + 3*c - 1");
        let case = case.state("w3", 0.0, "3*a + c - 1");
        let case = case.nonnegative("a", "w1").nonnegative("b", "w2").nonnegative("c", "w3");
        let solution = case.method(json!({"rtol": 1e-8, "stages": stages, "step": step})).solve();
        for name in ["a", "b", "c"] {
            let value = last(&solution, name);
            assert!((value - 0.25).abs() < 1e-12, "{stages} stages of {step}: {name} = {value}");
        }
    }
}
