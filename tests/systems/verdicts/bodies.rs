//! Verdicts on rigid bodies (whether the result is to be trusted): joints that fail, energy errors, bodies at rest.

use super::*;
use crate::systems::harness::column;

/// A chain of links on ball joints, released horizontally, with a ball of the given mass at the end.
fn chain(links: usize, mass: f64, step: f64, unit: f64) -> Value {
    let (length, turn) = (0.1 * unit, [0.5_f64.sqrt(), 0.0, 0.5_f64.sqrt(), 0.0]);
    let mut bodies = Vec::new();
    let mut joints = Vec::new();
    for k in 0..links {
        bodies.push(
            json!({"name": format!("l{k}"), "shape": {"capsule": {"radius": 0.01 * unit, "length": 0.07 * unit}},
            "mass": 0.1, "position": [(k as f64 + 0.5) * length, 0, 0], "orientation": turn}),
        );
        let other = if k == 0 { json!([format!("l{k}")]) } else { json!([format!("l{}", k - 1), format!("l{k}")]) };
        joints.push(json!({"ball": {"bodies": other, "at": [k as f64 * length, 0, 0]}}));
    }
    let end = links as f64 * length;
    bodies.push(json!({"name": "ball", "shape": {"sphere": {"radius": 0.1 * unit}}, "mass": mass, "position": [end + 0.1 * unit, 0, 0]}));
    joints.push(json!({"ball": {"bodies": [format!("l{}", links - 1), "ball"], "at": [end, 0, 0]}}));
    json!({"problem": {"rigid_bodies": {"bodies": bodies, "joints": joints, "gravity": [0, 0, -9.81 * unit]}},
        "time": {"end": 1}, "method": {"step": step}, "output": {"times": {"count": 21}}})
}

#[test]
fn a_box_at_rest_gains_nothing_and_is_trusted_in_any_units() {
    for unit in [1e-3, 1.0, 1e4] {
        let solution = solve(&json!({"problem": {"rigid_bodies": {"bodies": [
            {"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true},
            {"name": "a", "shape": {"box": {"size": [0.5 * unit, 0.5 * unit, unit]}}, "mass": 3, "position": [0, 0, 0.5 * unit]}],
            "gravity": [0, 0, -9.81 * unit], "contacts": {"friction": 0.5}}},
            "time": {"end": 0.5}, "method": {"step": 1e-3}, "output": {"times": [0.5]}}));
        assert_trusted(&solution);
        let energy = solution.diagnostics.energy.as_ref().expect("a balance");
        assert!(energy.largest_gain_in_impacts < 1e-6, "{energy:?}");
    }
}

#[test]
fn cards_that_lean_against_each_other_stand_where_statics_says_so() {
    // Two cards lean against each other: each has its lower edge on the floor, and its upper edge touches the other's
    // at x = 0.
    for (degrees, friction, stands) in
        [(20.0_f64, 0.25, true), (20.0, 0.12, false), (30.0, 0.35, true), (12.0, 0.13, true)]
    {
        let (angle, thickness) = (degrees.to_radians(), 0.01);
        let (sine, cosine) = angle.sin_cos();
        let (x, z) = (0.5 * (sine + thickness * cosine), 0.5 * (cosine + thickness * sine));
        let card = |side: f64| {
            json!({"name": if side < 0.0 { "left" } else { "right" }, "shape": {"box": {"size": [thickness, 0.5, 1.0]}}, "mass": 1,
                "position": [side * (x - 0.0), 0, z], "orientation": [(0.5 * angle).cos(), 0, -side * (0.5 * angle).sin(), 0]})
        };
        let solution = solve(&json!({"problem": {"rigid_bodies": {"bodies": [
            {"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true}, card(-1.0), card(1.0)],
            "gravity": [0, 0, -9.81], "contacts": {"friction": friction}, "interpenetration": "resolve"}},
            "time": {"end": 0.6}, "method": {"step": 1e-3}, "output": {"times": [0.6]}}));
        let (left, right) = (last(&solution, "left.z"), last(&solution, "right.z"));
        if stands {
            assert!((left - z).abs() < 1e-5 && (right - z).abs() < 1e-5, "{degrees}, {friction}: {left} {right} {z}");
            assert_trusted(&solution);
        } else {
            assert!(left < z - 0.05, "{degrees}, {friction}: {left} {z}");
        }
    }
}

#[test]
fn a_chain_of_light_links_with_a_heavy_end_is_trusted_in_any_units() {
    for unit in [1.0, 1e3] {
        // The motion of the chain's light links is less accurate than that of the ball at its end, so that only the
        // ball's fields are requested.
        let mut specification = chain(10, 100.0, 2e-3, unit);
        specification["output"]["fields"] = json!(["ball.x", "ball.z", "kinetic_energy", "potential_energy"]);
        let solution = solve(&specification);
        assert_trusted(&solution);
        // The permitted defect of the chain's energy balance is a hundredth of the largest kinetic energy.
        let (kinetic, potential) = (column(&solution, "kinetic_energy"), column(&solution, "potential_energy"));
        let largest = kinetic.iter().copied().fold(0.0, f64::max);
        let energy = solution.diagnostics.energy.as_ref().expect("a balance");
        assert!(energy.largest_defect < 1e-2 * largest, "{energy:?}");
        let start = kinetic[0] + potential[0];
        let gain = kinetic.iter().zip(potential).map(|(t, v)| t + v - start).fold(0.0, f64::max);
        assert!(gain <= 1e-9 * largest, "{gain} of {largest}");
    }
}

#[test]
fn a_chain_of_equal_links_in_short_steps_is_trusted() {
    let solution = solve(&chain(2, 0.1, 2e-4, 1.0));
    assert_trusted(&solution);
}
