//! Steps of a given size: what they are worth is estimated, and runs whose steps are too long are not trusted.

use super::{assert_trusted, reasons, solve};
use crate::systems::harness::{distance, last};
use dvi::solution::CheckCode;
use serde_json::{Value, json};

/// Whether a run with steps of this size is trusted, and its largest error at the outputs.
fn judged(mut system: Value, step: f64, exact: impl Fn(f64) -> f64) -> (bool, f64) {
    if system["method"].is_null() {
        system["method"] = json!({});
    }
    system["method"]["step"] = json!(step);
    if let Some(stages) = system.as_object_mut().and_then(|system| system.remove("stages")) {
        system["method"]["stages"] = stages;
    }
    let solution = solve(&system);
    let name = if solution.trajectory.fields.iter().any(|field| field.name == "x") { "x" } else { "u" };
    let error = distance(&solution, name, exact);
    if !solution.verdict.trusted {
        assert!(reasons(&solution).contains(&CheckCode::LocalError), "step {step}: {:?}", solution.verdict);
    }
    (solution.verdict.trusted, error)
}

#[test]
fn a_run_that_is_trusted_has_three_digits_whatever_its_steps() {
    let oscillator = json!({"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "v"},
        "v": {"initial": 0, "rate": "-x"}}}}, "time": {"end": 20}, "output": {"times": {"count": 21}}});
    // In units of micrometres and on a slower clock it is the same oscillator.
    let small = json!({"problem": {"dvi": {"states": {"x": {"initial": 1e-6, "rate": "1e-3*v"},
        "v": {"initial": 0, "rate": "-1e-3*x"}}}}, "time": {"end": 2e4}, "output": {"times": {"count": 21}}, "stages": 3});
    // A Volterra equation with an interval that does not bind, and a rod that is heated to and fro.
    let memory = json!({"problem": {"convolution": {"variables": {"u": {"q": "-sin(t)"}},
        "kernel": {"entries": [["exp(-t)"]]}, "set": [{"box": {"of": ["u"], "lower": -9, "upper": 9}}]}},
        "time": {"end": 8}, "output": {"times": {"count": 9}}});
    let rod = json!({"problem": {"obstacle": {"domain": {"x": [0, 1]}, "elements": 200, "diffusion": 1,
        "source": "(pi^2*cos(20*t) - 20*sin(20*t))*sin(pi*x)", "initial": "sin(pi*x)",
        "boundary": {"x_min": {"dirichlet": 0}, "x_max": {"dirichlet": 0}}, "probes": {"u": [0.5]}}},
        "time": {"end": 2}, "output": {"times": {"count": 9}, "fields": ["u"]}});
    let with = |system: &Value, stages: u32| {
        let mut system = system.clone();
        system["stages"] = json!(stages);
        system
    };
    type Exact = fn(f64) -> f64;
    let cases: [(&str, Value, Exact, f64, [f64; 3]); 6] = [
        ("three stages", with(&oscillator, 3), f64::cos, 1.0, [2.0, 0.5, 0.1]),
        ("five stages", with(&oscillator, 5), f64::cos, 1.0, [4.0, 1.0, 0.25]),
        ("Euler", with(&oscillator, 1), f64::cos, 1.0, [0.5, 0.1, 2e-5]),
        ("small", small, |t| 1e-6 * (1e-3 * t).cos(), 1e-6, [2e3, 5e2, 1e2]),
        ("memory", memory, |t| t.sin() + t.cos(), 1.0, [2.0, 0.5, 0.01]),
        ("rod", rod, |t| (20.0 * t).cos(), 1.0, [0.2, 0.1, 2.5e-4]),
    ];
    for (name, system, exact, size, [long, middle, short]) in cases {
        let [(first, lost), (second, error), (third, least)] =
            [long, middle, short].map(|step| judged(system.clone(), step, exact));
        assert!(!first && third, "{name}: {first}, {second}, {third} with errors {lost:e}, {error:e}, {least:e}");
        assert!(lost > 1e-3 * size && least < 1e-3 * size, "{name}: {lost:e}, {least:e}");
        assert!(!second || error < 1e-3 * size, "{name}: {error:e}");
    }
}

#[test]
fn a_pulse_between_the_stages_of_a_given_step_is_doubted() {
    // The integral of the pulse is the root of pi.
    for centre in [0.437, 0.31, 0.77] {
        let pulse = format!("exp(-((t - {centre})/w)^2)/w");
        let system = json!({"problem": {"dvi": {"parameters": {"w": 0.002},
            "states": {"x": {"initial": 1, "rate": pulse}}}}, "time": {"end": 1}, "output": {"times": [1]}});
        let exact = |_: f64| 1.0 + std::f64::consts::PI.sqrt();
        let [(first, lost), (second, error)] = [0.1, 5e-4].map(|step| judged(system.clone(), step, exact));
        assert!(!first && second, "{centre}: {first}, {second}: {lost:e}, {error:e}");
        assert!(lost > 0.1 && error < 1e-3, "{centre}: {lost:e}, {error:e}");
    }
}

#[test]
fn a_layer_within_a_given_step_is_doubted_by_what_it_leaves() {
    let layer = |initial: f64, times: Value| {
        json!({"problem": {"dvi": {"states": {"x": {"initial": initial, "rate": "-1e4*(x - cos(t)) - sin(t)"}}}},
            "time": {"end": 1}, "output": {"times": times}})
    };
    let exact = |initial: f64| move |t: f64| t.cos() + (initial - 1.0) * (-1e4 * t).exp();
    let (within, lost) = judged(layer(2.0, json!([0.05, 1])), 0.1, exact(2.0));
    assert!(!within && lost > 0.1, "{lost:e}");
    // What an L-stable method leaves of the layer at the end of the step falls with the step size alone.
    let (at_ends, left) = judged(layer(2.0, json!([0.1, 0.5, 1])), 0.1, exact(2.0));
    assert!(!at_ends && left > 1e-3, "{left:e}");
    let (at_ends, error) = judged(layer(1.01, json!([0.1, 0.5, 1])), 0.1, exact(1.01));
    assert!(at_ends && error < 1e-4, "{error:e}");
    let (within, lost) = judged(layer(1.01, json!([0.05, 1])), 0.1, exact(1.01));
    assert!(!within && lost > 1e-3, "{lost:e}");
}

#[test]
fn a_state_that_an_inequality_holds_at_zero_is_trusted_and_a_small_one_is_not() {
    let held = |state: &str, method: Value| {
        let mut states = json!({"v": {"initial": 0, "rate": "0.4*sin(t)^2 - 1 + z"}});
        if state == "q" {
            states["q"] = json!({"initial": 0, "rate": "v"});
        }
        solve(&json!({"problem": {"dvi": {"states": states, "variables": {"z": {"inequality": "v"}},
            "set": [{"nonnegative": ["z"]}]}}, "time": {"end": 3}, "method": method, "output": {"times": [1, 3]}}))
    };
    for method in [json!({}), json!({"step": 0.1}), json!({"step": 1e-3})] {
        for state in ["v", "q"] {
            let solution = held(state, method.clone());
            assert_trusted(&solution);
            assert!(last(&solution, state).abs() < 1e-15);
            assert!((last(&solution, "z") - (1.0 - 0.4 * 3.0_f64.sin().powi(2))).abs() < 1e-9);
        }
    }
    // A state that decays to 1e-12 is as small, but nothing holds it, beside a state that something holds.
    let small = solve(&json!({"problem": {"dvi": {"states": {"v": {"initial": 0, "rate": "z - 1"},
        "c": {"initial": 0, "rate": "1e-12 - c"}}, "variables": {"z": {"inequality": "v"}}, "set": [{"nonnegative": ["z"]}]}},
        "time": {"end": 3}, "output": {"times": [3]}}));
    assert_eq!(reasons(&small), [CheckCode::LocalError], "{:?}", small.verdict);
}
