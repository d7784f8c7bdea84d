//! Problems with memory (Volterra convolutions), compared with closed forms: Abel's kernel, reflections with many
//! switches, a relaxing kernel, and sets that are balls.

use crate::systems::harness::{column, distance, events, last, solve};
use crate::systems::reference::example;
use serde_json::{Value, json};

/// Returns the gamma function for `x > 0`, by its recurrence and Stirling's series.
pub fn gamma(x: f64) -> f64 {
    if x < 20.0 {
        return gamma(x + 1.0) / x;
    }
    let inverse = 1.0 / x;
    let square = inverse * inverse;
    let series = inverse * (1.0 / 12.0 - square * (1.0 / 360.0 - square * (1.0 / 1260.0 - square / 1680.0)));
    (std::f64::consts::TAU / x).sqrt() * (x * (x.ln() - 1.0) + series).exp()
}

/// Specification of a problem with memory: one variable `u >= 0` and the fractional kernel of the exponent `alpha`.
pub fn abel(alpha: f64, q: &str, end: f64, method: Value) -> Value {
    json!({
        "problem": {"convolution": {
            "variables": {"u": {"q": q}},
            "kernel": {"fractional": {"exponent": alpha}},
            "set": [{"nonnegative": ["u"]}]
        }},
        "time": {"end": end},
        "method": method
    })
}

#[test]
fn the_inverse_of_abels_integral_is_half_a_power() {
    // Abel's equation int (t-s)^(-1/2) u ds = t has the solution u = (2/pi) sqrt(t), whose integral to 1 is 4 / (3
    // pi).
    let kernels = [
        json!({"fractional": {"exponent": 0.5, "matrix": [["sqrt(pi)"]]}}),
        json!({"entries": [[1]], "exponent": 0.5}),
    ];
    for kernel in kernels {
        let solution = solve(&json!({
            "problem": {"convolution": {
                "variables": {"u": {"q": "-t"}},
                "kernel": kernel,
                "set": [{"nonnegative": ["u"]}]
            }},
            "time": {"end": 1},
            "method": {"step": 0.002}
        }));
        let exact = 2.0 / std::f64::consts::PI;
        assert!((last(&solution, "u") - exact).abs() < 1e-7, "{kernel}: {}", last(&solution, "u") - exact);
        let integral = last(&solution, "integral_u") - 2.0 / 3.0 * exact;
        assert!(integral.abs() < 1e-6, "{kernel}: {integral:e}");
        assert_eq!(solution.diagnostics.analysis.as_ref().and_then(|analysis| analysis.index), Some(0.5));
    }
}

#[test]
fn a_variable_starts_when_its_force_has_gone() {
    // Abel's equation with the kernel exponent a and q = (1-t)^m, m odd, has the solution u = Gamma(m+1)/Gamma(m+1-a)
    // (t-1)_+^(m-a).
    for (alpha, m) in [(0.25, 3), (0.5, 3), (0.75, 3), (1.0, 3), (1.5, 5)] {
        let document = abel(alpha, &format!("(1 - t)^{m}"), 2.0, json!({"step": 0.005}));
        let solution = solve(&document);
        let power = f64::from(m) - alpha;
        let factor = gamma(f64::from(m) + 1.0) / gamma(power + 1.0);
        let found = distance(&solution, "u", |t| factor * (t - 1.0).max(0.0).powf(power));
        assert!(found < 1e-4, "alpha = {alpha}: {found:e}");
        let starts = events(&solution, "u");
        assert!(starts.len() == 1 && (starts[0] - 1.0).abs() < 0.1, "alpha = {alpha}: {starts:?}");
    }
}

#[test]
fn the_step_is_halved_until_two_runs_agree() {
    let mut document = example("memory_abel");
    document["output"]["times"] = json!("steps");
    let solution = solve(&document);
    let refinement = solution.diagnostics.refinement.as_ref().expect("no step is given");
    assert!(refinement.scaled <= 1.0, "{refinement:?}");
    let factor = 1.0 / gamma(1.5);
    let pairs = solution.trajectory.t.iter().zip(column(&solution, "u"));
    let total: f64 = pairs.map(|(t, u)| (u - factor * (t - 1.0).max(0.0).sqrt()).abs()).sum();
    let mean = total / solution.trajectory.t.len() as f64;
    // The estimated mean distance is at least that between the returned run and the previous, coarser run, and must
    // exceed the error of the returned run.
    assert!(mean > 0.0 && mean < refinement.mean_distance[0].1, "{mean:e} against {refinement:?}");
    assert!(mean < 1e-4 * factor * 2.0_f64.sqrt());
}

#[test]
fn exponent_one_is_the_complementarity_system_of_an_integral() {
    // Reference by Skorokhod's reflection: from 0 <= z, 0 <= int z + q and complementarity, int z is the running
    // maximum of -q.
    let q = "0.2 - sin(t) - 0.1*t";
    let solution = solve(&abel(1.0, q, 10.0, json!({"step": 0.005})));
    let system = solve(&json!({
        "problem": {"lcs": {"A": [[0]], "B": [[1]], "C": [[1]], "D": [[0]], "g": [q], "initial": [0], "set": [{"nonnegative": ["z1"]}]}},
        "time": {"end": 10}, "method": {"rtol": 1e-9, "max_step": 0.005}, "output": {"times": {"every": 0.005}}
    }));
    let pairs = column(&solution, "integral_u").iter().zip(column(&system, "x1"));
    let most = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(most < 1e-5, "{most:e}");
    let mut largest = 0.0_f64;
    for (&t, &found) in solution.trajectory.t.iter().zip(column(&solution, "integral_u")) {
        largest = largest.max(t.sin() + 0.1 * t - 0.2);
        assert!((found - largest).abs() < 1e-5, "at {t}: {found}, not {largest}");
    }
}

#[test]
fn a_kernel_that_relaxes_is_a_differential_equation() {
    // The convolution w = exp(-t/tau) * z satisfies w' = z - w / tau, a differential variational inequality of index
    // one.
    let solution = solve(&json!({
        "problem": {"convolution": {
            "parameters": {"tau": 0.5},
            "variables": {"z": {"q": "-sin(2*t)"}},
            "kernel": {"entries": [["exp(-t/tau)"]]},
            "set": [{"box": {"of": ["z"], "lower": 0, "upper": 2.5}}]
        }},
        "time": {"end": 5}, "method": {"step": 0.005}
    }));
    let system = solve(&json!({
        "problem": {"dvi": {
            "states": {"w": {"initial": 0, "rate": "z - 2*w"}},
            "variables": {"z": {"inequality": "w - sin(2*t)"}},
            "set": [{"box": {"of": ["z"], "lower": 0, "upper": 2.5}}]
        }},
        "time": {"end": 5}, "method": {"rtol": 1e-10, "max_step": 0.005}, "output": {"times": {"every": 0.005}}
    }));
    let switches = events(&system, "z");
    assert_eq!(switches.len(), 7);
    for ((&t, w), found) in system.trajectory.t.iter().zip(column(&system, "w")).zip(column(&solution, "G_z")) {
        // If `z` becomes positive between two stages of a step, its upper bound may prevent the correction of `w`
        // within the step.
        let is_at_switch = switches.iter().any(|switch| (0.0..0.005).contains(&(t - switch)));
        let bound = if is_at_switch { 0.005 * 2.5 } else { 1e-5 };
        let exact = w - (2.0 * t).sin();
        assert!((exact - found).abs() < bound, "at {t}: {found}, not {exact}");
    }
}

#[test]
fn kernels_that_vanish_at_zero_have_a_higher_index() {
    // The solution of (t * z)(t) = t^3 is z = 6 t. The kernel is given as a power, as entries, and as entries
    // multiplied by a power.
    let kernels =
        [json!({"fractional": {"exponent": 2}}), json!({"entries": [["t"]]}), json!({"entries": [[1]], "exponent": 2})];
    for kernel in kernels {
        let solution = solve(&json!({
            "problem": {"convolution": {"variables": {"z": {"q": "-t^3"}}, "kernel": kernel, "set": [{"nonnegative": ["z"]}]}},
            "time": {"end": 1}, "method": {"step": 0.01}
        }));
        let found = distance(&solution, "z", |t| 6.0 * t);
        assert!(found < 1e-8, "{kernel}: {found:e}");
        assert_eq!(solution.diagnostics.analysis.as_ref().and_then(|analysis| analysis.index), Some(2.0));
        assert!(solution.verdict.caveats.iter().any(|caveat| caveat.code == "uniqueness_not_guaranteed"));
    }
}

#[test]
fn each_entry_has_an_index_of_its_own() {
    // The solution of 1 * z1 = t^3 is z1 = 3 t^2, and that of t * z2 = t^3 is z2 = 6 t, where * is the convolution.
    let solution = solve(&json!({
        "problem": {"convolution": {
            "variables": {"z1": {"q": "-t^3"}, "z2": {"q": "-t^3"}},
            "kernel": {"entries": [[1, 0], [0, "t"]]},
            "set": [{"free": ["z1", "z2"]}]
        }},
        "time": {"end": 1}, "method": {"step": 0.01}
    }));
    for (name, found) in
        [("z1", distance(&solution, "z1", |t| 3.0 * t * t)), ("z2", distance(&solution, "z2", |t| 6.0 * t))]
    {
        assert!(found < 1e-8, "{name}: {found:e}");
    }
}

#[test]
fn a_ball_holds_a_rotating_force() {
    // Inside the ball z solves I^a z = t^3 (c, s), with the fractional integral I^a; at its boundary G is normal to
    // the ball.
    let solution = solve(&json!({
        "problem": {"convolution": {
            "variables": {"x": {"q": "-0.6*t^3"}, "y": {"q": "-0.8*t^3"}},
            "kernel": {"fractional": {"exponent": 0.5}},
            "set": [{"ball": {"of": ["x", "y"], "radius": 1}}]
        }},
        "time": {"end": 1}, "method": {"step": 0.01}
    }));
    let factor = gamma(4.0) / gamma(3.5);
    let (x, y) = (column(&solution, "x"), column(&solution, "y"));
    for (i, t) in solution.trajectory.t.iter().enumerate() {
        let free = factor * t.powf(2.5);
        let norm = x[i].hypot(y[i]);
        assert!((0.8 * x[i] - 0.6 * y[i]).abs() < 1e-9, "the force turns at {t}");
        if free < 0.98 {
            assert!((norm - free).abs() < 1e-4, "at {t}: {norm}, not {free}");
        } else if free > 1.05 {
            assert!((norm - 1.0).abs() < 1e-9, "at {t}: {norm}");
        }
    }
}

#[test]
fn a_start_outside_is_told() {
    // For q = -1 from the start, u = t^(-1/2) / Gamma(1/2) is infinite at the start, and its integral is 2 sqrt(t /
    // pi).
    let solution = solve(&abel(0.5, "-1", 1.0, json!({"step": 0.001})));
    assert!(solution.diagnostics.warnings.iter().any(|warning| warning.code == "impulse_at_start"));
    let exact = 1.0 / std::f64::consts::PI.sqrt();
    assert!((last(&solution, "u") - exact).abs() < 1e-6, "{}", last(&solution, "u") - exact);
    assert!((last(&solution, "integral_u") - 2.0 * exact).abs() < 1e-3);
}

#[test]
fn of_several_runs_the_most_accurate_is_returned() {
    // A smallest step size selects uniform meshes. The kernel t^0.9 / Gamma(1.9) has the solution 2 t^0.1 /
    // Gamma(1.1) for the data t^2; rounding errors grow as h^-1.9 with the step size h.
    let problem = json!({
        "problem": {"convolution": {
            "variables": {"u": {"q": "-t^2"}},
            "kernel": {"fractional": {"exponent": 1.9}},
            "set": [{"free": ["u"]}]
        }},
        "time": {"end": 2},
        "method": {"min_step": 2.0 / 131072.0},
        "output": {"times": [0.5, 1, 2]}
    });
    let solution = solve(&problem);
    let exact = |t: f64| 2.0 * t.powf(0.1) / gamma(1.1);
    let error = distance(&solution, "u", exact);
    assert!(error < 2e-5, "off by {error:e}");
    let refinement = solution.diagnostics.refinement.as_ref().expect("an estimate");
    assert!(refinement.scaled > 1.0 && solution.diagnostics.steps.accepted < 65_536, "{refinement:?}");
    // The verdict on the run reports that the tolerance is not reached.
    assert!(!solution.verdict.trusted);
    let because: Vec<&str> = solution.verdict.because.iter().map(|reason| reason.code.name()).collect();
    assert_eq!(because, ["local_error"]);
}
