//! Stiffness that appears only after a switch. Smooth stiff problems are in the table of stability cases.

use crate::stability::harness::{Case, column, distance, instants};
use serde_json::json;

#[test]
fn a_ball_on_a_stiff_spring_keeps_its_energy() {
    // Free fall from height 1 with g = 10 onto a one-sided spring of stiffness 1e9: three contacts of duration about
    // 1e-4 until t = 3.
    let case = Case::until(3.0).state("x", 1.0, "v").state("v", 0.0, "-10 + F").nonnegative("F", "F/1e9 + x");
    let solution = case.method(json!({"rtol": 1e-8})).solve();
    let spring = |x: f64| 0.5e9 * x.min(0.0).powi(2);
    for (x, v) in column(&solution, "x").iter().zip(column(&solution, "v")) {
        let energy = 10.0 * x + 0.5 * v * v + spring(*x);
        assert!((energy - 10.0).abs() < 1e-4, "the energy is {energy}, not 10");
    }
    // The contact with the one-sided spring closes three times, and opens three times.
    assert_eq!(instants(&solution).len(), 6, "{:?}", instants(&solution));
}

#[test]
fn a_jump_of_the_forcing_is_resolved_where_it_is_not_stiff() {
    let case = Case::until(3.0).state("x", 0.0, "heaviside(t - 1) - heaviside(t - 2)");
    let solution = case.method(json!({"rtol": 1e-9})).times(json!([0.5, 1, 1.5, 2, 2.5, 3])).solve();
    let error = distance(&solution, "x", |t| (t.min(2.0) - 1.0).max(0.0));
    assert!(error < 1e-5, "off by {error:e}");
}
