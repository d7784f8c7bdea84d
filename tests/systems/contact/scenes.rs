//! Larger mechanical systems: curved gaps, joints, and the woodpecker toy.

use super::stepped;
use crate::systems::harness::{column, events, last, solve};
use crate::systems::reference::example;
use serde_json::{Value, json};

/// A mechanical problem: a particle on a frictionless sphere of radius one.
fn on_sphere() -> Value {
    json!({"coordinates": {"x": {"initial": 0, "velocity": 0.5}, "y": {"initial": 1}}, "mass": [[1, 0], [0, 1]],
           "potential": "9.81*y", "contacts": [{"name": "sphere", "gap": "sqrt(x^2 + y^2) - 1"}]})
}

#[test]
fn a_particle_leaves_a_sphere_where_the_normal_force_vanishes() {
    let leaves = |h: f64| events(&stepped(on_sphere(), 1.0, h), "sphere").last().copied().unwrap();
    let exact = 0.754_238_838_002_552;
    let (coarse, fine) = ((leaves(1e-3) - exact).abs(), (leaves(1e-4) - exact).abs());
    assert!(coarse < 0.02 && fine < 0.002, "{coarse} {fine}");
}

#[test]
fn a_double_pendulum_on_rods_keeps_their_lengths_and_moves_as_one_in_angles() {
    let rods = json!({"coordinates": {"x1": {"initial": 1}, "y1": {"initial": 0}, "x2": {"initial": 2}, "y2": {"initial": 0}},
        "mass": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "potential": "9.81*(y1 + y2)",
        "joints": [{"name": "upper", "constraint": "x1^2 + y1^2 - 1"},
                   {"name": "lower", "constraint": "(x2 - x1)^2 + (y2 - y1)^2 - 1"}]});
    let angles = json!({"coordinates": {"a": {"initial": "pi/2"}, "b": {"initial": "pi/2"}},
        "mass": [[2, "cos(a - b)"], ["cos(a - b)", 1]], "potential": "-9.81*(2*cos(a) + cos(b))"});
    let end = 1.0;
    let place = |h: f64| {
        let rods = stepped(rods.clone(), end, h);
        let length = column(&rods, "x1").iter().zip(column(&rods, "y1")).map(|(x, y)| (x.hypot(*y) - 1.0).abs());
        assert!(length.fold(0.0, f64::max) < 1e-12, "the rod changes its length");
        let angles = stepped(angles.clone(), end, h);
        ([last(&rods, "x1"), last(&rods, "y1")], last(&angles, "a"))
    };
    // The formulations of the double pendulum in rod coordinates and in angles converge to the same motion, at first
    // order.
    let distance = |h: f64| {
        let ([x, y], a) = place(h);
        (x - a.sin()).hypot(y + a.cos())
    };
    let (coarse, fine) = (distance(2e-3), distance(5e-4));
    assert!(fine < 5e-3 && fine < 0.4 * coarse, "{coarse} {fine}");
}

#[test]
fn the_woodpecker_pecks_its_way_down() {
    let mut problem = example("woodpecker");
    problem["time"]["end"] = json!(2);
    problem["method"]["step"] = json!(1e-5);
    problem["output"] = json!({"times": "steps", "fields": ["height", "woodpecker"]});
    let solution = solve(&problem);
    let (t, bird, y) = (&solution.trajectory.t, column(&solution, "woodpecker"), column(&solution, "height"));
    // Indices of the maxima of the woodpecker's angle after the transient, whose distances in time are the periods.
    let swings: Vec<usize> = (1..t.len() - 1)
        .filter(|&i| t[i] > 0.5 && bird[i] > 0.1 && bird[i] >= bird[i - 1] && bird[i] > bird[i + 1])
        .collect();
    assert!(swings.len() >= 6, "{} swings", swings.len());
    let (first, end) = (swings[0], swings[swings.len() - 1]);
    let cycles = (swings.len() - 1) as f64;
    let period = (t[end] - t[first]) / cycles;
    let fall = (y[first] - y[end]) / cycles;
    assert!((period - 0.146).abs() < 1e-3, "period {period}");
    assert!((fall - 0.01945).abs() < 6e-4, "fall {fall}");
    let most = bird.iter().copied().fold(0.0, f64::max);
    assert!((most - 0.12).abs() < 1e-3, "largest angle {most}");
}
