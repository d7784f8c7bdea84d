//! Verdicts of time stepping, which compares runs with different step sizes: a trusted answer is as accurate as the
//! verdict claims, whichever field is asked for.

use super::solve;
use crate::systems::harness::distance;
use serde_json::{Value, json};
use std::f64::consts::TAU;

const G: f64 = 9.81;

/// Permitted error of a trusted answer, relative to the largest change of the field over the run: two digits.
const PERMITTED: f64 = 1e-2;

/// Specification of rigid bodies under gravity up to the time `end`, with one output field.
fn scene(bodies: &Value, others: Value, [end, step]: [f64; 2], field: &str) -> Value {
    let mut problem = json!({"gravity": [0, 0, -G], "bodies": bodies});
    for (key, value) in others.as_object().expect("an object") {
        problem[key] = value.clone();
    }
    let times: Vec<f64> = (1..=4).map(|k| end * f64::from(k) / 4.0).collect();
    json!({"problem": {"rigid_bodies": problem}, "time": {"end": end}, "method": {"step": step, "impacts": "time_stepping"},
        "output": {"times": times, "fields": [field]}})
}

fn ground() -> Value {
    json!({"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true})
}

/// Solves the system with each number of steps, and returns whether the solutions are trusted; asserts that trusted
/// ones have an error of at most `permitted` times the change `size`.
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

/// Returns the height of a bouncing point over the floor at the time `t`, dropped from `height`.
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
    // The reference integrates theta'' = -(m g L sin theta + k (theta - start)) / I by a Runge-Kutta method with far
    // shorter steps.
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
    // A ball on a spring: a vibration that is small compared with the radius, and one far from the origin.
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
    // Friction dissipates the energy mu m g s of a box that slides by the distance s.
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
        // The impulse of the Gaussian force is the square root of pi.
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
    // The lower ball hits the ground and then the upper ball, which is a micrometre above it.
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
    // A box that falls flat hits the ground with four corners at the same time.
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

/// Returns the time of impact of two balls of the same radius and the velocity of the first ball after it. The first
/// ball has the mass 1 and flies with `(2, 0, 0)` from `(-1, 0, 0)`; the second has the mass `m` and rests at `(0, b,
/// 0)`; there is no friction.
fn glanced(b: f64, m: f64, reach: f64) -> (f64, [f64; 2]) {
    let along = (reach * reach - b * b).sqrt();
    let normal = [along / reach, b / reach];
    let impulse = 2.0 * 2.0 * normal[0] / (1.0 + 1.0 / m);
    (0.5 * (1.0 - along), [2.0 - impulse * normal[0], -impulse * normal[1]])
}

/// After an impact on a curved surface a body moves along the normal, which depends on the time of the impact: runs
/// with steps of `h` and `2h` may agree by chance.
#[test]
fn impacts_on_curved_surfaces_go_where_they_go() {
    let mut trusted = 0;
    let steps: Vec<u32> = (1..=24).map(|k| 75 * k + 7 * (k % 5)).collect();
    for (b, m) in [(0.1, 2.0), (0.15, 1.0), (0.05, f64::INFINITY), (0.17, f64::INFINITY)] {
        let (impact, after) = glanced(b, m, 0.2);
        let size = |k: usize| (after[k] * (1.5 - impact)).abs();
        let mut other = json!({"name": "c", "shape": {"sphere": {"radius": 0.1}}, "position": [0, b, 0]});
        if m.is_finite() {
            other["mass"] = json!(m)
        } else {
            other["fixed"] = json!(true)
        }
        let balls = json!([{"name": "a", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [-1, 0, 0], "velocity": [2, 0, 0]}, other]);
        let others = json!({"gravity": [0, 0, 0], "contacts": {"restitution": 1}});
        let system = |count: f64| scene(&balls, others.clone(), [1.5, 1.5 / count], "a.y");
        let across = |t: f64| after[1] * (t - impact).max(0.0);
        trusted += judged(system, &steps, ("a.y", &across, size(1)), 1.2 * PERMITTED).iter().filter(|is| **is).count();
        // The impact on a fixed ball in generalised coordinates, where an error of a thousandth is permitted.
        if m.is_infinite() {
            let gap = format!("sqrt(x^2 + (y - {b})^2) - 0.2");
            let point = |count: f64| {
                json!({"problem": {"mechanical": {"coordinates": {"x": {"initial": -1, "velocity": 2}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
                    "contacts": [{"name": "c", "gap": gap, "restitution": 1}]}}, "time": {"end": 1.5},
                    "method": {"step": 1.5 / count, "impacts": "time_stepping"}, "output": {"times": [1, 1.5], "fields": ["y"]}})
            };
            let fine: Vec<u32> = steps.iter().map(|count| 5 * count).collect();
            judged(point, &fine, ("y", &across, size(1)), 2e-3);
        }
    }
    assert!(trusted > 20, "{trusted} of {} are trusted", 4 * steps.len());
}

/// Bodies with prescribed motion, a paddle whose period is the step size and a blade that makes whole turns in a step,
/// seem to be at rest at the ends of steps.
#[test]
fn motions_that_steps_do_not_see_are_doubted() {
    let ball =
        |place: [f64; 3]| json!({"name": "b", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": place});
    let paddle = json!({"name": "p", "shape": {"box": {"size": [0.1, 1, 1]}}, "motion": {"position": [format!("-0.4 + 0.2*sin({}*t)", 100.0 * TAU), 0, 0]}});
    let blade = json!({"name": "p", "shape": {"box": {"size": [2, 0.02, 0.02]}}, "motion": {"angular_velocity": [0, 0, 100.0 * TAU]}});
    let still = json!({"gravity": [0, 0, 0]});
    for (given, place, field) in [(paddle, [-0.1, 0.0, 0.0], "b.x"), (blade, [0.0, 0.6, 0.0], "b.y")] {
        for step in [0.02, 0.01, 0.005] {
            let system = scene(&json!([given, ball(place)]), still.clone(), [0.1, step], field);
            assert!(!solve(&system).verdict.trusted, "{field}, steps of {step}");
            // A ball that is far from the body with prescribed motion is not affected, and its run is trusted.
            let far = scene(&json!([given, ball([10.0, 0.0, 0.0])]), still.clone(), [0.1, step], field);
            assert!(solve(&far).verdict.trusted, "{field}, steps of {step}, far away");
        }
    }
    // A cylindrical roller may rotate about its axis at any speed, since rotation does not change its surface.
    let roller = json!({"name": "p", "shape": {"cylinder": {"radius": 0.5, "length": 1}}, "motion": {"angular_velocity": [0, 0, 100.0 * TAU]}});
    let system = scene(&json!([roller, ball([0.0, 0.7, 0.0])]), still, [0.1, 0.01], "b.y");
    assert!(solve(&system).verdict.trusted);
}

/// A force that acts within a width of half a millimetre, which steps of five centimetres skip.
#[test]
fn forces_that_are_narrow_in_space_are_seen() {
    let force = "2000*exp(-((b.x - 0.5037)/0.0005)^2)";
    let speed = (1.0 + 2.0 * 2000.0 * 0.0005 * std::f64::consts::PI.sqrt()).sqrt();
    let exact = |t: f64| t.min(0.5037) + speed * (t - 0.5037).max(0.0);
    let ball = json!([{"name": "b", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 0], "velocity": [1, 0, 0]}]);
    let others = json!({"gravity": [0, 0, 0], "forces": [{"body": "b", "force": [force, 0, 0]}]});
    let system = |count: f64| scene(&ball, others.clone(), [1.2, 1.2 / count], "b.x");
    let verdicts = judged(system, &[24, 60, 120, 240, 24_000], ("b.x", &exact, 2.0), PERMITTED);
    assert_eq!(verdicts.last(), Some(&true));
    // A run with a spring force, which varies slowly along the path, is trusted.
    let others = json!({"gravity": [0, 0, 0], "forces": [{"body": "b", "force": ["-4*b.x", 0, 0]}]});
    let system = |count: f64| scene(&ball, others.clone(), [3.0, 3.0 / count], "b.x");
    let verdicts = judged(system, &[100, 1000], ("b.x", &|t| 0.5 * (2.0 * t).sin(), 0.5), PERMITTED);
    assert_eq!(verdicts, [true, true]);
}
