//! Bodies that come to rest on more contacts than they need, and stay.

use super::located;
use crate::systems::harness::{column, last};
use dvi::solution::{EventKind, Solution};
use serde_json::{Value, json};

/// A block of half width `b` and half height `h` on its two lower corners, with coordinates along a slope.
fn on_corners(parameters: Value, tilt: &str, potential: &str) -> Value {
    json!({"parameters": parameters,
        "coordinates": {
            "angle": {"initial": tilt},
            "x": {"initial": format!("b*cos({tilt}) - h*sin({tilt})")},
            "y": {"initial": format!("b*sin({tilt}) + h*cos({tilt})")}},
        "mass": [["(b^2 + h^2)/3", 0, 0], [0, 1, 0], [0, 0, 1]], "potential": potential,
        "contacts": [
            {"name": "left", "gap": "y - b*sin(angle) - h*cos(angle)",
             "friction": {"coefficient": "mu", "slip": ["x_dot + (b*sin(angle) + h*cos(angle))*angle_dot"]}},
            {"name": "right", "gap": "y + b*sin(angle) - h*cos(angle)",
             "friction": {"coefficient": "mu", "slip": ["x_dot + (-b*sin(angle) + h*cos(angle))*angle_dot"]}}]})
}

fn goes_on_by_itself(solution: &Solution) -> bool {
    solution.diagnostics.warnings.iter().all(|warning| warning.code != "time_stepping_went_on")
}

#[test]
fn a_block_that_rocks_comes_to_rest_at_the_limit_of_its_blows_and_stays() {
    let problem = on_corners(json!({"b": 0.1, "h": 0.4, "mu": 2}), "0.5*atan(b/h)", "9.81*y");
    let solution = located(problem, 10.0);
    let rest = 5.022_615_635_769_982;
    let steps = &solution.diagnostics.steps;
    assert!(steps.accepted < 2_000, "{steps:?}");
    let lasting = solution.trajectory.t.iter().zip(column(&solution, "kinetic_energy"));
    for (t, kinetic) in lasting.filter(|(t, _)| **t > rest + 1e-6) {
        assert!(*kinetic < 1e-24, "{kinetic} at {t}");
    }
    let blows = solution.trajectory.events.iter().filter(|event| event.kind == EventKind::Impact);
    let last_blow = blows.map(|event| event.t).fold(0.0, f64::max);
    assert!((last_blow - rest).abs() < 1e-7, "{last_blow}");
}

#[test]
fn a_block_rests_on_a_slope_though_half_of_the_friction_is_more_than_its_upper_corner_gives() {
    // With tan(20 degrees) = 0.364 and b = h the upper corner carries 0.318 of the weight across the slope: 0.159 of it
    // is all the friction it has, and half of what is needed is 0.182.
    let problem = on_corners(
        json!({"b": 0.2, "h": 0.2, "mu": 0.5, "theta": 0.349_065_850_398_865_9}),
        "0",
        "9.81*(y*cos(theta) - x*sin(theta))",
    );
    let solution = located(problem, 10.0);
    assert!(solution.diagnostics.steps.accepted < 100, "{:?}", solution.diagnostics.steps);
    assert!(goes_on_by_itself(&solution), "{:?}", solution.diagnostics.warnings);
    assert!(solution.trajectory.events.is_empty(), "{:?}", solution.trajectory.events);
    assert!((last(&solution, "x") - 0.2).abs() < 1e-13, "{}", last(&solution, "x"));
}
