//! Invariance of mechanical motion under changes of units.

use crate::systems::harness::{last, solve};
use serde_json::{Value, json};

/// Scale factors of the units of mass, length and time in which each scene is written.
const UNITS: [[f64; 3]; 11] = [
    [1e13, 1.0, 1.0],
    [1e30, 1.0, 1.0],
    [1e-13, 1.0, 1.0],
    [1e-30, 1.0, 1.0],
    [1.0, 1e3, 1.0],
    [1.0, 1e-3, 1.0],
    [1.0, 1e12, 1.0],
    [1.0, 1e-12, 1.0],
    [1.0, 1.0, 1e9],
    [1.0, 1.0, 3.2e-8],
    [1e12, 1e-3, 1e6],
];

/// Returns a ball with spin that falls on a rough floor, written in the given units; the end time; and the fields to
/// compare with their units.
fn ball([m, l, t]: [f64; 3]) -> (Value, f64, Vec<(&'static str, f64)>) {
    let problem = json!({"parameters": {"m": m, "g": 9.81 * l / (t * t), "R": 0.1 * l},
        "coordinates": {"a": {"initial": 0}, "x": {"initial": 0, "velocity": 2.0 * l / t}, "y": {"initial": l}},
        "mass": [["0.4*m*R^2", 0, 0], [0, "m", 0], [0, 0, "m"]], "potential": "m*g*y",
        "contacts": [{"name": "floor", "gap": "y - R", "restitution": 0.7,
                      "friction": {"coefficient": 0.2, "slip": ["x_dot + R*a_dot"]}}]});
    (problem, 0.6 * t, vec![("a", 1.0), ("x", l), ("y", l)])
}

/// Returns a block that falls on another, sliding block, written in the given units; the end time; and the fields to
/// compare with their units.
fn stack([m, l, t]: [f64; 3]) -> (Value, f64, Vec<(&'static str, f64)>) {
    let problem = json!({"parameters": {"m": m, "g": 9.81 * l / (t * t), "h": 0.1 * l},
        "coordinates": {"a": {"initial": 0.5 * l}, "b": {"initial": l}, "x": {"initial": 0, "velocity": l / t}, "z": {"initial": 0}},
        "mass": [["m", 0, 0, 0], [0, "3*m", 0, 0], [0, 0, "m", 0], [0, 0, 0, "3*m"]], "potential": "m*g*(a + 3*b)",
        "contacts": [{"name": "floor", "gap": "a", "restitution": 0.5, "friction": {"coefficient": 0.3, "slip": ["x_dot"]}},
                     {"name": "blocks", "gap": "b - a - h", "restitution": 0.3,
                      "friction": {"coefficient": 0.4, "slip": ["z_dot - x_dot"]}}]});
    (problem, 1.5 * t, vec![("a", l), ("b", l), ("x", l), ("z", l)])
}

/// Returns a plate that slides and spins on four feet with isotropic friction, written in the given units; the end
/// time; and the fields to compare with their units. The loads of four feet are not unique.
fn plate([m, l, t]: [f64; 3]) -> (Value, f64, Vec<(&'static str, f64)>) {
    let foot = |(k, (a, b)): (usize, (f64, f64))| {
        json!({"name": format!("foot_{k}"), "gap": format!("z + ({b}*p - ({a})*r)*l"),
               "friction": {"coefficient": 0.3, "slip": [format!("x_dot - ({b})*l*w_dot"), format!("y_dot + ({a})*l*w_dot")]}})
    };
    let feet = [(0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.35)];
    let i = 0.1 * m * l * l;
    let problem = json!({"parameters": {"m": m, "g": 9.81 * l / (t * t), "l": l},
        "coordinates": {"p": {"initial": 0}, "r": {"initial": 0}, "w": {"initial": 0, "velocity": 2.0 / t},
            "x": {"initial": 0, "velocity": l / t}, "y": {"initial": 0, "velocity": 0.3 * l / t}, "z": {"initial": 0}},
        "mass": [[i, 0, 0, 0, 0, 0], [0, i, 0, 0, 0, 0], [0, 0, i, 0, 0, 0],
                 [0, 0, 0, m, 0, 0], [0, 0, 0, 0, m, 0], [0, 0, 0, 0, 0, m]], "potential": "m*g*z",
        "contacts": feet.into_iter().enumerate().map(foot).collect::<Vec<_>>()});
    (problem, t, vec![("w", 1.0), ("x", l), ("y", l)])
}

/// Returns a pendulum on a rod that strikes a wall, written in the given units; the end time; and the fields to compare
/// with their units.
fn pendulum([m, l, t]: [f64; 3]) -> (Value, f64, Vec<(&'static str, f64)>) {
    let problem = json!({"parameters": {"m": m, "g": 9.81 * l / (t * t), "l": l},
        "coordinates": {"x": {"initial": "l"}, "y": {"initial": 0}}, "mass": [["m", 0], [0, "m"]], "potential": "m*g*y",
        "joints": [{"name": "rod", "constraint": "x^2 + y^2 - l^2"}],
        "contacts": [{"name": "wall", "gap": "x + 0.3*l", "restitution": 0.8}]});
    (problem, 3.0 * t, vec![("x", l), ("y", l)])
}

fn assert_the_same(scene: impl Fn([f64; 3]) -> (Value, f64, Vec<(&'static str, f64)>), method: impl Fn(f64) -> Value) {
    let run = |units: [f64; 3]| {
        let (problem, end, compared) = scene(units);
        let solution = solve(&json!({"problem": {"mechanical": problem}, "time": {"end": end}, "method": method(end)}));
        let kinds: Vec<_> = solution.trajectory.events.iter().map(|event| event.kind).collect();
        (compared.into_iter().map(|(name, unit)| last(&solution, name) / unit).collect::<Vec<f64>>(), kinds.len())
    };
    let (expected, events) = run([1.0; 3]);
    for units in UNITS {
        let (found, told) = run(units);
        let apart = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-9, "{units:?}: {found:?}, not {expected:?}");
        assert_eq!(told, events, "{units:?}");
    }
}

#[test]
fn time_stepping_is_the_same_in_all_units() {
    let steps = |end: f64| json!({"step": end / 1000.0});
    assert_the_same(ball, steps);
    assert_the_same(plate, steps);
    assert_the_same(pendulum, steps);
}

#[test]
fn a_stack_is_the_same_in_all_units_of_mass() {
    let steps = |end: f64| json!({"step": end / 1000.0});
    assert_the_same(|[m, ..]| stack([m, 1.0, 1.0]), steps);
    assert_the_same(|[m, ..]| ball([m, 1.0, 1.0]), |_| json!({"impacts": "locate"}));
}
