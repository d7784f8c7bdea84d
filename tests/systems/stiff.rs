//! Stiff problems without variables, over six decades of tolerance, against references in quadruple precision.

use crate::systems::harness::solve;
use crate::systems::reference::{digits, read};
use serde_json::{Value, json};

/// A problem of `tests/reference/smooth.json` as a specification.
fn specification(problem: &Value, rtol: f64) -> Value {
    let equations = problem["equations"].as_array().expect("equations");
    let states: serde_json::Map<String, Value> = equations
        .iter()
        .enumerate()
        .map(|(i, rate)| (format!("y{}", i + 1), json!({"initial": problem["y0"][i], "rate": rate})))
        .collect();
    let atol = rtol * problem["atol_factor"].as_f64().expect("a factor");
    let mut dvi = json!({"parameters": problem["params"], "states": states});
    if !problem["mass"].is_null() {
        dvi["mass"] = problem["mass"].clone();
    }
    json!({
        "problem": {"dvi": dvi},
        "time": {"start": problem["t0"], "end": problem["t1"]},
        "method": {"rtol": rtol, "atol": atol},
        "output": {"times": [problem["t1"]]},
    })
}

/// `max_i |y_i - reference_i| / max(|reference_i|, floor_i)` at the end, over `rtol`.
fn error(problem: &Value, rtol: f64) -> f64 {
    let solution = solve(&specification(problem, rtol));
    let reference = problem["reference"].as_array().expect("a reference");
    let errors = reference.iter().enumerate().map(|(i, exact)| {
        let exact = digits(exact);
        let value = solution.trajectory.field(&format!("y{}", i + 1)).expect("a state")[0];
        (value - exact).abs() / exact.abs().max(problem["floor"][i].as_f64().expect("a floor"))
    });
    errors.fold(0.0, f64::max) / rtol
}

#[test]
fn errors_stay_within_thirty_times_the_tolerance() {
    let problems = read("tests/reference/smooth.json")["problems"].take();
    for problem in problems.as_array().expect("problems") {
        let name = problem["name"].as_str().expect("a name");
        if !["robertson", "vdp3", "vdp6", "hires", "pollu"].contains(&name) {
            continue;
        }
        for exponent in 3..=9 {
            let rtol = 10.0_f64.powi(-exponent);
            let error = error(problem, rtol);
            println!("{name} rtol {rtol:e}: {error:.3}");
            assert!(error <= 30.0, "{name} at rtol {rtol:e}: error {error} rtol");
        }
    }
}
