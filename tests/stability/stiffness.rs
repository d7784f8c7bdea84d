//! Stiffness far beyond any accuracy: the problem of Prothero and Robinson (1974), `x' = lambda (x - cos t) - sin t`, of
//! solution `cos t` from 1, and stiffness that is only there after a switch.

use crate::stability::harness::{Case, column, distance, instants, last};
use serde_json::json;

fn prothero_robinson(lambda: f64, initial: f64) -> Case {
    Case::until(10.0).state("x", initial, &format!("{lambda:e}*(x - cos(t)) - sin(t)"))
}

#[test]
fn the_slow_solution_is_followed_at_any_stiffness_and_any_number_of_stages() {
    for lambda in [-1e12, -1e15] {
        for stages in [json!("auto"), json!(1), json!(3), json!(5), json!(7), json!(9)] {
            let method = json!({"rtol": 1e-8, "atol": 1e-10, "stages": stages});
            let solution = prothero_robinson(lambda, 1.0).method(method).solve();
            let error = distance(&solution, "x", f64::cos);
            assert!(error < 1e-11, "lambda = {lambda:e}, {stages} stages: off by {error:e}");
            assert!(solution.diagnostics.steps.accepted < 20, "{:?}", solution.diagnostics.steps);
        }
    }
}

#[test]
fn the_tolerance_is_kept_where_stiffness_reduces_the_order() {
    for lambda in [-1e2, -1e4, -1e6] {
        for rtol in [1e-5, 1e-8] {
            let case = prothero_robinson(lambda, 1.0).method(json!({"rtol": rtol, "atol": rtol}));
            let error = (last(&case.solve(), "x") - 10.0_f64.cos()).abs() / rtol;
            assert!(error <= 30.0, "lambda = {lambda:e} at {rtol:e}: {error} tolerances");
        }
    }
}

#[test]
fn values_between_the_steps_follow_the_slow_solution_too() {
    // At the ends of steps of any length the equation itself gives the answer; a polynomial between them does not.
    let times: Vec<f64> = (1..=100).map(|k| f64::from(k) / 10.0).collect();
    for lambda in [-1e2, -1e6, -1e12] {
        let case = prothero_robinson(lambda, 1.0).method(json!({"rtol": 1e-5, "atol": 1e-5}));
        let error = distance(&case.times(json!(times)).solve(), "x", f64::cos);
        assert!(error < 3e-4, "lambda = {lambda:e}: off by {error:e}");
    }
}

#[test]
fn a_start_off_the_slow_solution_decays_to_it_at_once() {
    for lambda in [-1e12, -1e15] {
        let case = prothero_robinson(lambda, 3.0).method(json!({"rtol": 1e-8, "atol": 1e-10}));
        let solution = case.times(json!([1e-3, 10])).solve();
        let error = distance(&solution, "x", f64::cos);
        assert!(error < 1e-10, "lambda = {lambda:e}: off by {error:e}");
        assert!(solution.diagnostics.steps.accepted < 100, "{:?}", solution.diagnostics.steps);
    }
}

#[test]
fn a_stop_with_a_stiffness_of_1e9_begins_at_a_switch() {
    // x' = -1 + F with F = max(0, -1e9 x): x falls to zero at t = 1 and rests at -1e-9.
    let case = Case::until(3.0).state("x", 1.0, "-1 + F").nonnegative("F", "F/1e9 + x");
    let solution = case.method(json!({"rtol": 1e-8})).solve();
    let exact = |t: f64| if t < 1.0 { 1.0 - t } else { -1e-9 * (1.0 - (-1e9 * (t - 1.0)).exp()) };
    let error = distance(&solution, "x", exact);
    assert!(error < 1e-12, "off by {error:e}");
    assert!((last(&solution, "F") - 1.0).abs() < 1e-9);
    assert!((instants(&solution)[0] - 1.0).abs() < 1e-12);
}

#[test]
fn a_ball_on_a_stiff_spring_keeps_its_energy() {
    // Free fall from 1 at g = 10, and a one-sided spring of 1e9: three contacts of about 1e-4 until t = 3.
    let case = Case::until(3.0).state("x", 1.0, "v").state("v", 0.0, "-10 + F").nonnegative("F", "F/1e9 + x");
    let solution = case.method(json!({"rtol": 1e-8})).solve();
    let spring = |x: f64| 0.5e9 * x.min(0.0).powi(2);
    for (x, v) in column(&solution, "x").iter().zip(column(&solution, "v")) {
        let energy = 10.0 * x + 0.5 * v * v + spring(*x);
        assert!((energy - 10.0).abs() < 1e-4, "the energy is {energy}, not 10");
    }
    // Three times into contact and three times out of it.
    assert_eq!(instants(&solution).len(), 6, "{:?}", instants(&solution));
}

#[test]
fn a_jump_of_the_forcing_is_resolved_where_it_is_not_stiff() {
    let case = Case::until(3.0).state("x", 0.0, "heaviside(t - 1) - heaviside(t - 2)");
    let solution = case.method(json!({"rtol": 1e-9})).times(json!([0.5, 1, 1.5, 2, 2.5, 3])).solve();
    let error = distance(&solution, "x", |t| (t.min(2.0) - 1.0).max(0.0));
    assert!(error < 1e-5, "off by {error:e}");
}
