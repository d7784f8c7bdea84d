//! Functions of time that jump, and tables: compared with closed forms, at every edge and over long intervals without
//! events.

use crate::systems::harness::{last, solve};
use dvi::specification::Specification;
use serde_json::{Value, json};

#[track_caller]
fn assert_near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found:?} instead of {expected:?}");
}

fn rate(rate: &str, end: f64) -> Value {
    json!({"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": rate}}}}, "time": {"end": end}})
}

fn codes(document: &Value) -> Vec<(String, &'static str)> {
    let errors = Specification::from_json(document.to_string().as_bytes()).expect_err("refused");
    errors.into_iter().map(|error| (error.pointer, error.code)).collect()
}

#[test]
fn integrals_of_functions_that_jump_are_exact() {
    for (text, end, expected) in [
        // The integral of floor(t) to 5.5 is 0 + 1 + .. + 4, plus half of 5.
        ("floor(t)", 5.5, 12.5),
        ("ceil(t) - round(t)", 4.0, 2.0),
        ("mod(t, 2)", 7.0, 6.5),
        ("sawtooth(t, 0.5)", 10.25, 5.0625),
        ("triangle(t, 0.5)", 10.25, 5.125),
        ("pwm(t, 0.1, 0.3)", 10.05, 3.03),
        ("pulse(t, 500, 1e-3)", 1e3, 1e-3),
        ("if(t > 1 and t <= 3 or not t < 9, 2, -1)", 10.0, -1.0),
        ("if(mod(floor(t), 2) == 0, t, 0)", 4.0, 3.0),
        // The rate is a sum of several functions of time whose edges coincide.
        ("pwm(t, 0.2, 0.5) + sawtooth(t, 0.1) + (t >= 0.5) + floor(10*t)", 1.0, 0.5 + 0.5 + 0.5 + 4.5),
    ] {
        let solution = solve(&rate(text, end));
        assert!(solution.verdict.trusted, "{text}: {:?}", solution.verdict);
        assert_near(last(&solution, "x"), expected, 1e-10 * end);
    }
}

#[test]
fn a_filter_behind_a_switched_source_is_in_its_periodic_state() {
    // For i' = (u - i)/tau with u = 1 during a fraction d of each period T, the current at the end of a period is i =
    // (e^{dT/tau} - 1)/(e^{T/tau} - 1).
    let (tau, period, duty) = (2e-3, 1e-3, 0.3);
    let mut document = rate(&format!("(pwm(t, {period}, {duty}) - x)/{tau}"), 0.1);
    document["method"] = json!({"rtol": 1e-10, "atol": 1e-12});
    let solution = solve(&document);
    let growth = |time: f64| (time / tau).exp_m1();
    assert_near(last(&solution, "x"), growth(duty * period) / growth(period), 1e-8);
    assert!(solution.diagnostics.steps.accepted < 2_000, "{:?}", solution.diagnostics.steps);
}

#[test]
fn a_table_drives_an_oscillator() {
    // The load f(t) of x'' = -x + f(t) is linear from 0 to 1 at t = 1, to -1 at t = 2 and to 0 at t = 3: a sum of
    // ramps, each with the response s - sin s, where s is the time since its beginning.
    let mut document = rate("v", 10.0);
    document["problem"]["dvi"]["states"]["v"] = json!({"initial": 0, "rate": "-x + load(t)"});
    document["problem"]["dvi"]["tables"] = json!({"load": {"x": [0, 1, 2, 3], "y": [0, 1, -1, 0]}});
    document["method"] = json!({"rtol": 1e-10, "atol": 1e-12});
    let solution = solve(&document);
    let ramps = [(0.0, 1.0), (1.0, -3.0), (2.0, 3.0), (3.0, -1.0)];
    let expected: f64 = ramps.iter().map(|&(at, slope)| slope * ((10.0 - at) - (10.0_f64 - at).sin())).sum();
    assert_near(last(&solution, "x"), expected, 1e-8);
}

#[test]
fn no_step_passes_over_what_a_table_does() {
    // A tabulated load with a pulse of area 1 within two milliseconds, after 900 seconds at rest.
    for (interpolation, y, area) in [("linear", [0, 0, 1000, 0, 0], 1.0), ("previous", [0, 0, 1000, 0, 0], 1.0)] {
        let mut document = rate("load(t)", 1e3);
        document["problem"]["dvi"]["tables"] =
            json!({"load": {"x": [0, 900, 900.001, 900.002, 950], "y": y, "interpolation": interpolation}});
        assert_near(last(&solve(&document), "x"), area, 1e-9);
    }
    // Simpson's rule is exact for the cubic pieces of a monotone cubic interpolant, whose slope at the maximum is
    // zero.
    let mut document = rate("load(t)", 2.0);
    document["problem"]["dvi"]["tables"] = json!({"load": {"x": [0, 1, 2], "y": [0, 1, 0], "interpolation": "pchip"}});
    // Each half of the tabulated load is a cubic from 0 to 1 with the end slope (3*1 + 1)/2 = 2 and the slope 0 at the
    // top: its integral is 1/2 + (2 - 0)/12.
    assert_near(last(&solve(&document), "x"), 2.0 * (0.5 + 2.0 / 12.0), 1e-10);
}

#[test]
fn tables_of_states_are_solved_through_their_kinks() {
    // The tabulated slope is x for x < 0 and 2 x otherwise, and x' = 1 from -1: x passes the kink at t = 1.
    let mut document = rate("1 - 0*x", 2.0);
    document["problem"]["dvi"]["states"] =
        json!({"x": {"initial": -1, "rate": "1"}, "y": {"initial": 0, "rate": "slope(x)"}});
    document["problem"]["dvi"]["tables"] = json!({"slope": {"x": [-2, 0, 2], "y": [-2, 0, 4]}});
    document["method"] = json!({"rtol": 1e-9});
    assert_near(last(&solve(&document), "y"), -0.5 + 1.0, 1e-8);
}

#[test]
fn what_jumps_with_a_state_is_refused_and_so_are_points_that_make_no_table() {
    assert_eq!(codes(&rate("if(x > 1, 1, 2)", 1.0)), [("/problem/dvi/states/x/rate".to_owned(), "jump_of_unknown")]);
    let errors = Specification::from_json(rate("pwm(t, 1, x)", 1.0).to_string().as_bytes()).expect_err("refused");
    assert!(errors[0].expected.as_deref().is_some_and(|expected| expected.contains("sawtooth(t, T) - d")));
    let mut document = rate("f(t)", 1.0);
    for (table, place, code) in [
        (json!({"x": [0, 2, 1], "y": [0, 0, 0]}), "/x/2", "not_increasing"),
        (json!({"x": [0, 1], "y": [0]}), "/y", "wrong_count"),
        (json!({"x": [0], "y": [0]}), "/x", "too_few_members"),
        (json!({"x": [0, 1], "y": [0, 1], "interpolation": "cubic"}), "/interpolation", "unknown_choice"),
        (json!({"x": [0, 1], "y": [0, 1], "z": 0}), "/z", "unknown_key"),
        (json!({"x": [0, 5e-324], "y": [0, 1]}), "/y", "not_finite"),
    ] {
        document["problem"]["dvi"]["tables"] = json!({"f": table});
        assert_eq!(codes(&document), [(format!("/problem/dvi/tables/f{place}"), code)]);
    }
    document["problem"]["dvi"]["tables"] = json!({"x": {"x": [0, 1], "y": [0, 1]}});
    assert!(codes(&document).iter().any(|(_, code)| *code == "duplicate_name"));
}

#[test]
fn tables_and_jumps_serve_parameters_and_what_is_bound_to_others() {
    let mut document = rate("k*pwm(t, T, d)", 1.0);
    let problem = &mut document["problem"]["dvi"];
    problem["parameters"] = json!({"k": "f(0.5) + floor(m)", "m": 2.7, "T": 0.25, "d": 0.5});
    problem["tables"] = json!({"f": {"x": [0, 1], "y": [1, 2]}});
    assert_near(last(&solve(&document), "x"), 3.5 * 0.5, 1e-10);
    let specification = Specification::from_json(document.to_string().as_bytes()).expect("a specification");
    assert!(specification.with_parameters(&[("d", 0.25), ("T", 0.1)]).is_ok());
    for (name, value) in [("d", 50.0), ("T", 0.0), ("T", -1.0)] {
        let errors = specification.with_parameters(&[(name, value)]).expect_err("out of its range");
        assert_eq!(errors[0].code, "structure_changes", "{errors:?}");
        document["problem"]["dvi"]["parameters"][name] = json!(value);
        assert_eq!(codes(&document)[0].1, "out_of_range");
        document["problem"]["dvi"]["parameters"] = json!({"k": 1, "m": 2.7, "T": 0.25, "d": 0.5});
    }
}
