//! Gradients in adjoint mode, held to closed forms and to forward mode on the same tolerances: on smooth motion, through
//! switches with jumping rates, along sliding, across time events that depend on a parameter; at a cost that does not
//! depend on the number of parameters; and refused where they do not exist.

use crate::systems::harness::{last, solve};
use dvi::problem::Control;
use dvi::solution::{Solution, Status};
use dvi::specification::Specification;
use serde_json::{Value, json};

/// A run to `end` with the gradient of an objective.
fn gradient(problem: &Value, end: f64, to: &[&str], objective: Value) -> Solution {
    let solution = solve(&json!({"problem": problem, "time": {"end": end}, "method": {"rtol": 1e-11, "atol": 1e-13},
        "output": {"times": [end]},
        "sensitivities": {"to": to, "mode": "adjoint", "objective": objective}}));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    solution
}

#[track_caller]
fn assert_near(found: f64, expected: f64, part: f64, name: &str) {
    assert!((found - expected).abs() <= part * expected.abs().max(1.0), "{name}: {found:e} for {expected:e}");
}

/// Holds the gradients of each state at the end to its derivatives in forward mode.
#[track_caller]
fn assert_forward(problem: &Value, end: f64, to: &[&str], of: &[&str]) {
    let forward = solve(&json!({"problem": problem, "time": {"end": end}, "method": {"rtol": 1e-11, "atol": 1e-13},
        "output": {"times": [end]}, "sensitivities": {"to": to, "of": of}}));
    for of in of {
        let adjoint = gradient(problem, end, to, json!({"final": of}));
        for to in to {
            let name = format!("d{of}/d{to}");
            assert_near(adjoint.gradient[*to], last(&forward, &name), 1e-9, &name);
        }
    }
}

fn oscillator() -> Value {
    json!({"dvi": {"parameters": {"k": 4, "m": 1, "a": 2}, "mass": [[1, 0], [0, "m"]],
        "states": {"x": {"initial": "a", "rate": "v"}, "v": {"initial": 0, "rate": "-k*x"}}}})
}

#[test]
fn the_gradient_of_a_linear_oscillator_is_that_of_its_solution() {
    let to = ["k", "m", "a", "v.initial"];
    let solution = gradient(&oscillator(), 3.0, &to, json!({"final": "k*x^2"}));
    // x = a cos wt with w^2 = k/m, dw/dk = w/2k, dw/dm = -w/2m.
    let (w, t) = (2.0_f64, 3.0);
    let (x, by_w) = (2.0 * (w * t).cos(), -2.0 * t * (w * t).sin());
    let slopes = [by_w * w / 8.0, -by_w * w / 2.0, (w * t).cos(), (w * t).sin() / w];
    for (k, (name, slope)) in to.iter().zip(slopes).enumerate() {
        let own = if k == 0 { x * x } else { 0.0 };
        assert_near(solution.gradient[*name], 8.0 * x * slope + own, 1e-9, name);
    }
    assert_near(solution.objective.expect("an objective"), 4.0 * x * x, 1e-9, "the objective");
    let checked = solution.sensitivities.expect("a check");
    assert_eq!(checked.of, "objective");
    assert!((checked.derivative - checked.finite_difference).abs() <= 20.0 * checked.uncertainty);
    assert_forward(&oscillator(), 3.0, &to, &["x", "v"]);
}
