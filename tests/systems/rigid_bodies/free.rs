//! Free flight and free rotation.

use super::{on_the_ground, weightless};
use crate::systems::harness::{column, last, solve};
use serde_json::json;

#[test]
fn a_racket_thrown_about_its_middle_axis_turns_over_and_keeps_energy_and_angular_momentum() {
    let racket = json!({"name": "racket", "shape": {"box": {"size": [0.3, 0.7, 0.02]}}, "mass": 0.3,
        "position": [0, 0, 5], "angular_velocity": [0.01, 0, 6], "inertia": [0.01, 0.03, 0.02]});
    let mut specification = weightless(on_the_ground(&[racket], &json!({}), 100.0, 1e-3));
    specification["output"]["times"] = json!({"count": 2001});
    let solution = solve(&specification);
    let energy = column(&solution, "kinetic_energy");
    assert!(energy.iter().all(|e| (e / energy[0] - 1.0).abs() < 1e-9));
    // Turned over: the z axis of the body, first along the spin, points the other way again and again.
    let (x, y) = (column(&solution, "racket.qx"), column(&solution, "racket.qy"));
    let upright: Vec<f64> = x.iter().zip(y).map(|(x, y)| 1.0 - 2.0 * (x * x + y * y)).collect();
    assert!(upright.iter().any(|c| *c < -0.9));
    let norm = |k: usize| {
        ["qw", "qx", "qy", "qz"].map(|q| column(&solution, &format!("racket.{q}"))[k].powi(2)).iter().sum::<f64>()
    };
    assert!((norm(2000) - 1.0).abs() < 1e-14);
}

#[test]
fn a_hull_turns_about_its_centre_of_mass_and_not_about_the_origin_of_its_frame() {
    // A rod from the origin to x = 1, spinning about z: the origin circles about the centre.
    let points = json!([
        [0, -0.1, -0.1],
        [0, 0.1, -0.1],
        [0, -0.1, 0.1],
        [0, 0.1, 0.1],
        [1, -0.1, -0.1],
        [1, 0.1, -0.1],
        [1, -0.1, 0.1],
        [1, 0.1, 0.1]
    ]);
    let rod = json!({"name": "rod", "shape": {"convex_hull": {"points": points}}, "mass": 1, "position": [0, 0, 2],
        "angular_velocity": [0, 0, 1]});
    let solution = solve(&weightless(on_the_ground(&[rod], &json!({}), 3.0, 1e-3)));
    // The origin at rest at first: the centre moves with w x r = 0.5 along y.
    for (k, t) in solution.trajectory.t.iter().enumerate() {
        let expected = (0.5 - 0.5 * t.cos(), 0.5 * t - 0.5 * t.sin());
        let found = (column(&solution, "rod.x")[k], column(&solution, "rod.y")[k]);
        assert!((found.0 - expected.0).abs() < 1e-9 && (found.1 - expected.1).abs() < 1e-9, "{t}: {found:?}");
    }
    assert!((last(&solution, "rod.z") - 2.0).abs() < 1e-14);
}
