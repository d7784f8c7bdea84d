//! The order `2s - 1` of Radau IIA methods with `s` stages holds over whole trajectories with switches, for the
//! states `x` at the end and for the switch times, with s = 1, 2, 3 and a fixed step size between switches.

use crate::systems::harness::{last, solve};
use crate::systems::reference::{digits, example, switching};
use dvi::solution::Solution;
use serde_json::{Value, json};

/// A test system with its exact final state and switch times.
pub struct System {
    pub specification: Value,
    /// The exact states of the system at the end of the run.
    pub end: Vec<(&'static str, f64)>,
    /// The exact times at which the active set of the solution changes.
    pub switches: Vec<f64>,
    /// Number of steps of the coarsest run of a sequence, for s = 1, 2, 3 stages.
    pub coarsest: [usize; 3],
}

/// Returns the largest error of a run in the states at the end, relative to the largest state, and in the switch times,
/// relative to the horizon.
fn errors(system: &System, stages: usize, steps: usize) -> (f64, f64) {
    let mut specification = system.specification.clone();
    let end = specification["time"]["end"].as_f64().expect("an end");
    specification["method"] = json!({"stages": stages, "step": end / steps as f64, "rtol": 1e-13, "atol": 1e-16});
    specification["output"] = json!({"times": [end]});
    let solution = solve(&specification);
    let scale = system.end.iter().map(|(_, exact)| exact.abs()).fold(0.0, f64::max);
    let state = |(name, exact): &(&str, f64)| (last(&solution, name) - exact).abs() / scale;
    (system.end.iter().map(state).fold(0.0, f64::max), switch_error(system, &solution) / end)
}

/// The largest distance of an exact switch time from the nearest event of a solution.
fn switch_error(system: &System, solution: &Solution) -> f64 {
    let nearest = |exact: &f64| {
        solution.trajectory.events.iter().map(|event| (event.t - exact).abs()).fold(f64::INFINITY, f64::min)
    };
    system.switches.iter().map(nearest).fold(0.0, f64::max)
}

/// The observed order of convergence: the slope of -log(error) over log(steps), fitted by least squares to a sequence
/// of runs with ever more steps.
fn slope(ladder: &[(usize, f64)]) -> f64 {
    let points: Vec<(f64, f64)> = ladder.iter().map(|&(steps, error)| ((steps as f64).ln(), error.ln())).collect();
    let count = points.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / count;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let covariance: f64 = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    -covariance / points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>()
}

pub fn assert_order(system: &System) {
    for s in 1..=3 {
        let ladder: Vec<usize> = (0..5).map(|k| system.coarsest[s - 1] << k).collect();
        let errors: Vec<(usize, (f64, f64))> = ladder.iter().map(|&steps| (steps, errors(system, s, steps))).collect();
        let above = |pick: fn(&(f64, f64)) -> f64| -> Vec<(usize, f64)> {
            errors.iter().map(|(steps, error)| (*steps, pick(error))).filter(|(_, error)| *error > 1e-12).collect()
        };
        let expected = (2 * s - 1) as f64 - 0.3;
        for (what, ladder) in [("x at the end", above(|error| error.0)), ("switch times", above(|error| error.1))] {
            if ladder.is_empty() && what == "switch times" {
                // If the switching function of a system depends on time alone, the switch times have no error above
                // rounding.
                continue;
            }
            assert!(ladder.len() >= 3, "s = {s}, {what}: too few runs above rounding, {ladder:?}");
            let order = slope(&ladder[ladder.len() - 3..]);
            assert!(order >= expected, "s = {s}, {what}: order {order} from {ladder:?}");
        }
    }
}

fn ends(reference: &Value, names: &[&'static str]) -> Vec<(&'static str, f64)> {
    names.iter().enumerate().map(|(i, &name)| (name, digits(&reference["x_T"][i]))).collect()
}

fn modes(reference: &Value) -> Vec<f64> {
    reference["modes"].as_array().expect("modes").iter().skip(1).map(|mode| digits(&mode[0])).collect()
}

#[test]
fn the_friction_oscillator() {
    let reference = switching("friction_oscillator_belt");
    assert_order(&System {
        specification: example("friction_belt"),
        end: ends(&reference, &["x", "v"]),
        switches: modes(&reference),
        coarsest: [2000, 80, 20],
    });
}

#[test]
fn the_sliding_mode() {
    let reference = switching("sliding_mode");
    assert_order(&System {
        specification: example("sliding_mode"),
        end: ends(&reference, &["x1", "x2"]),
        switches: vec![digits(&reference["t_hit"])],
        coarsest: [40, 10, 4],
    });
}

#[test]
fn the_filtered_bridge() {
    let reference = switching("diode_bridge_filter");
    // The coil current of the filter is a thousand times smaller than the voltages; all errors are relative to the
    // largest value.
    assert_order(&System {
        specification: example("diode_bridge_filter"),
        end: ends(&reference, &["v", "i", "v_filter"]),
        switches: modes(&reference),
        coarsest: [8000, 200, 80],
    });
}

#[test]
fn the_switching_circle() {
    let tau = 2.0 * std::f64::consts::PI;
    let end = std::f64::consts::FRAC_PI_2;
    // A Filippov system with z = 1 inside the unit circle, where the vector field turns one way, and z = 0 outside,
    // where it turns the other way.
    let specification = json!({
        "problem": {"dvi": {
            "parameters": {"w": "2*pi"},
            "states": {
                "x": {"initial": "exp(-1)", "rate": "x + w*(1 - 2*z)*y"},
                "y": {"initial": 0, "rate": "y - w*(1 - 2*z)*x"}
            },
            "variables": {"z": {"inequality": "x^2 + y^2 - 1"}},
            "set": [{"box": {"of": ["z"], "lower": 0, "upper": 1}}]
        }},
        "time": {"end": end}
    });
    let radius = (end - 1.0).exp();
    let angle = tau * (end - 1.0);
    assert_order(&System {
        specification,
        end: vec![("x", radius * angle.cos()), ("y", -radius * angle.sin())],
        switches: vec![1.0],
        coarsest: [1000, 40, 20],
    });
}
