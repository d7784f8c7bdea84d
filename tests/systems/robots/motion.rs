//! Motion of robots, compared with equations of motion that are derived and solved independently.

use super::specification;
use crate::systems::harness::{column, last, solve};
use serde_json::json;
use std::f64::consts::PI;

/// Returns the complete elliptic integral of the first kind at the modulus `k`, by the arithmetic-geometric mean
/// (Abramowitz and Stegun 1964, 17.6.3).
fn elliptic_k(k: f64) -> f64 {
    let (mut a, mut g) = (1.0, (1.0 - k * k).sqrt());
    for _ in 0..8 {
        (a, g) = (0.5 * (a + g), (a * g).sqrt());
    }
    PI / (2.0 * a)
}

#[test]
fn a_pendulum_has_the_period_of_the_elliptic_integral() {
    // A rod of one metre has the moment of inertia I = m l^2/3 about its pivot.
    let (angle, g) = (1.2_f64, 9.81);
    let period = 4.0 * (1.0 / 3.0 / (g * 0.5_f64)).sqrt() * elliptic_k((0.5 * angle).sin());
    let error = |steps: f64| {
        let mut document = specification("pendulum", json!({"theta": angle}), period, period / steps);
        document["output"] = json!({"times": "steps"});
        let solution = solve(&document);
        assert!(solution.verdict.trusted, "{:?}", solution.verdict);
        let energy = solution.diagnostics.energy.expect("a balance");
        assert!(energy.largest_defect < 1e-4 * 9.81, "{energy:?}");
        last(&solution, "theta.coordinate").abs()
    };
    let (coarse, fine) = (error(1000.0), error(4000.0));
    // After one period the pendulum is back at its initial angle, to second order.
    assert!(fine < 2e-5 && coarse / fine > 12.0, "{coarse:e}, {fine:e}");
}

/// Returns the angles of a double pendulum of two hinged rods after a second, by Lagrange's equations in relative
/// angles.
fn two_rods([first, second]: [f64; 2]) -> [f64; 2] {
    // The angle q1 is that of the first rod from the vertical, and q2 = q1 + elbow; the centres of mass are at the
    // distances c1, c2 from the pivots, and the moments of inertia refer to the centres.
    let document = json!({
        "problem": {"dvi": {
            "parameters": {"m1": 1.5, "c1": 0.4, "l": 0.8, "i1": 0.05, "m2": 0.8, "c2": 0.3, "i2": 0.02, "g": 9.81},
            "definitions": {
                "a": "i1 + m1*c1^2 + m2*l^2", "b": "m2*l*c2*cos(q1 - q2)", "d": "i2 + m2*c2^2",
                "f1": "-m2*l*c2*sin(q1 - q2)*w2^2 - (m1*c1 + m2*l)*g*sin(q1)",
                "f2": "m2*l*c2*sin(q1 - q2)*w1^2 - m2*c2*g*sin(q2)"
            },
            "states": {
                "q1": {"initial": first, "rate": "w1"}, "q2": {"initial": first + second, "rate": "w2"},
                "w1": {"initial": 0, "rate": "(d*f1 - b*f2)/(a*d - b^2)"},
                "w2": {"initial": 0, "rate": "(a*f2 - b*f1)/(a*d - b^2)"}
            }
        }},
        "time": {"end": 1}, "method": {"rtol": 1e-11, "atol": 1e-12}
    });
    let solution = solve(&document);
    [last(&solution, "q1"), last(&solution, "q2") - last(&solution, "q1")]
}

#[test]
fn two_rods_move_by_lagranges_equations() {
    let pose = [1.1, 0.6];
    let exact = two_rods(pose);
    let error = |step: f64| {
        let document = specification("double_pendulum", json!({"shoulder": pose[0], "elbow": pose[1]}), 1.0, step);
        let solution = solve(&document);
        let found = ["shoulder", "elbow"].map(|joint| last(&solution, &format!("{joint}.coordinate")));
        (0..2).map(|k| (found[k] + pose[k] - exact[k]).abs()).fold(0.0, f64::max)
    };
    let (coarse, fine) = (error(1e-3), error(2.5e-4));
    assert!(fine < 4e-6 && (14.0..18.0).contains(&(coarse / fine)), "{coarse:e}, {fine:e}");
}

#[test]
fn several_joints_of_one_body_are_one_after_the_other() {
    // The torso of a hopper in free fall has three joints to the world, one after the other.
    let pose =
        json!({"rootz": 3.0, "rooty": {"position": 0.2, "velocity": 1.5}, "rootx": {"position": 0.3, "velocity": 0.4}});
    let solution = solve(&specification("hopper", pose, 0.2, 1e-4));
    // Internal joint forces do not move the centre of mass of the hopper, which falls freely: its velocity along x is
    // constant.
    let bodies = [("torso", 0.05, 0.4), ("thigh", 0.05, 0.45), ("leg", 0.04, 0.5), ("foot", 0.06, 0.26)];
    let mass = |r: f64, l: f64| 1000.0 * PI * r * r * (l + 4.0 / 3.0 * r);
    let total: f64 = bodies.iter().map(|(_, r, l)| mass(*r, *l)).sum();
    // Centres of mass of the hopper's links in the frames of the links, as x and z.
    let centre = [[0.0, 0.0], [0.0, -0.225], [0.0, 0.0], [-0.065, 0.0]];
    let at = |row: usize, axis: usize| -> f64 {
        let of = |k: usize| {
            let (name, r, l) = bodies[k];
            let [x, z] = centre[k];
            let column = |key: &str| column(&solution, &format!("{name}.{key}"))[row];
            let angle = 2.0 * column("qy").atan2(column("qw"));
            let (s, c) = angle.sin_cos();
            mass(r, l) * if axis == 0 { column("x") + c * x + s * z } else { column("z") - s * x + c * z }
        };
        (0..4).map(of).sum::<f64>() / total
    };
    let rows = solution.trajectory.t.len() - 1;
    let t = solution.trajectory.t[rows];
    // Initial velocity of the hopper's centre of mass from the velocities of its links: differences of the first output
    // rows would be of first order only.
    let speed = |axis: usize| {
        let of = |k: usize| {
            let (name, r, l) = bodies[k];
            let [x, z] = centre[k];
            let column = |key: &str| column(&solution, &format!("{name}.{key}"))[0];
            let (s, c) = (2.0 * column("qy").atan2(column("qw"))).sin_cos();
            let (dx, dz) = (c * x + s * z, -s * x + c * z);
            mass(r, l) * if axis == 0 { column("vx") + column("wy") * dz } else { column("vz") - column("wy") * dx }
        };
        (0..4).map(of).sum::<f64>() / total
    };
    let along = at(rows, 0) - at(0, 0) - speed(0) * t;
    let down = at(rows, 1) - at(0, 1) - speed(1) * t + 0.5 * 9.81 * t * t;
    assert!(along.abs() < 1e-5 && down.abs() < 1e-5, "{along:e}, {down:e}");
    assert!((column(&solution, "torso.x")[0] - 0.3).abs() < 1e-12);
    assert!((column(&solution, "torso.wy")[0] - 1.5).abs() < 1e-12);
    assert!(column(&solution, "torso.y").iter().all(|y| y.abs() < 1e-9));
}

#[test]
fn a_parallelogram_stays_one() {
    let pose = json!({"crank": {"position": 0.5, "velocity": 3}, "coupler": {"position": -0.5, "velocity": -3}, "rocker": {"position": 0.5, "velocity": 3}});
    let solution = solve(&specification("four_bar", pose, 0.5, 1e-3));
    for (crank, rocker) in
        column(&solution, "crank_joint.coordinate").iter().zip(column(&solution, "rocker_joint.coordinate"))
    {
        assert!((crank - rocker).abs() < 1e-6, "{crank} and {rocker}");
    }
    assert!(column(&solution, "coupler.qy").iter().all(|q| q.abs() < 1e-6));
}

#[test]
fn a_motor_drives_a_joint_of_a_robot() {
    // A cart with a pole that a motor keeps upright: together 11 kg that move along a line.
    let mut document = specification("cartpole", json!({}), 0.5, 1e-4);
    document["problem"]["rigid_bodies"]["gravity"] = json!([0, 0, 0]);
    document["problem"]["rigid_bodies"]["robot"]["motors"] =
        json!({"slider_to_cart": {"effort": "22"}, "cart_to_pole": {"position": "0"}});
    let solution = solve(&document);
    let exact = 0.5 * 22.0 / 11.0 * 0.25;
    assert!((last(&solution, "cart.x") - exact).abs() < 1e-6, "{}", last(&solution, "cart.x"));
}
