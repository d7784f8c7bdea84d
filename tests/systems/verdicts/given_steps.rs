//! Steps of a given size: what they are worth is estimated, and runs whose steps are too long are not trusted.

use super::{reasons, solve};
use crate::systems::harness::distance;
use dvi::solution::CheckCode;
use serde_json::{Value, json};

/// Whether a run with steps of this size is trusted, and its largest error at the outputs.
fn judged(mut system: Value, step: f64, exact: impl Fn(f64) -> f64) -> (bool, f64) {
    system["method"] = json!({"step": step});
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
