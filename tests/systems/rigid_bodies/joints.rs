//! Joints between rigid bodies, such as hinges and fixed joints.

use super::{on_the_ground, weightless};
use crate::systems::harness::{column, distance, last, solve};
use serde_json::{Value, json};

fn joined(bodies: &[Value], joints: &Value, end: f64, step: f64) -> Value {
    let mut specification = on_the_ground(bodies, &json!({"friction": 0.3}), end, step);
    specification["problem"]["rigid_bodies"]["joints"] = joints.clone();
    specification
}

/// Returns the specification with the option that joints may change its initial velocities.
fn resolved(mut specification: Value) -> Value {
    specification["problem"]["rigid_bodies"]["interpenetration"] = json!("resolve");
    specification
}

fn ball(name: &str, at: [f64; 3]) -> Value {
    json!({"name": name, "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": at})
}

#[test]
fn a_pendulum_on_a_ball_joint_neither_drifts_nor_gains_energy() {
    let specification =
        joined(&[ball("bob", [1.0, 0.0, 5.0])], &json!([{"ball": {"bodies": ["bob"], "at": [0, 0, 5]}}]), 20.0, 1e-3);
    let solution = solve(&specification);
    for k in 0..=100 {
        let [x, y, z] = ["x", "y", "z"].map(|axis| column(&solution, &format!("bob.{axis}"))[k]);
        assert!((x.hypot(y).hypot(z - 5.0) - 1.0).abs() < 1e-10);
    }
    let energy = |k: usize| column(&solution, "kinetic_energy")[k] + column(&solution, "potential_energy")[k];
    let swing = (0..=100).map(|k| (energy(k) - energy(0)).abs()).fold(0.0, f64::max);
    assert!(swing < 1e-5 * 9.81, "{swing}");
}

/// A compound pendulum of small amplitude has the frequency `w^2 = m g l / (m l^2 + 2 m r^2 / 5)`.
#[test]
fn a_hinge_lets_a_pendulum_swing_with_its_period() {
    let angle = 1e-3_f64;
    let specification = joined(
        &[ball("bob", [angle.sin(), 0.0, 5.0 - angle.cos()])],
        &json!([{"hinge": {"bodies": ["bob"], "at": [0, 0, 5], "axis": [0, 1, 0]}}]),
        5.0,
        1e-3,
    );
    let solution = solve(&specification);
    let omega = (9.81_f64 / (1.0 + 0.4 * 0.01)).sqrt();
    assert!(distance(&solution, "bob.x", |t| angle * (omega * t).cos()) < 0.02 * angle);
    assert!(distance(&solution, "bob.y", |_| 0.0) < 1e-12);
}

#[test]
fn a_slider_leaves_one_translation_and_no_rotation() {
    let slope = [3.0_f64.sqrt() / 2.0, 0.0, -0.5];
    let mut bob = ball("bob", [0.0, 0.0, 50.0]);
    bob["angular_velocity"] = json!([3, 2, 1]);
    let specification =
        joined(&[bob], &json!([{"slider": {"bodies": ["bob"], "at": [0, 0.3, 50], "axis": slope}}]), 2.0, 1e-3);
    let solution = solve(&resolved(specification));
    let path = |t: f64| 0.25 * 9.81 * t * t;
    assert!(distance(&solution, "bob.x", |t| slope[0] * path(t)) < 1e-2);
    assert!((last(&solution, "bob.vx") - slope[0] * 0.5 * 9.81 * 2.0).abs() < 1e-10);
    for name in ["bob.y", "bob.qx", "bob.qy", "bob.qz"] {
        assert!(distance(&solution, name, |_| 0.0) < 1e-11, "{name}");
    }
}

#[test]
fn bodies_on_a_fixed_joint_fly_as_one() {
    let mut first = ball("a", [0.0, 0.0, 5.0]);
    first["velocity"] = json!([0, 2, 0]);
    let specification = weightless(joined(
        &[first, ball("b", [1.0, 0.0, 5.0])],
        &json!([{"fixed": {"bodies": ["a", "b"]}}]),
        5.0,
        1e-3,
    ));
    let solution = solve(&resolved(specification));
    for k in 0..=100 {
        let of = |name: &str| column(&solution, name)[k];
        let apart = (of("a.x") - of("b.x")).hypot(of("a.y") - of("b.y"));
        assert!((apart - 1.0).abs() < 1e-10, "{apart}");
        let t = solution.trajectory.t[k];
        assert!((0.5 * (of("a.y") + of("b.y")) - t).abs() < 1e-3 * (1.0 + t), "{t}");
    }
    // Angular velocity of the joined balls from the angular momentum about their centre, m v r with m = 1: w = 1 / (2
    // (1/4) + 2 (2/5) 0.01).
    assert!((last(&solution, "a.wz") + 1.0 / 0.508).abs() < 1e-3, "{}", last(&solution, "a.wz"));
}

#[test]
fn a_closed_chain_that_says_things_twice_hangs_together_and_lies_on_the_ground() {
    // Four bars in a square, hinged at every corner: the motion is planar, so that the hinges are redundant.
    let bar = |name: &str, at: [f64; 3], size: [f64; 3]| json!({"name": name, "shape": {"box": {"size": size}}, "mass": 1, "position": at});
    let bodies = [
        bar("south", [0.0, -0.5, 0.05], [0.8, 0.1, 0.1]),
        bar("north", [0.0, 0.5, 0.05], [0.8, 0.1, 0.1]),
        bar("west", [-0.5, 0.0, 0.05], [0.1, 0.8, 0.1]),
        bar("east", [0.5, 0.0, 0.05], [0.1, 0.8, 0.1]),
    ];
    let hinge =
        |a: &str, b: &str, x: f64, y: f64| json!({"hinge": {"bodies": [a, b], "at": [x, y, 0.05], "axis": [0, 0, 1]}});
    let joints = json!([
        hinge("south", "west", -0.5, -0.5),
        hinge("south", "east", 0.5, -0.5),
        hinge("north", "west", -0.5, 0.5),
        hinge("north", "east", 0.5, 0.5)
    ]);
    let mut specification = joined(&bodies, &joints, 1.0, 2e-3);
    specification["problem"]["rigid_bodies"]["bodies"][1]["velocity"] = json!([0.5, 0, 0]);
    let solution = solve(&resolved(specification));
    for name in ["south", "north", "west", "east"] {
        assert!(distance(&solution, &format!("{name}.z"), |_| 0.05) < 1e-9);
    }
    // Friction has brought the frame of four bars to rest after (v/2)^2 / (2 mu g), which is 1 cm.
    assert!(last(&solution, "kinetic_energy") < 1e-18);
    assert!((last(&solution, "west.x") + 0.5).abs() > 1e-4);
}

/// The impulse of a hinge that corrects inconsistent velocities is the least possible: it conserves the angular
/// momentum about the hinge, `m v d`, with the moment of inertia `m d^2 + 2 m r^2 / 5`.
#[test]
fn a_velocity_that_would_tear_a_hinge_is_changed_by_the_least_impulse_before_the_start() {
    let mut bob = ball("bob", [1.0, 0.0, 1.0]);
    bob["velocity"] = json!([1, 0, 0]);
    let hinge = json!([{"hinge": {"bodies": ["bob"], "at": [0, 0, 0], "axis": [0, 1, 0]}}]);
    let solution = solve(&resolved(weightless(joined(&[bob], &hinge, 0.1, 1e-3))));
    let rate = 1.0 / 2.004;
    for (name, expected) in
        [("bob.vx", rate), ("bob.vz", -rate), ("bob.wy", rate), ("kinetic_energy", 0.5 * rate), ("bob.vy", 0.0)]
    {
        let found = column(&solution, name)[0];
        assert!((found - expected).abs() < 1e-12, "{name}: {found} {expected}");
    }
    assert!((last(&solution, "kinetic_energy") / (0.5 * rate) - 1.0).abs() < 1e-6);
}

/// A pendulum of large amplitude, `a'' = -m g l sin a / (m l^2 + 2 m r^2 / 5)`, from rest at a right angle. Reference
/// at t = 2: a Runge-Kutta method of order 8 (DOP853) with a tolerance of 1e-13.
#[test]
fn a_pendulum_on_a_hinge_swings_wide_at_second_order_and_keeps_its_energy() {
    let (angle, rate) = (0.9028063991278799_f64, 3.4791365091328657);
    let error = |step: f64| {
        let hinge = json!([{"hinge": {"bodies": ["bob"], "at": [0, 0, 5], "axis": [0, 1, 0]}}]);
        let solution = solve(&joined(&[ball("bob", [1.0, 0.0, 5.0])], &hinge, 2.0, step));
        let exact = [
            ("bob.x", angle.sin()),
            ("bob.z", 5.0 - angle.cos()),
            ("bob.vx", rate * angle.cos()),
            ("bob.vz", rate * angle.sin()),
            ("bob.wy", -rate),
        ];
        let energy = solution.diagnostics.energy.unwrap().largest_defect;
        assert!(energy < (9.81 * step).powi(2), "{energy:e}");
        exact.iter().map(|(name, exact)| (last(&solution, name) - exact).abs()).fold(0.0, f64::max)
    };
    let (coarse, fine) = (error(2e-3), error(1e-3));
    assert!(fine < 1e-4 && (coarse / fine).log2() > 1.95, "{coarse:e} {fine:e}");
}
