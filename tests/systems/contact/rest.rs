//! Bodies that come to rest on redundant contacts (more than determine the contact forces), and stay at rest.

use super::located;
use crate::systems::harness::{column, last};
use dvi::solution::{EventKind, Solution};
use serde_json::{Value, json};

/// A block of half width `b` and half height `h` on its two lower corners, with coordinates relative to the slope on
/// which it stands.
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
    // When the block's angular velocity is 1e-7 per second, 5e-7 s before the impacts accumulate, the corners rise by
    // less than the rounding errors of their gaps.
    assert!((last_blow - rest).abs() < 1e-6, "{last_blow}");
}

#[test]
fn a_block_rests_on_a_slope_though_half_of_the_friction_is_more_than_its_upper_corner_gives() {
    // With tan(20 degrees) = 0.364 and b = h, the upper corner carries 0.318 of the weight component normal to the
    // slope. Its friction is at most 0.159 of that component, and half of the required friction is 0.182.
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

/// A table of the mass 10 on four feet with the friction coefficient 0.4, pushed by the force `(x, y)`. The force
/// acts on the centre of mass, which is not at the centre of the feet, so that each foot has a different load.
fn table_on_four_feet(x: &Value, y: &Value) -> Value {
    let feet = [(-0.7, -0.3), (0.3, -0.3), (0.3, 0.5), (-0.7, 0.5)];
    let contacts: Vec<Value> = feet
        .iter()
        .enumerate()
        .map(|(i, (a, b))| {
            json!({"name": format!("foot_{i}"), "gap": format!("z + ({a})*pitch + ({b})*roll"),
                   "friction": {"coefficient": 0.4,
                                "slip": [format!("x_dot - ({b})*yaw_dot"), format!("y_dot + ({a})*yaw_dot")]}})
        })
        .collect();
    let inertia = [("pitch", 1.1), ("roll", 0.8), ("x", 10.0), ("y", 10.0), ("yaw", 1.7), ("z", 10.0)];
    let coordinates: serde_json::Map<String, Value> =
        inertia.iter().map(|(name, _)| ((*name).to_owned(), json!({"initial": 0}))).collect();
    let mass: Vec<Vec<f64>> =
        (0..6).map(|i| (0..6).map(|j| if i == j { inertia[i].1 } else { 0.0 }).collect()).collect();
    json!({"coordinates": coordinates, "mass": mass, "potential": "98.1*z", "forces": {"x": x, "y": y}, "contacts": contacts})
}

#[test]
fn a_table_on_four_feet_slides_when_the_push_reaches_the_friction_of_all() {
    let problem = table_on_four_feet(&json!("12*t"), &json!("5*t"));
    let solution = located(problem, 4.0);
    let starts: Vec<f64> =
        solution.trajectory.events.iter().filter(|event| event.kind == EventKind::Slip).map(|event| event.t).collect();
    let limit = 0.4 * 98.1 / 13.0;
    assert!(!starts.is_empty() && starts.iter().all(|t| (t - limit).abs() < 1e-8), "{:?}, not {limit}", starts.first());
    assert!(solution.diagnostics.steps.accepted < 200, "{:?}", solution.diagnostics.steps);
    // After slip begins at t = limit, the acceleration of the table is x'' = 13 (t - limit)/m in the direction of the
    // force.
    let moved = 13.0 * (4.0 - limit).powi(3) / 60.0;
    let (x, y) = (last(&solution, "x"), last(&solution, "y"));
    assert!((x - moved * 12.0 / 13.0).abs() < 1e-7 && (y - moved * 5.0 / 13.0).abs() < 1e-7, "{x} {y} {moved}");
}

#[test]
fn a_force_that_leaves_zero_as_a_high_power_of_time_lifts_a_body() {
    for (power, unit) in [(3, 1.0), (7, 1.0), (7, 1e-6), (15, 1.0), (15, 1e6)] {
        let problem = json!({"parameters": {"T": unit}, "coordinates": {"y": {"initial": 0}}, "mass": [[1]],
            "forces": {"y": format!("(t/T - 1)^{power}/T^2")}, "contacts": [{"name": "floor", "gap": "y"}]});
        let solution = located(problem, 3.0 * unit);
        let rises = f64::from(power + 1) * f64::from(power + 2);
        // With the exponent p of the lifting force, the exact height of the body is y = (t - 1)^(p + 2)/((p + 1) (p +
        // 2)) for t >= 1, where t is in the unit of time.
        let exact = 2.0_f64.powi(power + 2) / rises;
        let error = last(&solution, "y") / exact - 1.0;
        assert!(error.abs() < 1e-8, "power {power}, unit {unit:e}: {error:e}");
        assert_eq!(solution.trajectory.events.len(), 1, "{:?}", solution.trajectory.events);
    }
}

/// Solves either one body on two contacts or two stacked bodies, with a unit of weight per contact or body. Friction
/// with the coefficient 0.5 resists a `force` along `x` or along the coordinate of the upper body.
fn pulled(bodies: &str, force: f64) -> Solution {
    let held = |name: &str, gap: &str, slip: &str| json!({"name": name, "gap": gap, "friction": {"coefficient": 0.5, "slip": [slip]}});
    let problem = match bodies {
        "on two feet" => json!({
            "coordinates": {"a": {"initial": 0}, "x": {"initial": 0}, "y": {"initial": 0}},
            "mass": [[1, 0, 0], [0, 2, 0], [0, 0, 2]], "forces": {"x": force, "y": -2},
            "contacts": [held("left", "y - a", "x_dot"), held("right", "y + a", "x_dot")]}),
        "stacked" => json!({
            "coordinates": {"low": {"initial": 0}, "x": {"initial": 0}, "y": {"initial": 0}, "ylow": {"initial": 0}},
            "mass": [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 2]],
            "forces": {"x": force, "y": -2, "ylow": -2},
            "contacts": [held("ground", "ylow", "low_dot"), held("between", "y - ylow", "x_dot - low_dot")]}),
        _ => json!({
            "coordinates": {"other": {"initial": 0}, "x": {"initial": 0}, "y": {"initial": 0}, "z": {"initial": 0}},
            "mass": [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 2]],
            "forces": {"other": 0.3, "x": force, "y": -2, "z": -2},
            "contacts": [held("one", "y", "x_dot"), held("two", "z", "other_dot")]}),
    };
    located(problem, 20.0)
}

#[test]
fn bodies_on_several_contacts_slip_however_little_a_force_exceeds_friction() {
    for bodies in ["on two feet", "stacked", "beside another"] {
        for excess in [1e-3, 1e-6, 1e-8, 1e-10, -1e-10, -1e-8, -1e-3] {
            let solution = pulled(bodies, 1.0 + excess);
            // Over 20 units of time, the acceleration of the pulled body, of mass 2, is half of the force in excess of
            // friction.
            let (moved, exact) = (last(&solution, "x"), 100.0 * f64::max(excess, 0.0));
            assert!((moved - exact).abs() <= 1e-5 * exact + 1e-13, "{bodies}, {excess:e}: {moved:e}, not {exact:e}");
        }
    }
}

#[test]
fn a_table_slides_when_a_steady_push_exceeds_the_friction_of_all_feet() {
    // The loads of the four feet are not unique, since equilibrium determines only three, and directions of slip in
    // space are accurate to only the square root of the friction solver's tolerance.
    for excess in [-1e-8, -1e-5, 1e-5, 1e-4] {
        let force = 0.4 * 98.1 * (1.0 + excess);
        let problem = table_on_four_feet(&json!(force * 12.0 / 13.0), &json!(force * 5.0 / 13.0));
        let solution = located(problem, 4.0);
        // The acceleration of the table is the force in excess of friction divided by the mass.
        let (x, y) = (last(&solution, "x"), last(&solution, "y"));
        let exact = 8.0 * 0.4 * 9.81 * f64::max(excess, 0.0);
        assert!((x.hypot(y) - exact).abs() <= 1e-4 * exact + 1e-13, "{excess:e}: {:e}, not {exact:e}", x.hypot(y));
    }
}
