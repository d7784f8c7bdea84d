//! Runs with steps of a given size: their error is estimated, and runs whose steps are too long are not trusted.

use super::{assert_trusted, reasons, solve};
use crate::systems::harness::{distance, last};
use dvi::solution::CheckCode;
use serde_json::{Value, json};

/// Returns whether the verdict trusts a run with steps of the size `step`, and the largest error of the run at the
/// output times.
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
    // The harmonic oscillator with the amplitude 1e-6 and a period a thousand times as long.
    let small = json!({"problem": {"dvi": {"states": {"x": {"initial": 1e-6, "rate": "1e-3*v"},
        "v": {"initial": 0, "rate": "-1e-3*x"}}}}, "time": {"end": 2e4}, "output": {"times": {"count": 21}}, "stages": 3});
    // A Volterra equation whose bounds are not active, and a rod that is heated and cooled periodically.
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

/// Specification of a point of mass one over a floor.
fn over_floor(x: &Value, restitution: f64, end: f64) -> Value {
    json!({"problem": {"mechanical": {"coordinates": {"x": x}, "mass": [[1]], "potential": "9.81*x",
        "contacts": [{"name": "floor", "gap": "x", "restitution": restitution}]}},
        "time": {"end": end}, "output": {"times": {"count": 11}}})
}

#[test]
fn time_stepping_that_is_trusted_has_three_digits_whatever_its_steps() {
    const G: f64 = 9.81;
    let block = json!({"problem": {"mechanical": {"coordinates": {"x": {"initial": 0, "velocity": 2}, "y": {"initial": 0}},
        "mass": [[1, 0], [0, 1]], "potential": "9.81*y", "contacts": [{"name": "floor", "gap": "y",
        "friction": {"coefficient": 0.3, "slip": ["x_dot"]}}]}}, "time": {"end": 2}, "output": {"times": {"count": 11}}});
    let slides = |t: f64| {
        let t = t.min(2.0 / (0.3 * G));
        2.0 * t - 0.15 * G * t * t
    };
    let ball = over_floor(&json!({"initial": 1}), 0.8, 1.0);
    let bounces = |t: f64| {
        let impact = (2.0 / G).sqrt();
        let flown = t - impact;
        if flown < 0.0 { 1.0 - 0.5 * G * t * t } else { 0.8 * G * impact * flown - 0.5 * G * flown * flown }
    };
    let spring = json!({"problem": {"mechanical": {"coordinates": {"x": {"initial": 1}}, "mass": [[1]],
        "potential": "0.5*x^2"}}, "time": {"end": 3}, "method": {"impacts": "time_stepping"},
        "output": {"times": {"count": 11}}});
    // A ball hits another one of a third of its mass elastically, and keeps half of its speed.
    let pair = json!({"problem": {"mechanical": {"coordinates": {"x": {"initial": -0.37, "velocity": 1},
        "y": {"initial": 0}}, "mass": [[3, 0], [0, 1]], "contacts": [{"name": "hit", "gap": "y - x", "restitution": 1}]}},
        "time": {"end": 2}, "output": {"times": {"count": 11}}});
    let hits = |t: f64| if t < 0.37 { t - 0.37 } else { 0.5 * (t - 0.37) };
    // A sphere on the ground, pushed without spin, slides until it rolls with 5/7 of its speed.
    let rolls = |t: f64| {
        let until = 2.0 * 2.0 / (7.0 * 0.2 * G);
        let slid = t.min(until);
        2.0 * slid - 0.1 * G * slid * slid + 10.0 / 7.0 * (t - slid)
    };
    type Exact<'e> = &'e dyn Fn(f64) -> f64;
    let cases: [(&str, &Value, Exact<'_>, f64); 4] = [
        ("block", &block, &slides, 0.68),
        ("ball", &ball, &bounces, 1.0),
        ("spring", &spring, &f64::cos, 1.0),
        ("pair", &pair, &hits, 0.815),
    ];
    for (name, system, exact, size) in cases {
        let mut verdicts = Vec::new();
        for step in [0.1, 0.04, 0.03, 0.01, 7e-3, 3e-3, 1e-3, 4e-4, 1e-4, 3e-5] {
            let (is_trusted, error) = judged(system.clone(), step, exact);
            assert!(!is_trusted || error < 1e-3 * size, "{name}, step {step}: {error:e}");
            verdicts.push(is_trusted);
        }
        assert!(!verdicts[0] && !verdicts[1] && verdicts[9], "{name}: {verdicts:?}");
    }
    let sphere = |step: f64| {
        let solution = solve(
            &json!({"problem": {"rigid_bodies": {"gravity": [0, 0, -G], "contacts": {"friction": 0.2},
            "bodies": [{"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true},
            {"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 0.1], "velocity": [2, 0, 0]}]}},
            "time": {"end": 1}, "method": {"step": step, "impacts": "time_stepping"},
            "output": {"times": {"count": 11}, "fields": ["ball.x"]}}),
        );
        (solution.verdict.trusted, distance(&solution, "ball.x", rolls))
    };
    let [(first, lost), (second, error)] = [0.1, 1e-3].map(sphere);
    assert!(!first && second && lost > 2e-3 && error < 2e-3, "{first}, {second}: {lost:e}, {error:e}");
}

#[test]
fn located_impacts_between_steps_of_a_given_size_are_judged() {
    let spring = json!({"problem": {"mechanical": {"coordinates": {"x": {"initial": 1}}, "mass": [[1]],
        "potential": "0.5*x^2"}}, "time": {"end": 20}, "output": {"times": {"count": 21}}});
    for (step, trusted) in [(2.0, false), (0.1, true)] {
        let mut system = spring.clone();
        system["method"] = json!({"step": step, "stages": 3});
        let solution = solve(&system);
        let error = distance(&solution, "x", f64::cos);
        assert_eq!(solution.verdict.trusted, trusted, "{step}: {error:e}, {:?}", solution.verdict);
        assert_eq!(error < 1e-3, trusted, "{step}: {error:e}");
    }
}

#[test]
fn many_bodies_are_not_compared_and_the_verdict_says_so() {
    let scene = |count: usize| {
        let mut bodies = vec![json!({"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true})];
        bodies.extend((0..count).map(|k| {
            json!({"name": format!("s{k}"), "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [k, 0, 1]})
        }));
        solve(&json!({"problem": {"rigid_bodies": {"gravity": [0, 0, -9.81], "bodies": bodies}}, "time": {"end": 0.1},
            "method": {"step": 1e-2}, "output": {"times": [0.1]}}))
    };
    for (count, compared) in [(100, true), (101, false)] {
        let solution = scene(count);
        assert_trusted(&solution);
        let has_caveat = solution.verdict.caveats.iter().any(|caveat| caveat.code == "error_not_estimated");
        assert_eq!(has_caveat, !compared, "{count}: {:?}", solution.verdict.caveats);
        assert_eq!(solution.diagnostics.checks.get(CheckCode::LocalError).is_some(), compared);
        let z = 1.0 - 0.5 * 9.81 * 0.01;
        assert!((last(&solution, "s7.z") - z).abs() < 1e-12, "free fall: {}", last(&solution, "s7.z"));
    }
}

#[test]
fn a_pulse_between_the_stages_of_a_given_step_is_doubted() {
    // The integral of the Gaussian pulse in the rate is the square root of pi.
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
    // An L-stable method does not damp the boundary layer completely: a remainder, which depends on the step size, is
    // left at the end of the first step.
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
    // The state c, which tends to 1e-12, is as small as a state such as v that an inequality keeps at zero, but no
    // inequality acts on c: the result is not trusted.
    let small = solve(&json!({"problem": {"dvi": {"states": {"v": {"initial": 0, "rate": "z - 1"},
        "c": {"initial": 0, "rate": "1e-12 - c"}}, "variables": {"z": {"inequality": "v"}}, "set": [{"nonnegative": ["z"]}]}},
        "time": {"end": 3}, "output": {"times": [3]}}));
    assert_eq!(reasons(&small), [CheckCode::LocalError], "{:?}", small.verdict);
}
