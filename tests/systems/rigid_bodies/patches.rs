//! Friction on a patch: sliding and drilling of a disc with uniform pressure, and rolling friction, against closed forms
//! and an independent integration.

use super::on_the_ground;
use crate::systems::harness::{column, distance, last, solve};
use dvi::solution::Solution;
use serde_json::{Value, json};
use std::f64::consts::PI;

const G: f64 = 9.81;
const MU: f64 = 0.3;
const R: f64 = 0.1;

/// A disc of unit mass and radius `R`: it touches the ground below its centre of mass, on a patch of its radius.
fn disc(velocity: [f64; 2], spin: f64) -> Value {
    let axial = 0.5 * R * R;
    json!({"name": "disc", "shape": {"sphere": {"radius": 0.02}}, "mass": 1, "centre_of_mass": [0, 0, -0.02],
        "inertia": [0.5 * axial, 0.5 * axial, axial], "position": [0, 0, 0.02],
        "velocity": [velocity[0], velocity[1], 0], "angular_velocity": [0, 0, spin]})
}

fn on_a_patch(velocity: [f64; 2], spin: f64, end: f64, step: f64) -> Value {
    on_the_ground(&[disc(velocity, spin)], &json!({"friction": MU, "patch": R}), end, step)
}

/// Asserts that the run is trusted, that the law was solved to its tolerance, and that friction took the energy that is
/// missing.
fn assert_sound(solution: &Solution, lost: f64) {
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let residual = solution.diagnostics.vi.as_ref().unwrap().largest_residual;
    assert!(residual <= 1e-10, "{residual:e}");
    let booked = last(solution, "dissipated_by_friction");
    assert!((booked - lost).abs() < 1e-9 * lost.max(1.0), "{booked} for {lost}");
}

#[test]
fn pure_spin_has_two_thirds_of_the_torque_and_pure_sliding_the_whole_force() {
    // w' = -2/3 mu m g R/I = -4/3 mu g/R, and v' = -mu g, whatever the step.
    for step in [1e-2, 1e-3] {
        let solution = solve(&on_a_patch([0.0; 2], 20.0, 1.0, step));
        let rate = 4.0 / 3.0 * MU * G / R;
        assert!(distance(&solution, "disc.wz", |t| (20.0 - rate * t).max(0.0)) < 1e-9);
        assert_sound(&solution, 0.25 * R * R * 400.0);
        assert!(last(&solution, "disc.vx").abs() + last(&solution, "disc.x").abs() < 1e-12);
        let solution = solve(&on_a_patch([2.0, 0.0], 0.0, 1.0, step));
        assert!(distance(&solution, "disc.vx", |t| (2.0 - MU * G * t).max(0.0)) < 1e-9);
        assert_sound(&solution, 2.0);
        assert!(last(&solution, "disc.wz").abs() < 1e-12);
    }
}

/// The deceleration and the angular one of the disc, by sums over its surface in place of elliptic integrals.
fn decelerations(v: f64, w: f64) -> [f64; 2] {
    let (rings, parts) = (60, 60);
    let mut sums = [0.0; 2];
    for i in 0..rings {
        let r = R * (f64::from(i) + 0.5) / f64::from(rings);
        for j in 0..parts {
            let (sine, cosine) = (2.0 * PI * (f64::from(j) + 0.5) / f64::from(parts)).sin_cos();
            let (x, y) = (v - w * r * sine, w * r * cosine);
            let weight = 2.0 * r / R / f64::from(rings * parts) / x.hypot(y);
            sums[0] += weight * x;
            sums[1] += weight * r * (y * cosine - x * sine);
        }
    }
    [MU * G * sums[0], MU * G * sums[1] / (0.5 * R * R)]
}

#[test]
fn a_disc_that_slides_and_spins_follows_an_integration_over_its_surface() {
    // The midpoint rule, by steps a tenth of the time stepping.
    let (mut v, mut w, h) = (1.0_f64, 8.0_f64, 1e-4);
    let (mut t, mut exact) = (0.0, vec![(0.0, v, w)]);
    while t < 0.35 {
        let [a, b] = decelerations(v, w);
        let [a, b] = decelerations(v - 0.5 * h * a, w - 0.5 * h * b);
        (v, w, t) = (v - h * a, w - h * b, t + h);
        exact.push((t, v, w));
    }
    let at = |t: f64| exact[((t / h).round() as usize).min(exact.len() - 1)];
    let errors = [2e-3, 1e-3].map(|step| {
        let solution = solve(&on_a_patch([1.0, 0.0], 8.0, 0.3, step));
        let velocity = distance(&solution, "disc.vx", |t| at(t).1);
        velocity.max(R * distance(&solution, "disc.wz", |t| at(t).2))
    });
    // Friction that is not coupled stops the disc at 0.34 s, and its spin at 0.2 s: it is off by 0.2 m/s.
    assert!(errors[1] < 2e-3 && errors[1] < 0.6 * errors[0], "{errors:?}");
}

/// Farkas, Bartels, Unger and Wolf 2003: sliding and spinning end together, with `v/(R w) = 0.653` at the end.
#[test]
fn a_disc_stops_to_slide_and_to_spin_together_at_the_ratio_of_farkas() {
    for (v, spin) in [(0.3, 10.0), (1.0, 10.0), (1.0, 3.0)] {
        let solution = solve(&on_a_patch([v, 0.0], spin, 1.0, 1e-4));
        assert_sound(&solution, 0.5 * v * v + 0.25 * R * R * spin * spin);
        assert!(last(&solution, "disc.vx").abs() < 1e-12 && last(&solution, "disc.wz").abs() < 1e-12);
        let mut fine = on_a_patch([v, 0.0], spin, 1.0, 1e-4);
        fine["output"]["times"] = json!("steps");
        let solution = solve(&fine);
        let (vx, wz) = (column(&solution, "disc.vx"), column(&solution, "disc.wz"));
        let moving = vx.iter().filter(|v| **v > 1e-12).count();
        let spinning = wz.iter().filter(|w| **w > 1e-10).count();
        assert_eq!(moving, spinning, "sliding and spinning end in different steps");
        // Near the end, and some steps before it: the last ones are as long as the time that is left.
        let near = (0..moving).find(|&k| vx[k] < 0.02).unwrap();
        let ratio = vx[near] / (R * wz[near]);
        assert!((ratio - 0.653).abs() < 0.01, "{v} {spin}: {ratio}");
    }
}

#[test]
fn a_ball_rolls_to_the_place_of_its_closed_form() {
    // 7/5 m v' = -c m g/r about the place of contact: the ball stops after 7 r v^2/(10 c g).
    let (v, r, c) = (1.0, 0.1, 2e-3);
    let ball = json!({"name": "ball", "shape": {"sphere": {"radius": r}}, "mass": 2, "position": [0, 0, r],
        "velocity": [v, 0, 0], "angular_velocity": [0, v / r, 0]});
    let way = 7.0 * r * v * v / (10.0 * c * G);
    let rate = 5.0 * c * G / (7.0 * r);
    for step in [1e-2, 1e-3] {
        let solution =
            solve(&on_the_ground(std::slice::from_ref(&ball), &json!({"friction": 0.5, "rolling": c}), 8.0, step));
        assert!(distance(&solution, "ball.vx", |t| (v - rate * t).max(0.0)) < 1e-9);
        assert!((last(&solution, "ball.x") - way).abs() < 0.51 * v * step + 1e-9, "{}", last(&solution, "ball.x"));
        assert_sound(&solution, 0.7 * 2.0 * v * v);
    }
    // On a slope of tangent s the ball stays if s r < c, and rolls with 5/7 g (s - c/r) beyond.
    for (slope, acceleration) in [(0.019, 0.0), (0.05, 5.0 / 7.0 * G * (0.05 - c / r))] {
        let mut rest = ball.clone();
        (rest["velocity"], rest["angular_velocity"]) = (json!([0, 0, 0]), json!([0, 0, 0]));
        let mut scene = on_the_ground(&[rest], &json!({"friction": 0.5, "rolling": c}), 1.0, 1e-3);
        scene["problem"]["rigid_bodies"]["gravity"] = json!([G * slope, 0, -G]);
        let found = last(&solve(&scene), "ball.vx");
        assert!((found - acceleration).abs() < 1e-9, "{slope}: {found}");
    }
}

/// Scenes that a law may stumble over: each ends, and is trusted or says why not.
#[test]
fn patches_of_all_kinds_are_solved() {
    let contacts = [
        json!({"friction": 0.3, "patch": 0}),
        json!({"friction": 0, "patch": 0.1, "rolling": 0.01}),
        json!({"friction": 0, "patch": 0.1}),
        json!({"friction": 0.5, "patch": 1e-6, "rolling": 1e-6}),
        json!({"friction": 5, "patch": 10, "rolling": 0.1}),
        json!({"friction": "0.1 + 0.3*exp(-slip_speed/0.1)", "patch": 0.05, "rolling": 0.001}),
        json!({"friction": 0.3, "restitution": 0.5, "patch": 0.02, "rolling": 0.001}),
    ];
    for contacts in contacts {
        let ball = json!({"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 0.15],
            "velocity": [1, 0.2, 0], "angular_velocity": [1, 2, 30]});
        let other = json!({"name": "brick", "shape": {"box": {"size": [0.2, 0.2, 0.1]}}, "mass": 3, "position": [0.4, 0.1, 0.06],
            "velocity": [0, 0, 0], "angular_velocity": [0, 0, 2]});
        let solution = solve(&on_the_ground(&[ball, other], &contacts, 1.0, 1e-3));
        assert!(solution.verdict.trusted, "{contacts}: {:?}", solution.verdict);
        let residual = solution.diagnostics.vi.as_ref().unwrap().largest_residual;
        assert!(residual < 1e-8, "{contacts}: {residual:e}");
    }
}

/// A ball on a table that turns and a ball that holds on to a hinge: prescribed motion and joints.
#[test]
fn a_ball_on_a_turning_table_is_turned_by_drilling() {
    let table = json!({"name": "table", "shape": {"cylinder": {"radius": 1, "length": 0.1}}, "position": [0, 0, -0.05],
        "motion": {"angular_velocity": [0, 0, 3]}});
    let ball = json!({"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 0.1]});
    let scene = |joints: Value| {
        json!({"problem": {"rigid_bodies": {"gravity": [0, 0, -G], "bodies": [table, ball], "joints": joints,
            "contacts": {"friction": 0.2, "patch": 0.03}}}, "time": {"end": 1}, "method": {"step": 1e-3},
            "output": {"times": {"count": 101}}})
    };
    // The torque 2/3 mu m g R drives the ball until it turns as the table.
    let rate = 2.0 / 3.0 * 0.2 * G * 0.03 / (0.4 * 0.01);
    let hinge = json!([{"hinge": {"bodies": ["ball"], "at": [0, 0, 0.1], "axis": [0, 0, 1]}}]);
    for joints in [json!([]), hinge] {
        let solution = solve(&scene(joints.clone()));
        let error = distance(&solution, "ball.wz", |t| (rate * t).min(3.0));
        assert!(error < if joints == json!([]) { 1e-8 } else { 0.05 }, "{joints}: {error:e}");
        assert!((last(&solution, "ball.wz") - 3.0).abs() < 1e-8);
        assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    }
}
