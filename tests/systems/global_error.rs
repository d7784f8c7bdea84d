//! The estimate of the global error, compared with the true error on systems with known solutions.

use super::harness::{last, solve};
use super::reference;
use serde_json::{Value, json};

/// Returns the ratio of the estimated to the true global error of each state.
fn quotients(mut specification: Value, method: &Value, exact: &[(&str, f64)]) -> Vec<f64> {
    specification["method"] = method.clone();
    specification["output"] = json!({"times": {"count": 2}, "global_error": true});
    let solution = solve(&specification);
    let estimate = solution.diagnostics.global_error.as_ref().unwrap_or_else(|| panic!("{:?}", solution.diagnostics));
    let told = |name: &str| estimate.states.iter().find(|(state, _)| state == name).unwrap().1;
    exact.iter().map(|(name, x)| told(name) / (last(&solution, name) - x)).collect()
}

/// Asserts that the estimated global error of each state is between half and twice the true one, sign included, at
/// every tolerance.
fn assert_close(specification: &Value, exact: &[(&str, f64)]) {
    let tolerances = [1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9];
    let methods = tolerances.map(|rtol| json!({"rtol": rtol, "atol": rtol}));
    let found: Vec<f64> = methods.iter().flat_map(|method| quotients(specification.clone(), method, exact)).collect();
    assert!(found.iter().all(|quotient| (0.5..2.0).contains(quotient)), "{found:?}");
}

#[test]
fn the_estimate_is_near_the_error_of_a_linear_system() {
    let specification = json!({"problem": {"dvi": {"states": {
        "x": {"initial": 1, "rate": "y"}, "y": {"initial": 0, "rate": "-x"}}}}, "time": {"end": 10}});
    assert_close(&specification, &[("x", 10.0_f64.cos()), ("y", -10.0_f64.sin())]);
}

#[test]
fn the_estimate_is_near_the_error_where_errors_grow() {
    // A perturbation of the initial value 0.01 of the logistic equation grows by the factor e^5 / (1 + 0.01 (e^5 -
    // 1))^2 = 24 up to the end.
    let specification = json!({"problem": {"dvi": {"states": {"x": {"initial": 0.01, "rate": "x*(1 - x)"}}}},
        "time": {"end": 5}});
    let exact = 0.01 * 5.0_f64.exp() / (1.0 + 0.01 * (5.0_f64.exp() - 1.0));
    assert_close(&specification, &[("x", exact)]);
}

#[test]
fn the_estimate_is_near_the_error_through_switches() {
    for (name, example, states) in [
        ("friction_oscillator_belt", "friction_belt", ["x", "v", ""]),
        ("diode_bridge_filter", "diode_bridge_filter", ["v", "i", "v_filter"]),
    ] {
        let end = &reference::switching(name)["x_T"];
        let states = states.into_iter().enumerate().filter(|(_, state)| !state.is_empty());
        let exact: Vec<(&str, f64)> = states.map(|(i, state)| (state, reference::digits(&end[i]))).collect();
        assert_close(&reference::example(example), &exact);
    }
}

#[test]
fn a_fixed_step_is_estimated_by_half_of_it() {
    let specification =
        json!({"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "-x*x"}}}}, "time": {"end": 4}});
    for (stages, step) in [(1, 0.01), (2, 0.1), (3, 0.25), (4, 0.5)] {
        let method = json!({"stages": stages, "step": step, "rtol": 1e-13});
        let found = quotients(specification.clone(), &method, &[("x", 0.2)]);
        assert!((found[0] - 1.0).abs() < 0.2, "{stages} stages: {found:?}");
    }
}

#[test]
fn nothing_is_estimated_that_was_not_asked_for() {
    let specification =
        json!({"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "-x"}}}}, "time": {"end": 1}});
    assert_eq!(solve(&specification).diagnostics.global_error, None);
}
