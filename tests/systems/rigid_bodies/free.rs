//! Free flight and free rotation of rigid bodies.

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
    // The z axis of the freely rotating body, initially along the spin, flips repeatedly.
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
    // A rod from the origin to x = 1 spins about z: the origin of its frame circles around its centre of mass.
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
    // The origin of the rod's frame is initially at rest, so that the centre of mass moves with w x r = 0.5 along y.
    for (k, t) in solution.trajectory.t.iter().enumerate() {
        let expected = (0.5 - 0.5 * t.cos(), 0.5 * t - 0.5 * t.sin());
        let found = (column(&solution, "rod.x")[k], column(&solution, "rod.y")[k]);
        assert!((found.0 - expected.0).abs() < 1e-9 && (found.1 - expected.1).abs() < 1e-9, "{t}: {found:?}");
    }
    assert!((last(&solution, "rod.z") - 2.0).abs() < 1e-14);
}

#[test]
fn a_throw_is_a_parabola_to_rounding_whatever_the_step_and_between_steps() {
    for step in [0.1, 0.03, 1e-3] {
        let ball = json!({"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 2, "position": [0, 0, 50],
            "velocity": [3, 0, 4]});
        let solution = solve(&on_the_ground(&[ball], &json!({}), 2.0, step));
        for k in 0..=100 {
            let t = solution.trajectory.t[k];
            let of = |name: &str| column(&solution, name)[k];
            let (z, vz) = (50.0 + 4.0 * t - 0.5 * 9.81 * t * t, 4.0 - 9.81 * t);
            assert!((of("ball.z") - z).abs() < 1e-11, "{step}, {t}: {} {z}", of("ball.z"));
            assert!((of("ball.vz") - vz).abs() < 1e-11, "{step}, {t}: {} {vz}", of("ball.vz"));
            assert!((of("ball.x") - 3.0 * t).abs() < 1e-12);
        }
        let energy = solution.diagnostics.energy.unwrap();
        assert!(energy.largest_defect < 1e-9 * energy.potential_at_start, "{:e}", energy.largest_defect);
    }
}

/// Free rotation of a body with three moments of inertia. Reference: a Runge-Kutta method of order 8 (DOP853) with a
/// tolerance of 1e-13.
#[test]
fn a_body_with_three_moments_of_inertia_turns_at_second_order_as_it_falls() {
    let q = [0.10594656880115676, -0.1993666935059763, -0.2017218156016355, 0.9530669206252705];
    let omega = [-0.27844283383584306, 2.036182081360076, 0.19601508236838527];
    let error = |step: f64| {
        let body = json!({"name": "b", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 500],
            "inertia": [1, 2, 3], "angular_velocity": [0.3, 2, 0.1]});
        let solution = solve(&on_the_ground(&[body], &json!({}), 5.0, step));
        let off = |names: [&str; 4], exact: [f64; 4]| {
            names.iter().zip(exact).map(|(name, exact)| (last(&solution, name) - exact).abs()).fold(0.0, f64::max)
        };
        assert!((last(&solution, "b.z") - (500.0 - 0.5 * 9.81 * 25.0)).abs() < 1e-9);
        let turn = off(["b.qw", "b.qx", "b.qy", "b.qz"], q);
        turn.max(off(["b.wx", "b.wy", "b.wz", "b.x"], [omega[0], omega[1], omega[2], 0.0]))
    };
    let (coarse, fine) = (error(0.02), error(0.01));
    assert!(fine < 1e-4 && (coarse / fine).log2() > 1.95, "{coarse:e} {fine:e}");
}
