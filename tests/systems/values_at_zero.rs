//! Parameters whose initial value is zero: derivatives, fits and branches of equations in which the terms of these
//! parameters are absent at the start, compared with closed-form solutions.

use crate::systems::harness::{column, last, solve};
use dvi::problem::Control;
use dvi::solution::Status;
use dvi::specification::Specification;
use serde_json::{Value, json};

#[track_caller]
fn assert_near(found: f64, exact: f64, tolerance: f64) {
    assert!((found - exact).abs() <= tolerance * exact.abs().max(1.0), "{found:?} for {exact:?}");
}

fn derived(problem: &Value, to: &[&str]) -> dvi::solution::Solution {
    let solution = solve(&json!({"problem": problem, "time": {"end": 1}, "method": {"rtol": 1e-10, "atol": 1e-12},
        "sensitivities": {"to": to}}));
    assert!(solution.verdict.trusted && solution.verdict.caveats.is_empty(), "{:?}", solution.verdict);
    solution
}

/// Specification of Bernoulli's equation `x' = a x^2 - b x` from the initial value 1, at `a = 0`.
fn bernoulli() -> Value {
    json!({"dvi": {"parameters": {"a": 0, "b": 1}, "states": {"x": {"initial": 1, "rate": "a*x^2 - b*x"}}}})
}

#[test]
fn the_derivative_by_the_coefficient_of_an_absent_term() {
    let solution = derived(&bernoulli(), &["a", "b"]);
    let decayed = (-1.0_f64).exp();
    assert_near(last(&solution, "dx/da"), decayed * (1.0 - decayed), 1e-9);
    assert_near(last(&solution, "dx/db"), -decayed, 1e-9);
}

#[test]
fn the_derivative_of_a_motion_by_a_damping_that_is_absent() {
    // A damped oscillator with the damping c has x = exp(-c t/2) (cos wt + c/2w sin wt), w^2 = k - c^2/4.
    let problem = json!({"mechanical": {"parameters": {"c": 0, "k": 4}, "mass": [[1]],
        "coordinates": {"x": {"initial": 1, "velocity": 0}}, "forces": {"x": "-k*x - c*x_dot"}}});
    let solution = solve(&json!({"problem": problem, "time": {"end": 1}, "sensitivities": {"to": ["c"]},
        "method": {"impacts": "locate", "rtol": 1e-10, "atol": 1e-12}}));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let w = 2.0_f64;
    assert_near(last(&solution, "dx/dc"), -0.5 * w.cos() + w.sin() / (2.0 * w), 1e-8);
}

#[test]
fn the_derivative_by_an_entry_of_a_matrix_that_is_zero() {
    // For x' = -x + a y with y = exp(-2t), dx/da = exp(-t) - exp(-2t), while z = 0.
    let problem = json!({"lcs": {"parameters": {"a": 0}, "A": [[-1, "a"], [0, -2]], "B": [[1], [0]], "C": [[1, 0]],
        "D": [[1]], "initial": [1, 1], "set": [{"nonnegative": ["z1"]}]}});
    let solution = derived(&problem, &["a"]);
    let exact = (-1.0_f64).exp() - (-2.0_f64).exp();
    assert_near(last(&solution, "dx1/da"), exact, 1e-9);
}

#[test]
fn a_fit_that_begins_at_zero_finds_values_that_are_not() {
    // Bernoulli's equation has the solution 1/x = a/b + (1 - a/b) exp(b t).
    let (a, b) = (0.3, 1.2_f64);
    let t: Vec<f64> = (1..=8).map(|i| f64::from(i) / 8.0).collect();
    let x: Vec<f64> = t.iter().map(|t| (a / b + (1.0 - a / b) * (b * t).exp()).recip()).collect();
    let solution = solve(&json!({"problem": bernoulli(), "time": {"end": 1}, "method": {"rtol": 1e-10, "atol": 1e-12},
        "fit": {"parameters": {"a": {}, "b": {}}, "data": {"t": t, "x": x, "sd": 1e-3}}}));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let fit = solution.fit.expect("a fit");
    assert_near(fit.parameters["a"].estimate, a, 1e-6);
    assert_near(fit.parameters["b"].estimate, b, 1e-6);
}

#[test]
fn a_fit_of_an_exponent_that_begins_at_a_whole_number() {
    // The equation x' = -x^p has the solution x = (1 + (p - 1) t)^(-1/(p - 1)).
    let p = 2.5;
    let t: Vec<f64> = (1..=6).map(|i| f64::from(i) / 6.0).collect();
    let x: Vec<f64> = t.iter().map(|t| (1.0 + (p - 1.0) * t).powf(-1.0 / (p - 1.0))).collect();
    let problem = json!({"dvi": {"parameters": {"p": 2}, "states": {"x": {"initial": 1, "rate": "-x^p"}}}});
    let solution = solve(&json!({"problem": problem, "time": {"end": 1}, "method": {"rtol": 1e-10, "atol": 1e-12},
        "fit": {"parameters": {"p": {}}, "data": {"t": t, "x": x, "sd": 1e-3}}}));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    assert_near(solution.fit.expect("a fit").parameters["p"].estimate, p, 1e-6);
}

#[test]
fn a_branch_over_a_parameter_that_is_zero_in_the_problem() {
    // The branch of equilibria 0 = a x - x^3 + 1/10, from a = -1 to 1.
    let problem =
        json!({"dvi": {"parameters": {"a": 0}, "states": {"x": {"initial": 0.1, "rate": "a*x - x^3 + 0.1"}}}});
    let solution = solve(&json!({"problem": problem, "method": {"rtol": 1e-10, "atol": 1e-12},
        "steady_state": {"continue": {"parameter": "a", "from": -1, "to": 1}}}));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let branch = solution.branch.expect("a branch");
    let a = branch.parameter.last().copied().unwrap();
    let x = solution.steady_state.expect("a steady state").states["x"];
    assert_near(a, 1.0, 1e-12);
    assert_near(a * x - x.powi(3), -0.1, 1e-8);
    assert!(branch.parameter.len() > 20 && x > 1.0, "{x}");
}

#[test]
fn a_steady_state_at_zero_is_zero() {
    let problem =
        json!({"dvi": {"states": {"x": {"initial": 0.3, "rate": "-x"}, "y": {"initial": 1, "rate": "1e-12 - y"}}}});
    let solution = solve(&json!({"problem": problem, "method": {"atol": 1e-15}, "steady_state": {}}));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let states = solution.steady_state.expect("a steady state").states;
    assert_eq!(states["x"], 0.0);
    assert!((states["y"] - 1e-12).abs() < 1e-20, "{:e}", states["y"]);
}

#[test]
fn a_parameter_that_decides_the_structure_is_refused_with_what_to_write() {
    // A mass of zero makes its row algebraic, and a friction coefficient of zero removes the friction law.
    let of_mass =
        json!({"dvi": {"parameters": {"m": 0}, "mass": [["m"]], "states": {"x": {"initial": 0, "rate": "1 - x"}}}});
    let of_friction = json!({"mechanical": {"parameters": {"m": 0}, "mass": [[1]],
        "coordinates": {"x": {"initial": 0, "velocity": 1}}, "forces": {"x": 0},
        "contacts": [{"name": "floor", "gap": "1 + 0*x", "friction": {"coefficient": "m", "slip": ["x_dot"]}}]}});
    for (problem, analysis, place) in [
        (&of_mass, json!({"sensitivities": {"to": ["m"]}}), "/sensitivities/to/0"),
        (
            &of_mass,
            json!({"fit": {"parameters": {"m": {}}, "data": {"t": [1], "x": [1], "sd": 1}}}),
            "/fit/parameters/m",
        ),
        (
            &of_mass,
            json!({"steady_state": {"continue": {"parameter": "m", "to": 1}}}),
            "/steady_state/continue/parameter",
        ),
        (&of_friction, json!({"sensitivities": {"to": ["m"]}}), "/sensitivities/to/0"),
    ] {
        let mut document = analysis;
        document["problem"] = problem.clone();
        document["time"] = json!({"end": 1});
        document["method"] = json!({"impacts": "locate"});
        let errors = Specification::from_json_with(document.to_string().as_bytes(), &Control::new()).unwrap_err();
        let error = errors.iter().find(|error| error.pointer == place).unwrap_or_else(|| panic!("{errors:?}"));
        assert!(error.detail.contains("`m` decides the structure"), "{error:?}");
        assert!(error.expected.as_ref().is_some_and(|text| text.contains("another value than 0")), "{error:?}");
    }
}

#[test]
fn the_derivative_by_the_amplitude_of_a_fast_force_that_is_not_there() {
    // The derivative s = dx/dA solves s' = -s/10 + sin 40 t from 0, while x hardly moves.
    let exact = |t: f64| (0.1 * (40.0 * t).sin() - 40.0 * (40.0 * t).cos() + 40.0 * (-0.1 * t).exp()) / 1600.01;
    for amplitude in [0.0, 1e-8, 1e-6, 1e-4] {
        let problem = json!({"dvi": {"parameters": {"A": amplitude},
            "states": {"x": {"initial": 1, "rate": "-0.1*x + A*sin(40*t)"}}}});
        let solution = solve(&json!({"problem": problem, "time": {"end": 10}, "output": {"times": [0, 3, 7.5]},
            "sensitivities": {"to": ["A"]}}));
        assert!(solution.verdict.trusted, "{amplitude}: {:?}", solution.verdict);
        for (&t, &found) in solution.trajectory.t.iter().zip(column(&solution, "dx/dA")) {
            assert_near(found, exact(t), 1e-4);
        }
    }
    let gradient = solve(&json!({"problem": {"dvi": {"parameters": {"A": 0},
        "states": {"x": {"initial": 1, "rate": "-0.1*x + A*sin(40*t)"}}}}, "time": {"end": 10},
        "sensitivities": {"to": ["A"], "mode": "adjoint", "objective": {"final": "x"}}}));
    assert_near(gradient.gradient["A"], exact(10.0), 1e-4);
}

#[test]
fn the_derivative_of_the_impulse_of_friction_that_holds_a_force_that_is_not_there() {
    // The body sticks with the friction force F = A sin wt: the derivative of the integral of F by A is (1 - cos wt)/w.
    let problem = json!({"dvi": {"parameters": {"A": 0, "w": 3}, "states": {"v": {"initial": 0, "rate": "A*sin(w*t) - F"},
        "J": {"initial": 0, "rate": "F"}}, "variables": {"F": {"inequality": "-v"}},
        "set": [{"box": {"of": ["F"], "lower": -1, "upper": 1}}]}});
    let solution = solve(&json!({"problem": problem, "time": {"end": 20}, "output": {"times": {"count": 21}},
        "sensitivities": {"to": ["A"], "of": ["J"]}}));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    for (&t, &found) in solution.trajectory.t.iter().zip(column(&solution, "dJ/dA")) {
        assert_near(found, (1.0 - (3.0 * t).cos()) / 3.0, 1e-4);
    }
}

#[test]
fn a_negative_number_has_no_derivative_by_its_exponent() {
    let problem = json!({"dvi": {"parameters": {"n": 2}, "states": {"x": {"initial": -1, "rate": "x^n"}}}});
    let document = json!({"problem": problem, "time": {"end": 1}, "sensitivities": {"to": ["n"]}});
    let specification = Specification::from_json(document.to_string().as_bytes()).unwrap();
    let solution = dvi::solve(&specification, &Control::new());
    assert!(!solution.verdict.trusted && solution.status != Status::Completed, "{:?}", solution.verdict);
}
