//! Time stepping beside longer steps: an answer that is trusted is as good as the verdict says, whatever is asked for.

use super::solve;
use crate::systems::harness::distance;
use serde_json::{Value, json};
use std::f64::consts::TAU;

const G: f64 = 9.81;

/// Two digits, of the largest change of what is asked for.
const PERMITTED: f64 = 1e-2;

/// A scene of rigid bodies over time, of which one field is asked for.
fn scene(bodies: &Value, others: Value, [end, step]: [f64; 2], field: &str) -> Value {
    let mut problem = json!({"gravity": [0, 0, -G], "bodies": bodies});
    for (key, value) in others.as_object().expect("an object") {
        problem[key] = value.clone();
    }
    let times: Vec<f64> = (1..=4).map(|k| end * f64::from(k) / 4.0).collect();
    json!({"problem": {"rigid_bodies": problem}, "time": {"end": end}, "method": {"step": step},
        "output": {"times": times, "fields": [field]}})
}

fn ground() -> Value {
    json!({"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true})
}

/// Solves with each number of steps, and returns the verdicts; asserts that what is trusted is within `permitted` of the
/// change `size`.
fn judged(
    system: impl Fn(f64) -> Value,
    steps: &[u32],
    (field, exact, size): (&str, &dyn Fn(f64) -> f64, f64),
    permitted: f64,
) -> Vec<bool> {
    let verdict = |&count: &u32| {
        let solution = solve(&system(f64::from(count)));
        let error = distance(&solution, field, exact) / size;
        assert!(!solution.verdict.trusted || error < permitted, "{count} steps: {field} is off by {error:e}");
        solution.verdict.trusted
    };
    steps.iter().map(verdict).collect()
}

/// The height of a point over the floor, dropped from `height`.
fn bounces(height: f64, restitution: f64, mut t: f64) -> f64 {
    let impact = (2.0 * height / G).sqrt();
    if t < impact {
        return height - 0.5 * G * t * t;
    }
    t -= impact;
    let mut speed = restitution * G * impact;
    while speed > 1e-9 {
        let flight = 2.0 * speed / G;
        if t < flight {
            return speed * t - 0.5 * G * t * t;
        }
        t -= flight;
        speed *= restitution;
    }
    0.0
}

#[test]
fn bodies_on_joints_are_compared_with_longer_parts() {
    // Theta'' = -(m g L sin theta + k (theta - start)) / I, by a method of Runge and Kutta with far shorter steps.
    for (length, start, stiffness) in [(1.0_f64, 2.0_f64, 0.0), (0.01, 1.2, 0.0), (0.3, 1.0, 20.0)] {
        let (radius, inertia) = (0.1 * length, 1.004 * length * length);
        let rate = |[angle, speed]: [f64; 2]| {
            [speed, -(G * length * angle.sin() + stiffness * G * length * (angle - start)) / inertia]
        };
        let end = 3.0 * TAU * (length / G).sqrt();
        let angle_at = |t: f64| {
            let (count, mut at) = (4000, [start, 0.0]);
            let h = t / f64::from(count);
            let go = |from: [f64; 2], by: [f64; 2], h: f64| [from[0] + h * by[0], from[1] + h * by[1]];
            for _ in 0..count {
                let a = rate(at);
                let b = rate(go(at, a, 0.5 * h));
                let c = rate(go(at, b, 0.5 * h));
                let d = rate(go(at, c, h));
                at = [0, 1].map(|k| at[k] + h / 6.0 * (a[k] + 2.0 * b[k] + 2.0 * c[k] + d[k]));
            }
            at[0]
        };
        let system = |count: f64| {
            let mut hinge = json!({"bodies": ["b"], "at": [0, 0, 0], "axis": [0, 1, 0]});
            if stiffness > 0.0 {
                hinge["spring"] = json!({"stiffness": stiffness * G * length, "rest": 0});
            }
            let bob = json!([{"name": "b", "shape": {"sphere": {"radius": radius}}, "mass": 1,
                "position": [length * start.sin(), 0, -length * start.cos()]}]);
            scene(&bob, json!({"joints": [{"hinge": hinge}]}), [end, end / count], "b.x")
        };
        let exact = |t: f64| length * angle_at(t).sin();
        let verdicts = judged(system, &[6, 12, 25, 50, 100, 5000], ("b.x", &exact, length), PERMITTED);
        assert!(!verdicts[0] && verdicts[5], "{length}: {verdicts:?}");
    }
}

#[test]
fn what_is_asked_for_is_measured_by_its_own_change() {
    let (height, restitution) = (1.0, 0.5);
    for (place, speed) in [(0.0, 1.0), (0.0, 1e4), (1e5, 10.0)] {
        let ball = json!([ground(), {"name": "b", "shape": {"sphere": {"radius": 0.1}}, "mass": 1,
            "position": [place, 0, height + 0.1], "velocity": [speed, 0, 0]}]);
        let system =
            |count: f64| scene(&ball, json!({"contacts": {"restitution": restitution}}), [1.0, 1.0 / count], "b.z");
        let exact = |t: f64| 0.1 + bounces(height, restitution, t);
        let verdicts = judged(system, &[20, 50, 100, 200, 8000], ("b.z", &exact, height), PERMITTED);
        assert!(!verdicts[0] && verdicts[4], "{place}, {speed}: {verdicts:?}");
    }
    // A small vibration of a body that is neither small nor near.
    for (size, place) in [(1e-6, 0.0), (1e-3, 1e3)] {
        let ball =
            json!([{"name": "b", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [place + size, 0, 0]}]);
        let forces = json!({"forces": [{"body": "b", "force": [format!("{place} - b.x"), 0, 0]}]});
        let system = |count: f64| scene(&ball, forces.clone(), [6.0, 6.0 / count], "b.x");
        let exact = |t: f64| place + size * t.cos();
        let verdicts = judged(system, &[5, 10, 20, 1000], ("b.x", &exact, size), PERMITTED);
        assert!(!verdicts[0] && verdicts[3], "{size}: {verdicts:?}");
    }
}

#[test]
fn outputs_that_are_no_states_are_compared_themselves() {
    let (height, restitution) = (1.0, 0.5);
    let ball = json!([ground(), {"name": "b", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, height + 0.1]}]);
    let others = json!({"contacts": {"restitution": restitution}, "definitions": {"q": "exp(4*b.z)"}});
    let system = |count: f64| scene(&ball, others.clone(), [1.0, 1.0 / count], "q");
    let exact = |t: f64| (4.0 * (0.1 + bounces(height, restitution, t))).exp();
    let size = (4.0 * (0.1 + height)).exp();
    let verdicts = judged(system, &[20, 50, 100, 200, 16000], ("q", &exact, size), PERMITTED);
    assert!(!verdicts[0] && verdicts[4], "{verdicts:?}");
    // Friction takes the energy mu m g s of a box that slides.
    let slider = json!([ground(), {"name": "b", "shape": {"box": {"size": [0.4, 0.4, 0.1]}}, "mass": 2, "position": [0, 0, 0.05],
        "velocity": [2, 0, 0]}]);
    let system = |count: f64| {
        scene(&slider, json!({"contacts": {"friction": 0.3}}), [0.5, 0.5 / count], "dissipated_by_friction")
    };
    let exact = |t: f64| 2.0 * 0.3 * G * (2.0 * t - 0.15 * G * t * t);
    judged(system, &[4, 8, 20, 100, 1000], ("dissipated_by_friction", &exact, exact(0.5)), PERMITTED);
}

#[test]
fn bodies_of_any_mass_move() {
    for mass in [1e-200, 1e-130, 1e-20, 1.0, 1e20] {
        let ball = json!([ground(), {"name": "b", "shape": {"sphere": {"radius": 0.1}}, "mass": mass, "position": [0.5, 0, 1],
            "velocity": [1, 0, 0]}]);
        let verdicts =
            judged(|count| scene(&ball, json!({}), [0.4, 0.4 / count], "b.x"), &[40], ("b.x", &|t| 0.5 + t, 0.4), 1e-9);
        assert_eq!(verdicts, [true], "{mass}");
    }
}

#[test]
fn forces_that_vary_within_a_step_are_seen() {
    for (centre, width) in [(0.333, 1e-3), (0.5071, 1e-4), (0.71, 0.01)] {
        let pulse = format!("exp(-((t - {centre})/{width})^2)/{width}");
        // The impulse is the root of pi.
        let moved = |t: f64| std::f64::consts::PI.sqrt() * (t - centre).max(0.0);
        let point = |count: f64| {
            json!({"problem": {"mechanical": {"coordinates": {"x": {"initial": 0}}, "mass": [[1]], "forces": {"x": pulse}}},
                "time": {"end": 1}, "method": {"step": 1.0 / count, "impacts": "time_stepping"},
                "output": {"times": [0.25, 1], "fields": ["x"]}})
        };
        judged(point, &[10, 100, 1000], ("x", &moved, 1.0), 2e-3);
        let ball = json!([{"name": "b", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 0]}]);
        let others = json!({"gravity": [0, 0, 0], "forces": [{"body": "b", "force": [pulse, 0, 0]}]});
        let body = |count: f64| {
            let mut system = scene(&ball, others.clone(), [1.0, 1.0 / count], "b.x");
            system["output"]["times"] = json!([0.25, 1]);
            system
        };
        judged(body, &[10, 100, 1000], ("b.x", &moved, 1.0), PERMITTED);
    }
}

#[test]
fn impacts_in_turn_within_a_step_are_doubted_and_impacts_at_once_are_not() {
    // The lower ball hits the ground, then the upper one, a micrometre above it.
    let (fall, e, ratio) = (0.5_f64, 0.8, 10.0);
    let impact = (2.0 * fall / G).sqrt();
    let (up, down) = (e * G * impact, -G * impact);
    let speed = down + (1.0 + e) * ratio / (ratio + 1.0) * (up - down);
    let end = impact + 0.3;
    let balls = json!([ground(), {"name": "a", "shape": {"sphere": {"radius": 0.1}}, "mass": ratio, "position": [0, 0, fall + 0.1]},
        {"name": "b", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, fall + 0.3 + 1e-6]}]);
    let system = |count: f64| {
        let mut system = scene(&balls, json!({"contacts": {"restitution": e}}), [end, end / count], "b.z");
        system["output"]["times"] = json!([end]);
        system
    };
    let exact = |t: f64| 0.3 + speed * (t - impact) - 0.5 * G * (t - impact).powi(2);
    judged(system, &[100, 1000, 4000], ("b.z", &exact, fall), PERMITTED);
    // A box that falls flat hits the ground with four corners at once.
    let flat = json!([ground(), {"name": "b", "shape": {"box": {"size": [0.2, 0.2, 0.2]}}, "mass": 1, "position": [0, 0, fall + 0.1]}]);
    let system = |count: f64| scene(&flat, json!({"contacts": {"restitution": e}}), [end, end / count], "b.z");
    let verdicts = judged(system, &[4000], ("b.z", &|t| 0.1 + bounces(fall, e, t), fall), PERMITTED);
    assert_eq!(verdicts, [true]);
}

#[test]
fn few_steps_of_free_flight_are_trusted() {
    let ball = json!([{"name": "b", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 5], "velocity": [1, 0, 0]}]);
    for field in ["b.x", "b.z"] {
        let exact = |t: f64| if field == "b.x" { t } else { 5.0 - 0.5 * G * t * t };
        let system = |count: f64| {
            let mut system = scene(&ball, json!({}), [0.3, 0.3 / count], field);
            system["output"]["times"] = json!([0.3]);
            system
        };
        let verdicts = judged(system, &[1, 2, 3, 5], (field, &exact, 0.3), 1e-9);
        assert_eq!(verdicts, [true; 4], "{field}");
    }
}
