//! Relays whose output enters only the second or third derivative of their input signal. Their output is bounded, so
//! that no state jumps, whatever the index: they are solved as posed.

use super::harness::{column, events, last, solve};
use dvi::analysis::Uniqueness;
use serde_json::{Value, json};

/// Specification of a problem with the given states, as name, initial value and rate, and a relay `u in Sgn(signal)`.
fn relay(states: &[(&str, f64, &str)], signal: &str, end: f64, method: Value) -> Value {
    let states: serde_json::Map<String, Value> = states
        .iter()
        .map(|&(name, initial, rate)| (name.to_owned(), json!({"initial": initial, "rate": rate})))
        .collect();
    json!({
        "problem": {"dvi": {
            "states": states,
            "variables": {"u": {"inequality": format!("-{signal}")}},
            "set": [{"box": {"of": ["u"], "lower": -1, "upper": 1}}]
        }},
        "time": {"end": end},
        "method": method
    })
}

#[test]
fn a_double_integrator_swings_on_parabolas() {
    // The solution of x'' = -sgn x from (x0, 0) consists of arcs x0 - s^2/2, each of which lasts a quarter period
    // sqrt(2 x0).
    let x0 = 1.3;
    let method = json!({"rtol": 1e-9, "atol": 1e-12});
    let solution = solve(&relay(&[("x", x0, "v"), ("v", 0.0, "-u")], "x", 100.0, method));
    let quarter = f64::sqrt(2.0 * x0);
    let exact = |t: f64| {
        let half = (t / (2.0 * quarter) + 0.5).floor();
        let s = t - 2.0 * quarter * half;
        if half % 2.0 == 0.0 { x0 - s * s / 2.0 } else { s * s / 2.0 - x0 }
    };
    let times = solution.trajectory.t.iter().zip(column(&solution, "x"));
    let worst = times.map(|(&t, x)| (x - exact(t)).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-6, "off by {worst:e}");
    let mut switches = events(&solution, "u");
    switches.dedup();
    assert_eq!(switches.len(), 31);
    for (k, t) in switches.iter().enumerate() {
        assert!((t - quarter * (2 * k + 1) as f64).abs() < 1e-6, "switch {k} at {t}");
    }
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let analysis = solution.diagnostics.analysis.expect("an analysis");
    assert_eq!((analysis.index, analysis.uniqueness), (Some(2.0), Uniqueness::NotCertified));
    assert_eq!(solution.verdict.caveats[0].code, "uniqueness_not_guaranteed");
}

#[test]
fn a_relay_of_index_three_has_its_limit_cycle() {
    // A relay with the plant 1/(s+1)^3. Reference: between switches each state is a polynomial times exp(-t), minus
    // u, and the switches are found by bisection.
    let states = [("x1", 0.5, "x2 - x1"), ("x2", 0.0, "x3 - x2"), ("x3", 0.0, "-u - x3")];
    let solution = solve(&relay(&states, "x1", 50.0, json!({})));
    let exact = [("x1", -0.15903742340564242), ("x2", -0.22012133011893664), ("x3", 0.18668410076126674)];
    for (state, exact) in exact {
        assert!(
            (last(&solution, state) - exact).abs() < 1e-6,
            "{state}: {} instead of {exact}",
            last(&solution, state)
        );
    }
    let mut switches = events(&solution, "u");
    switches.dedup();
    assert_eq!(switches.len(), 27);
    assert!((switches[26] - 49.24763424570642).abs() < 1e-6, "the last switch at {}", switches[26]);
}

#[test]
fn certificates_are_lost_where_a_run_leaves_what_they_hold_for() {
    let solve = |rate: &str, initial: f64| {
        solve(&json!({"problem": {"dvi": {"states": {"x": {"initial": initial, "rate": rate}}}}, "time": {"end": 1}}))
    };
    let certified = |rate: &str, initial: f64| {
        let solution = solve(rate, initial);
        let caveat = solution.verdict.caveats.iter().any(|caveat| caveat.code == "uniqueness_not_guaranteed");
        let analysis = solution.diagnostics.analysis.expect("an analysis");
        assert_eq!(caveat, !analysis.uniqueness.is_certified(), "{}", analysis.because);
        analysis.uniqueness
    };
    // Two rates whose uniqueness is tested: with the rate sqrt(x) from 1, x = 1 + t + t^2/4 stays above one, where the
    // rate is Lipschitz; with sqrt(|x|) from -1/16, x reaches zero at t = 1/2, where the solution may stay at rest.
    assert_eq!(certified("sqrt(x)", 1.0), Uniqueness::LocallyUnique);
    assert_eq!(certified("sqrt(abs(x))", -0.0625), Uniqueness::ExistsNotCertified);
    assert_eq!(certified("1 + heaviside(x - 0.5)", 0.0), Uniqueness::NotCertified);
    assert_eq!(certified("1 + heaviside(x - 5)", 0.0), Uniqueness::LocallyUnique);
    assert_eq!(certified("1 + abs(x - 0.5)", 0.0), Uniqueness::Unique);
}
