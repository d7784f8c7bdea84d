//! Rigid bodies with impacts located in time: compared with closed forms or, where there are none, checked for second
//! order.

use super::{locate, on_the_ground, stepped, weightless};
use crate::systems::harness::{column, distance, last, solve};
use dvi::problem::EventKind;
use dvi::solution::{CheckCode, Solution};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use serde_json::{Value, json};

const G: f64 = 9.81;
/// Least observed order that counts as second order: the error decreases by a factor of 3.6 when the step is halved,
/// which allows for terms of third order.
const SECOND: f64 = 1.85;

fn ball(position: [f64; 3], velocity: [f64; 3], omega: [f64; 3]) -> Value {
    json!({"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": position, "velocity": velocity,
        "angular_velocity": omega})
}

fn times(solution: &Solution, kind: EventKind) -> Vec<f64> {
    solution.trajectory.events.iter().filter(|event| event.kind == kind).map(|event| event.t).collect()
}

/// Returns the position, velocity and angular velocity of the body `name` at the end of the run.
fn end(solution: &Solution, name: &str) -> [Vector3<f64>; 3] {
    [["x", "y", "z"], ["vx", "vy", "vz"], ["wx", "wy", "wz"]]
        .map(|keys| Vector3::from(keys.map(|key| last(solution, &format!("{name}.{key}")))))
}

/// Asserts that the error of a run decreases with second order when its step size is halved.
fn assert_second_order(step: f64, error: impl Fn(f64) -> f64) {
    let errors = [1.0, 0.5, 0.25].map(|part| error(part * step));
    assert!((errors[0] / errors[2]).log2() >= 2.0 * SECOND, "{errors:?}");
}

/// Returns the height of a ball dropped from rest over its height at rest, its velocity, and the number of impacts up
/// to the time `t`.
fn bounces(height: f64, e: f64, t: f64) -> (f64, f64, usize) {
    let (mut from, mut v, mut k) = (0.0, (2.0 * G * height).sqrt(), 0);
    let mut to = v / G;
    if t < to {
        return (height - 0.5 * G * t * t, -G * t, 0);
    }
    while t >= to {
        (from, v, k) = (to, e * v, k + 1);
        to = from + 2.0 * v / G;
        if v < 1e-12 {
            return (0.0, 0.0, k);
        }
    }
    let d = t - from;
    (v * d - 0.5 * G * d * d, v - G * d, k)
}

#[test]
fn a_bouncing_ball_is_exact_at_any_step() {
    for (e, step, end) in [(0.8, 0.05, 2.5), (0.5, 0.02, 1.2), (1.0, 0.03, 20.0)] {
        let solution = solve(&locate(on_the_ground(
            &[ball([0.0, 0.0, 1.1], [0.3, 0.0, 0.0], [0.0; 3])],
            &json!({"restitution": e}),
            end,
            step,
        )));
        let found = times(&solution, EventKind::Impact);
        let (mut t, mut v) = ((2.0 / G).sqrt(), (2.0 * G).sqrt());
        let mut k = 0;
        while t < end && k < 8 {
            assert!((found[k] - t).abs() < 1e-9, "{e}, impact {k}: {} {t}", found[k]);
            v *= e;
            t += 2.0 * v / G;
            k += 1;
        }
        for (k, &t) in solution.trajectory.t.iter().enumerate() {
            let (z, vz, impacts) = bounces(1.0, e, t);
            if impacts <= 8 || e == 1.0 {
                assert!((column(&solution, "ball.z")[k] - 0.1 - z).abs() < 1e-9, "{e}, {t}");
                assert!((column(&solution, "ball.vz")[k] - vz).abs() < 1e-9, "{e}, {t}");
            }
            assert!((column(&solution, "ball.x")[k] - 0.3 * t).abs() < 1e-12);
        }
        let sum = |k: usize| -> f64 {
            ["kinetic_energy", "potential_energy", "lost_in_impacts"].map(|of| column(&solution, of)[k]).iter().sum()
        };
        let start = sum(0);
        assert!((0..=100).all(|k| (sum(k) / start - 1.0).abs() < 1e-9));
        assert!(!solution.diagnostics.warnings.iter().any(|warning| warning.code == "impacts_passed"));
    }
}

/// The impacts of a dropped ball accumulate at `t_1 (1 + e) / (1 - e)`, where `t_1` is the time of the first.
#[test]
fn a_bouncing_ball_comes_to_rest_at_the_right_time() {
    for e in [0.3, 0.5, 0.9_f64] {
        let rests = (2.0 / G).sqrt() * (1.0 + e) / (1.0 - e);
        for step in [2e-2, 1e-2, 5e-3] {
            let mut specification = locate(on_the_ground(
                &[ball([0.0, 0.0, 1.1], [0.0; 3], [0.0; 3])],
                &json!({"restitution": e}),
                rests + 0.5,
                step,
            ));
            specification["problem"]["rigid_bodies"]["bodies"][1]["contact_forces"] = json!(true);
            let solution = solve(&specification);
            let found = times(&solution, EventKind::Impact);
            // After a rebound with the velocity (g h)^2 / sqrt(g d), where h is the step size and d the radius, the
            // ball comes to rest within 2 / (1 - e) / g times that velocity, which bounds the error of the time of
            // rest.
            let due = 2.0 / (1.0 - e) * step * step * (G / 0.1).sqrt();
            assert!(found.last().is_some_and(|last| (last - rests).abs() < due), "{e}, {step}: {found:?} {rests}");
            assert!((last(&solution, "ball.z") - 0.1).abs() < step.powi(4) * G * G / 0.1);
            assert!(last(&solution, "ball.vz").abs() < 1e-12);
            assert!((last(&solution, "ball.contact_fz") - G).abs() < 1e-9);
        }
    }
}

/// A stop condition on the height of a ball with `e = 1/2`, which is met after its first impact in a step with
/// several impacts.
#[test]
fn a_condition_stops_a_ball_between_impacts_of_one_step() {
    let body = ball([0.0, 0.0, 1.1], [0.0; 3], [0.0; 3]);
    let mut specification = locate(on_the_ground(&[body], &json!({"restitution": 0.5}), 2.0, 0.4));
    specification["stop"] = json!([{"when": "ball.z - 0.14", "direction": "rising"}]);
    let solution = solve(&specification);
    let (t, v) = ((2.0 / G).sqrt(), 0.5 * (2.0 * G).sqrt());
    let rises = t + (v - (v * v - 2.0 * G * 0.04).sqrt()) / G;
    let ended = solution.ended_by.as_ref().expect("an end before the end");
    assert!((ended.t - rises).abs() < 1e-9, "{} {rises}", ended.t);
    assert!((last(&solution, "ball.z") - 0.14).abs() < 1e-8);
    assert_eq!(times(&solution, EventKind::Impact).len(), 1);
}

#[test]
fn balls_thrown_at_each_other_meet_where_their_relative_motion_says() {
    let balls = [
        json!({"name": "a", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 5], "velocity": [3, 0, 2]}),
        json!({"name": "b", "shape": {"sphere": {"radius": 0.2}}, "mass": 2, "position": [2, 0.1, 5], "velocity": [-1, 0, 2]}),
    ];
    let solution = solve(&locate(on_the_ground(&balls, &json!({"restitution": 0.7}), 0.9, 0.07)));
    // The two balls meet when the distance of their centres is |(2 - 4 t, 0.1)| = 0.3.
    let normal = Vector3::new(0.08_f64.sqrt(), 0.1, 0.0) / 0.3;
    let t = (2.0 - 0.08_f64.sqrt()) / 4.0;
    assert!((times(&solution, EventKind::Impact)[0] - t).abs() < 1e-12);
    let impulse = normal * (1.7 * 4.0 * normal.x / (1.0 + 0.5));
    let left = 0.9 - t;
    let fall = Vector3::new(0.0, 0.0, 2.0 - G * 0.9);
    for (name, x, v, share) in [
        ("a", Vector3::new(0.0, 0.0, 5.0), Vector3::new(3.0, 0.0, 0.0), -1.0),
        ("b", Vector3::new(2.0, 0.1, 5.0), Vector3::new(-1.0, 0.0, 0.0), 0.5),
    ] {
        let [position, velocity, _] = end(&solution, name);
        let z = Vector3::new(0.0, 0.0, 2.0 * 0.9 - 0.5 * G * 0.81);
        assert!((velocity - v - fall - impulse * share).norm() < 1e-11, "{name}: {velocity}");
        assert!((position - x - v * 0.9 - z - impulse * (share * left)).norm() < 1e-11, "{name}: {position}");
    }
}

/// Touching balls that are struck by another: with the sequential impact law the shock runs through the row, and with
/// the simultaneous law all balls share it.
#[test]
fn newtons_cradle_is_struck_as_a_whole() {
    let ball = |k: usize| {
        json!({"name": format!("b{k}"), "shape": {"sphere": {"radius": 0.5}}, "mass": 1,
            "position": [if k == 0 { -0.7 } else { k as f64 }, 0, 5], "velocity": [if k == 0 { 2 } else { 0 }, 0, 0]})
    };
    let bodies: Vec<Value> = (0..5).map(ball).collect();
    for law in ["sequential", "simultaneous"] {
        let mut specification = locate(weightless(on_the_ground(&bodies, &json!({"restitution": 1}), 1.0, 0.03)));
        specification["method"]["impact_law"] = json!(law);
        let solution = solve(&specification);
        for k in 0..5 {
            let before = if k == 0 { -0.7 } else { k as f64 };
            let (v0, v) = match (law, k) {
                ("sequential", 4) => (0.0, 2.0),
                ("sequential", k) => (if k == 0 { 2.0 } else { 0.0 }, 0.0),
                (_, 0) => (2.0, -2.0 * 3.0 / 5.0),
                _ => (0.0, 2.0 * 2.0 / 5.0),
            };
            let [x, velocity, _] = end(&solution, &format!("b{k}"));
            assert!((velocity.x - v).abs() < 1e-10, "{law}, {k}: {velocity}");
            assert!((x.x - before - 0.35 * v0 - 0.65 * v).abs() < 1e-10, "{law}, {k}: {x}");
        }
    }
}

/// A ball with spin bounces once: the friction impulse is the one that ends the slip, or `mu` times the normal
/// impulse.
#[test]
fn a_ball_with_spin_grips_or_slides_as_it_bounces() {
    for (mu, v, w) in [(0.8, 1.0, 20.0), (0.1, 1.0, -60.0), (0.3, 4.0, 0.0)] {
        let (e, r, end_time) = (0.6, 0.1, 0.9);
        let body = ball([0.0, 0.0, 1.1], [v, 0.0, 0.0], [0.0, w, 0.0]);
        let solution =
            solve(&locate(on_the_ground(&[body], &json!({"friction": mu, "restitution": e}), end_time, 0.04)));
        let (t, fast) = ((2.0 / G).sqrt(), (2.0 * G).sqrt());
        let slip = v - w * r;
        let p = slip.signum() * (slip.abs() * 2.0 / 7.0).min(mu * (1.0 + e) * fast);
        let [x, velocity, omega] = end(&solution, "ball");
        let d = end_time - t;
        assert!((velocity.x - (v - p)).abs() < 1e-10, "{mu}: {velocity}");
        assert!((omega.y - (w + p * r / (0.4 * r * r))).abs() < 1e-8, "{mu}: {omega}");
        assert!((x.x - v * t - (v - p) * d).abs() < 1e-10, "{mu}: {x}");
        assert!((x.z - 0.1 - e * fast * d + 0.5 * G * d * d).abs() < 1e-10, "{mu}: {x}");
    }
}

#[test]
fn a_sliding_ball_begins_to_roll_and_a_block_stops_at_their_times() {
    let mu = 0.3;
    for step in [0.05, 0.013] {
        let body = ball([0.0, 0.0, 0.1], [2.0, 0.0, 0.0], [0.0; 3]);
        let solution = solve(&locate(on_the_ground(&[body], &json!({"friction": mu}), 1.0, step)));
        let rolls = 2.0 * 2.0 / (7.0 * mu * G);
        let found = times(&solution, EventKind::Stick);
        assert!(found.len() == 1 && (found[0] - rolls).abs() < 1e-6, "{found:?} {rolls}");
        let x = 2.0 * rolls - 0.5 * mu * G * rolls * rolls + 10.0 / 7.0 * (1.0 - rolls);
        assert!((last(&solution, "ball.x") - x).abs() < 1e-9, "{}", last(&solution, "ball.x") - x);
        assert!((last(&solution, "ball.vx") - 10.0 / 7.0).abs() < 1e-10);
        let speed = |t: f64| (2.0 - mu * G * t).max(10.0 / 7.0);
        assert!(distance(&solution, "ball.vx", speed) < 1e-5);
        let lost = |t: f64| 0.5 * (4.0 - 3.5 * (2.0 - mu * G * t.min(rolls) - 10.0 / 7.0).powi(2) - 20.0 / 7.0);
        assert!(distance(&solution, "dissipated_by_friction", lost) < 4.0 * step * step);

        let block = json!({"name": "block", "shape": {"box": {"size": [1, 1, 0.1]}}, "mass": 2, "position": [0, 0, 0.05],
            "velocity": [1.6, 1.2, 0]});
        let solution = solve(&locate(on_the_ground(&[block], &json!({"friction": mu}), 1.0, step)));
        let found = times(&solution, EventKind::Stick);
        assert!(found.len() == 1 && (found[0] - 2.0 / (mu * G)).abs() < 1e-6, "{found:?}");
        let [x, v, _] = end(&solution, "block");
        assert!((x.xy().norm() - 4.0 / (2.0 * mu * G)).abs() < 1e-9 && v.norm() < 1e-10, "{x} {v}");
    }
}

/// A block is thrown up a slope that is too steep for it to stick: at its highest point the friction force reverses.
#[test]
fn a_block_on_a_steep_slope_turns_and_slides_back() {
    let (mu, angle) = (0.2, 30_f64.to_radians());
    let (down, press) = (G * angle.sin(), G * angle.cos());
    let block = json!({"name": "block", "shape": {"box": {"size": [1, 1, 0.1]}}, "mass": 2, "position": [0, 0, 0.05],
        "velocity": [-2, 0, 0]});
    let mut specification = locate(on_the_ground(&[block], &json!({"friction": mu}), 1.0, 0.013));
    specification["problem"]["rigid_bodies"]["gravity"] = json!([down, 0, -press]);
    let solution = solve(&specification);
    let top = 2.0 / (down + mu * press);
    let slide = down - mu * press;
    assert!((last(&solution, "block.vx") - slide * (1.0 - top)).abs() < 1e-5);
    let x = -top + 0.5 * slide * (1.0 - top).powi(2);
    assert!((last(&solution, "block.x") - x).abs() < 1e-5, "{}", last(&solution, "block.x") - x);
}

/// A ball without gravity in a box of half spaces: unfolding the reflections gives a straight line.
#[test]
fn billiards_unfold() {
    let wall = |k: usize, normal: [f64; 3], at: [f64; 3]| json!({"name": format!("wall{k}"), "shape": {"half_space": {"normal": normal}}, "position": at, "fixed": true});
    let mut bodies = vec![
        wall(0, [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]),
        wall(1, [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
        wall(2, [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]),
        wall(3, [0.0, -1.0, 0.0], [0.0, 1.0, 0.0]),
        wall(4, [0.0, 0.0, -1.0], [0.0, 0.0, 2.0]),
    ];
    bodies.push(ball([0.1, 0.2, 0.9], [3.0, 2.3, 1.7], [0.0; 3]));
    let solution = solve(&locate(weightless(on_the_ground(&bodies, &json!({"restitution": 1}), 30.0, 0.1))));
    let fold = |x: f64, v: f64, t: f64| {
        // Folds the straight line of the unfolded motion into one between the walls at -0.9 and 0.9.
        let y = (x + v * t + 0.9).rem_euclid(3.6);
        if y > 1.8 { 2.7 - y } else { y - 0.9 }
    };
    assert!(distance(&solution, "ball.x", |t| fold(0.1, 3.0, t)) < 1e-9);
    assert!(distance(&solution, "ball.y", |t| fold(0.2, 2.3, t)) < 1e-9);
    assert!(distance(&solution, "ball.z", |t| 1.0 + fold(-0.1, 1.7, t)) < 1e-9);
    let walls = |x: f64, v: f64| ((x + v * 30.0 + 0.9) / 1.8).floor() as usize;
    let all = walls(0.1, 3.0) + walls(0.2, 2.3) + walls(-0.1, 1.7);
    assert_eq!(times(&solution, EventKind::Impact).len(), all);
}

/// A body with the principal moments of inertia `j` that rotates freely and falls, integrated by the classical
/// Runge-Kutta method.
#[derive(Clone, Copy)]
struct Tumbling {
    x: Vector3<f64>,
    q: UnitQuaternion<f64>,
    v: Vector3<f64>,
    /// Angular velocity in the frame of the tumbling body.
    w: Vector3<f64>,
}

impl Tumbling {
    fn step(&self, j: &Vector3<f64>, h: f64) -> Self {
        let spin = |w: &Vector3<f64>| -w.cross(&j.component_mul(w)).component_div(j);
        let turn = |q: &Quaternion<f64>, w: &Vector3<f64>| q * Quaternion::from_imag(*w) * 0.5;
        let (q, w) = (self.q.into_inner(), self.w);
        let (k1, l1) = (turn(&q, &w), spin(&w));
        let (k2, l2) = (turn(&(q + k1 * (0.5 * h)), &(w + l1 * (0.5 * h))), spin(&(w + l1 * (0.5 * h))));
        let (k3, l3) = (turn(&(q + k2 * (0.5 * h)), &(w + l2 * (0.5 * h))), spin(&(w + l2 * (0.5 * h))));
        let (k4, l4) = (turn(&(q + k3 * h), &(w + l3 * h)), spin(&(w + l3 * h)));
        let g = Vector3::new(0.0, 0.0, -G);
        Self {
            x: self.x + self.v * h + g * (0.5 * h * h),
            q: UnitQuaternion::new_normalize(q + (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (h / 6.0)),
            v: self.v + g * h,
            w: w + (l1 + l2 * 2.0 + l3 * 2.0 + l4) * (h / 6.0),
        }
    }

    fn fly(&self, j: &Vector3<f64>, t: f64) -> Self {
        let steps = (t / 1e-4).ceil().max(1.0);
        (0..steps as usize).fold(*self, |state, _| state.step(j, t / steps))
    }

    /// Returns the height of the lowest corner of a box with the half sides `half`, and the vector to it from the
    /// centre.
    fn lowest(&self, half: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let corner = |k: usize| {
            let signs = Vector3::new(k & 1, k >> 1 & 1, k >> 2 & 1).map(|bit| 2.0 * bit as f64 - 1.0);
            self.q * half.component_mul(&signs)
        };
        let arm = (0..8).map(corner).min_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
        (self.x.z + arm.z, arm)
    }
}

/// A box with three moments of inertia falls on a corner, rebounds without friction, and falls on another corner. Its
/// final state is compared with that of a Runge-Kutta method with impact times found by bisection.
#[test]
fn a_tumbling_box_strikes_with_its_corners_at_second_order() {
    let (size, m, e) = (Vector3::new(0.3, 0.5, 0.8), 1.2, 0.7);
    let j = Vector3::new(size.y, size.x, size.x).component_mul(&Vector3::new(size.y, size.x, size.x))
        + Vector3::new(size.z, size.z, size.y).component_mul(&Vector3::new(size.z, size.z, size.y));
    let j = j * (m / 12.0);
    let (end_time, start) = (0.7, Vector3::new(2.0, 3.0, 1.5));
    let mut state = Tumbling {
        x: Vector3::new(0.0, 0.0, 1.2),
        q: UnitQuaternion::identity(),
        v: Vector3::new(0.5, 0.0, 0.0),
        w: start,
    };
    let (mut t, mut impacts) = (0.0, Vec::new());
    let half = size * 0.5;
    while t < end_time {
        let (mut next, step) = (state, 1e-3);
        let mut h = 0.0;
        while t + h < end_time && (next.lowest(&half).0 > 0.0 || h == 0.0) {
            (next, h) = (next.fly(&j, step), h + step);
        }
        if t + h >= end_time {
            state = state.fly(&j, end_time - t);
            break;
        }
        let (mut low, mut high) = (h - step, h);
        let before = state.fly(&j, low);
        let base = low;
        while high - low > 1e-14 {
            let mid = 0.5 * (low + high);
            if before.fly(&j, mid - base).lowest(&half).0 > 0.0 { low = mid } else { high = mid }
        }
        state = before.fly(&j, high - base);
        t += high;
        impacts.push(t);
        let (n, arm) = (Vector3::z(), state.lowest(&half).1);
        let (omega, rotation) = (state.q * state.w, state.q.to_rotation_matrix());
        let inverse: Matrix3<f64> =
            rotation.matrix() * Matrix3::from_diagonal(&j.map(|j| 1.0 / j)) * rotation.matrix().transpose();
        let lever = arm.cross(&n);
        let u = state.v.z + omega.dot(&lever);
        let p = -(1.0 + e) * u / (1.0 / m + lever.dot(&(inverse * lever)));
        state.v += n * (p / m);
        state.w = state.q.inverse() * (omega + inverse * lever * p);
    }
    assert!(impacts.len() >= 2, "{impacts:?}");
    let error = |step: f64| {
        let body = json!({"name": "box", "shape": {"box": {"size": [size.x, size.y, size.z]}}, "mass": m,
            "position": [0, 0, 1.2], "velocity": [0.5, 0, 0], "angular_velocity": [start.x, start.y, start.z]});
        let solution = solve(&locate(on_the_ground(&[body], &json!({"restitution": e}), end_time, step)));
        let found = times(&solution, EventKind::Impact);
        assert_eq!(found.len(), impacts.len(), "{found:?} {impacts:?}");
        let late = found.iter().zip(&impacts).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let [x, v, w] = end(&solution, "box");
        late.max((x - state.x).norm()).max((v - state.v).norm()).max((w - state.q * state.w).norm())
    };
    assert!(error(1e-3) < 1e-3, "{:e}", error(1e-3));
    assert_second_order(4e-3, error);
}

/// Orientation after five seconds of a freely rotating body with the moments of inertia 1, 2 and 3, as a quaternion.
/// Reference: a Runge-Kutta method of order 8 (DOP853) with a tolerance of 1e-13.
const TURNED: [f64; 4] = [0.10594656880115676, -0.1993666935059763, -0.2017218156016355, 0.9530669206252705];

fn turning(position: [f64; 3], velocity: [f64; 3]) -> Value {
    json!({"name": "b", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": position, "velocity": velocity,
        "inertia": [1, 2, 3], "angular_velocity": [0.3, 2, 0.1]})
}

fn error_of_turning(solution: &Solution) -> f64 {
    let names = ["b.qw", "b.qx", "b.qy", "b.qz"];
    names.iter().zip(TURNED).map(|(name, exact)| (last(solution, name) - exact).abs()).fold(0.0, f64::max)
}

#[test]
fn a_body_with_three_moments_of_inertia_turns_at_second_order() {
    assert_second_order(0.02, |step| {
        let body = turning([0.0, 0.0, 500.0], [0.0; 3]);
        error_of_turning(&solve(&locate(on_the_ground(&[body], &json!({}), 5.0, step))))
    });
}

/// A freely rotating body flies between two smooth walls, with an impact every 0.19 s. Longer steps are cut at the
/// impacts, so that runs with half the step size have the same smooth arcs between impacts and the same errors, and
/// their difference says nothing about the error.
#[test]
fn arcs_that_longer_steps_do_not_make_longer_show_no_error() {
    let wall = json!({"name": "wall", "shape": {"half_space": {"normal": [0, 0, -1]}}, "position": [0, 0, 2.1], "fixed": true});
    let solved = |step: f64| {
        let body = turning([0.0, 0.0, 1.05], [0.0, 0.0, 10.0]);
        solve(&locate(weightless(on_the_ground(&[wall.clone(), body], &json!({"restitution": 1}), 5.0, step))))
    };
    for step in [5.0, 1.0, 0.5] {
        let solution = solved(step);
        assert!(!solution.verdict.trusted && told(&solution).is_infinite(), "{step}: {:?}", solution.verdict);
    }
    let fine = solved(5e-3);
    assert!(fine.verdict.trusted && error_of_turning(&fine) < told(&fine), "{:?}", fine.verdict);
}

/// Integrates the angle `a` of the equation `a'' = bend(a)` by the classical Runge-Kutta method while `goes_on(t, a,
/// a')` is true; returns the time, `a` and `a'` at the end.
fn swing([mut a, mut rate]: [f64; 2], bend: impl Fn(f64) -> f64, goes_on: impl Fn(f64, f64, f64) -> bool) -> [f64; 3] {
    let (h, mut k) = (1e-4, 0);
    while goes_on(f64::from(k) * h, a, rate) {
        let (k1, l1) = (rate, bend(a));
        let (k2, l2) = (rate + 0.5 * h * l1, bend(a + 0.5 * h * k1));
        let (k3, l3) = (rate + 0.5 * h * l2, bend(a + 0.5 * h * k2));
        let (k4, l4) = (rate + h * l3, bend(a + h * k3));
        a += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        rate += h / 6.0 * (l1 + 2.0 * l2 + 2.0 * l3 + l4);
        k += 1;
    }
    [f64::from(k) * h, a, rate]
}

/// A symmetric top whose tip slides on a smooth floor, so that its centre moves only vertically; its tilt, the rate
/// of the tilt and the precession angle are integrated by the classical Runge-Kutta method. `l` is the distance from
/// tip to centre, `a` and `c` are the moments of inertia across and along the axis, `m` is the mass, `w` the spin
/// about the axis, and `tilt` the initial tilt.
struct SlidingTop {
    l: f64,
    a: f64,
    c: f64,
    m: f64,
    w: f64,
    tilt: f64,
}

impl SlidingTop {
    fn precession(&self, tilt: f64) -> f64 {
        self.c * self.w * (self.tilt.cos() - tilt.cos()) / (self.a * tilt.sin().powi(2))
    }

    fn rates(&self, [tilt, rate, _]: [f64; 3]) -> [f64; 3] {
        let (sin, cos, turn) = (tilt.sin(), tilt.cos(), self.precession(tilt));
        let Self { l, a, c, m, w, .. } = self;
        let torque = a * turn * turn * sin * cos - c * w * turn * sin + m * G * l * sin;
        [rate, (torque - m * l * l * sin * cos * rate * rate) / (a + m * l * l * sin * sin), turn]
    }

    fn at(&self, t: f64) -> [f64; 3] {
        let (steps, mut y) = (20_000, [self.tilt, 0.0, 0.0]);
        let h = t / f64::from(steps);
        let go = |y: [f64; 3], k: [f64; 3], h: f64| [0, 1, 2].map(|i| y[i] + h * k[i]);
        for _ in 0..steps {
            let k1 = self.rates(y);
            let k2 = self.rates(go(y, k1, 0.5 * h));
            let k3 = self.rates(go(y, k2, 0.5 * h));
            let k4 = self.rates(go(y, k3, h));
            y = [0, 1, 2].map(|i| y[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        }
        y
    }
}

/// Returns the estimated error of a run on which its verdict is based.
fn told(solution: &Solution) -> f64 {
    solution.diagnostics.checks.get(CheckCode::LocalError).expect("an estimate of the error").0
}

/// With located impacts a ball moves exactly and is trusted, at steps that are too long for time stepping.
#[test]
fn impacts_that_are_located_are_not_misplaced() {
    let body = ball([0.0, 0.0, 1.1], [0.3, 0.0, 0.0], [0.0; 3]);
    let mut specification = on_the_ground(&[body], &json!({"restitution": 0.8}), 1.5, 0.05);
    specification["output"]["fields"] = json!(["ball.z", "ball.vz", "kinetic_energy"]);
    let passed = solve(&stepped(specification.clone()));
    assert!(told(&passed) > 1e-2 && !passed.verdict.trusted);
    let message = passed.verdict.because.iter().find(|reason| reason.code == CheckCode::LocalError);
    assert!(message.is_some_and(|reason| reason.message.contains("set `impacts` to `locate`")), "{message:?}");
    let located = solve(&locate(specification));
    assert!(told(&located) < 1e-9 && located.verdict.trusted, "{:?}", located.verdict);
}

/// A top, an octahedron that spins on one of its corners, nutates and precesses.
#[test]
fn a_top_on_a_smooth_floor_nods_at_second_order() {
    let top = SlidingTop { l: 0.1, a: 1e-3, c: 5e-4, m: 0.5, w: 150.0, tilt: 0.4 };
    let end_time = 0.5;
    let [tilt, rate, turned] = top.at(end_time);
    let (node, axis) = (
        Vector3::new(-turned.sin(), turned.cos(), 0.0),
        Vector3::new(tilt.sin() * turned.cos(), tilt.sin() * turned.sin(), tilt.cos()),
    );
    let turn = top.precession(tilt);
    let omega = Vector3::z() * turn + node * rate + axis * (top.w - turn * tilt.cos());
    let (sin, cos) = (0.5 * top.tilt).sin_cos();
    let spin = [top.w * top.tilt.sin(), 0.0, top.w * top.tilt.cos()];
    let l = top.l;
    let points = [[l, 0.0, 0.0], [-l, 0.0, 0.0], [0.0, l, 0.0], [0.0, -l, 0.0], [0.0, 0.0, l], [0.0, 0.0, -l]];
    let solved = |step: f64| {
        let body = json!({"name": "top", "shape": {"convex_hull": {"points": points}}, "mass": top.m,
            "inertia": [top.a, top.a, top.c], "position": [0, 0, l * top.tilt.cos()],
            "orientation": [cos, 0.0, sin, 0.0], "angular_velocity": spin});
        solve(&locate(on_the_ground(&[body], &json!({}), end_time, step)))
    };
    let errors = |solution: &Solution| {
        let [x, v, w] = end(solution, "top");
        let q = ["qw", "qx", "qy", "qz"].map(|key| last(solution, &format!("top.{key}")));
        let q = UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3]));
        let height = (x - Vector3::z() * (l * tilt.cos())).norm() / l;
        let speed = (v.z + l * tilt.sin() * rate).abs() / l;
        [height, (q * Vector3::z() - axis).norm(), speed / top.w, (w - omega).norm() / top.w]
    };
    let error = |step: f64| errors(&solved(step)).into_iter().fold(0.0, f64::max);
    assert!(error(2.5e-4) < 1e-3, "{:e}", error(2.5e-4));
    assert_second_order(1e-3, error);
    // The error that the program estimates for the motion of the spinning top is above the true error, and decreases
    // with second order, as the true error does.
    let [coarse, fine] = [1e-3, 2.5e-4].map(|step| {
        let solution = solved(step);
        let fastest = column(&solution, "top.vz").iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let (told, known) = (told(&solution), errors(&solution)[2] * l * top.w / fastest);
        assert!(told > known, "{step}: {told:e} {known:e}");
        told
    });
    assert!((coarse / fine).log2() >= 2.0 * SECOND, "{coarse:e} {fine:e}");
}

/// A ball of radius 0.1 on a fixed one of radius 1, at the angle `a` from its top, with the angular velocity `rate`
/// about its centre.
fn on_a_hill([a, rate]: [f64; 2], friction: f64, end: f64, step: f64) -> Value {
    let hill = json!({"name": "hill", "shape": {"sphere": {"radius": 1}}, "fixed": true, "position": [0, 0, 2]});
    let speed = 1.1 * rate;
    let spin = if friction > 0.0 { speed / 0.1 } else { 0.0 };
    let body =
        ball([1.1 * a.sin(), 0.0, 2.0 + 1.1 * a.cos()], [speed * a.cos(), 0.0, -speed * a.sin()], [0.0, spin, 0.0]);
    locate(on_the_ground(&[hill, body], &json!({ "friction": friction }), end, step))
}

#[test]
fn a_ball_rolls_on_a_ball_at_second_order() {
    let start = [0.3, 0.4];
    let [t, a, rate] = swing(start, |a| 5.0 / 7.0 * G * a.sin() / 1.1, |t, _, _| t < 0.4999);
    let (x, v) = (Vector3::new(1.1 * a.sin(), 0.0, 2.0 + 1.1 * a.cos()), Vector3::new(a.cos(), 0.0, -a.sin()));
    assert_second_order(0.02, |step| {
        let solution = solve(&on_a_hill(start, 5.0, t, step));
        assert!(solution.trajectory.events.is_empty(), "{:?}", solution.trajectory.events);
        let [position, velocity, omega] = end(&solution, "ball");
        let error = (position - x).norm().max((velocity - v * (1.1 * rate)).norm());
        error.max((omega.y - 11.0 * rate).abs())
    });
}

/// A ball that slides without friction on a fixed ball detaches where `v^2 = g (R + r) cos a`.
#[test]
fn a_ball_slides_off_a_ball_at_second_order() {
    let start = [0.3, 0.4];
    let [t, a, rate] = swing(start, |a| G * a.sin() / 1.1, |_, a, rate| rate * rate * 1.1 < G * a.cos());
    let d = 0.2;
    let x = Vector3::new(1.1 * a.sin(), 0.0, 2.0 + 1.1 * a.cos())
        + Vector3::new(a.cos(), 0.0, -a.sin()) * (1.1 * rate * d)
        - Vector3::z() * (0.5 * G * d * d);
    let error = |step: f64| {
        let solution = solve(&on_a_hill(start, 0.0, t + d, step));
        let found = times(&solution, EventKind::LiftOff);
        assert!(found.len() == 1 && (found[0] - t).abs() < step, "{found:?} {t}");
        (end(&solution, "ball")[0] - x).norm()
    };
    // The contact force of the sliding ball goes to zero continuously; the time of the detachment within a step changes
    // the error, but not its order.
    for step in [0.02, 0.01, 0.005, 0.0025] {
        assert!(error(step) < 1.5 * step * step, "{step}: {:e}", error(step));
    }
}

/// A ball rolls at 2 m/s over the edge of a table, too fast to rotate about the edge: it detaches from it at once.
#[test]
fn a_ball_leaves_the_edge_of_a_table() {
    let table =
        json!({"name": "table", "shape": {"box": {"size": [4, 1, 0.2]}}, "fixed": true, "position": [0, 0, 1.9]});
    let body = ball([0.0, 0.0, 2.1], [2.0, 0.0, 0.0], [0.0, 20.0, 0.0]);
    for step in [0.03, 0.01] {
        let solution =
            solve(&locate(on_the_ground(&[table.clone(), body.clone()], &json!({"friction": 0.3}), 1.8, step)));
        let left = times(&solution, EventKind::LiftOff);
        assert!((left[0] - 1.0).abs() < 1e-6, "{left:?}");
        let landed = times(&solution, EventKind::Impact);
        assert!((landed[0] - 1.0 - (4.0 / G).sqrt()).abs() < 1e-5, "{landed:?}");
        let z = |t: f64| if t < 1.0 { 2.1 } else { 2.1 - 0.5 * G * (t - 1.0) * (t - 1.0) };
        for (k, &t) in solution.trajectory.t.iter().enumerate().filter(|(_, t)| **t < 1.6) {
            assert!((column(&solution, "ball.z")[k] - z(t)).abs() < 1e-5, "{t}");
        }
    }
}

#[test]
fn what_is_symmetric_stays_so() {
    let cube = json!({"name": "cube", "shape": {"box": {"size": [1, 1, 1]}}, "mass": 1, "position": [0, 0, 1.5]});
    let contacts = json!({"restitution": 0.5, "friction": 0.4});
    let solution = solve(&locate(on_the_ground(&[cube], &contacts, 2.0, 0.01)));
    for k in 0..=100 {
        let of = |key: &str| column(&solution, &format!("cube.{key}"))[k];
        let (z, vz, impacts) = bounces(1.0, 0.5, solution.trajectory.t[k]);
        assert!(["x", "y", "qx", "qy", "qz", "wx", "wy", "wz"].iter().all(|key| of(key).abs() < 1e-9));
        if impacts < 6 {
            assert!((of("z") - 0.5 - z).abs() < 1e-9 && (of("vz") - vz).abs() < 1e-9);
        }
    }
    // Two balls fall symmetrically on a third one at rest between them.
    let ball = |name: &str, x: f64, z: f64| json!({"name": name, "shape": {"sphere": {"radius": 0.5}}, "mass": 1, "position": [x, 0, z]});
    let bodies = [ball("middle", 0.0, 0.5), ball("left", -0.6, 2.0), ball("right", 0.6, 2.0)];
    let solution = solve(&locate(on_the_ground(&bodies, &json!({"restitution": 0.3}), 1.0, 0.01)));
    for k in 0..=100 {
        let of = |key: &str| column(&solution, key)[k];
        assert!((of("left.x") + of("right.x")).abs() < 1e-9 && (of("left.z") - of("right.z")).abs() < 1e-9);
        assert!(of("middle.x").abs() < 1e-9 && (of("middle.z") - 0.5).abs() < 1e-9);
    }
}

/// Without the option `impacts`, a ball is exact at steps that are too long for time stepping, and the diagnostics
/// report that time stepping was left out.
#[test]
fn impacts_of_few_bodies_are_located_by_default() {
    let drop = on_the_ground(&[ball([0.0, 0.0, 1.1], [0.0; 3], [0.0; 3])], &json!({"restitution": 0.8}), 1.5, 0.05);
    let solution = solve(&drop);
    let exact = |t: f64| bounces(1.0, 0.8, t).0 + 0.1;
    assert!(solution.verdict.trusted && distance(&solution, "ball.z", exact) < 1e-12, "{:?}", solution.verdict);
    assert!(solution.diagnostics.built.contains(&"location of impacts"));
    assert!(solution.diagnostics.left_out.iter().any(|part| part.starts_with("time stepping: ")));
    let many: Vec<Value> = (0..101)
        .map(|k| {
            let mut ball = ball([f64::from(k), 0.0, 0.2], [0.0; 3], [0.0; 3]);
            ball["name"] = json!(format!("b{k}"));
            ball
        })
        .collect();
    let many = solve(&on_the_ground(&many, &json!({}), 0.01, 1e-3));
    let reason = many.diagnostics.left_out.iter().find(|part| part.starts_with("location of impacts: "));
    assert!(reason.is_some_and(|reason| reason.contains("more than 100 bodies")), "{reason:?}");
}

/// A heap that collapses has too many impacts to locate. By default the solver changes to time stepping, reports it,
/// and gains no energy at the change. The bound on the energy would be exceeded twentyfold if contacts gave an excess
/// impulse of half a step's weight at the velocity of a fall.
#[test]
fn a_heap_changes_over_to_time_stepping() {
    let place = |k: u32| [k % 3, k / 3 % 3, k / 9].map(f64::from);
    let balls: Vec<Value> = (0..27)
        .map(|k| {
            let [x, y, z] = place(k);
            let lean = 0.01 * f64::from(k * 7 % 11) / 11.0;
            let mut ball = ball([0.19 * x + lean, 0.19 * y - lean, 0.3 + 0.25 * z], [0.0; 3], [0.0; 3]);
            ball["name"] = json!(format!("b{k}"));
            ball["shape"]["sphere"]["radius"] = json!(0.09);
            ball
        })
        .collect();
    let solution = solve(&on_the_ground(&balls, &json!({"friction": 0.3, "restitution": 0.6}), 0.6, 1e-3));
    let passed = solution.diagnostics.warnings.iter().find(|warning| warning.code == "impacts_passed");
    assert!(passed.is_some(), "{:?}", solution.diagnostics.warnings);
    let [kinetic, potential] = ["kinetic_energy", "potential_energy"].map(|of| column(&solution, of));
    let total: Vec<f64> = kinetic.iter().zip(potential).map(|(kinetic, potential)| kinetic + potential).collect();
    let lost: f64 = total[0] - total[total.len() - 1];
    assert!(total.windows(2).all(|pair| pair[1] <= pair[0] + 1e-4 * total[0]) && lost > 0.0, "{total:?}");
    let taken = ["dissipated_by_friction", "lost_in_impacts"].map(|of| last(&solution, of)).iter().sum::<f64>();
    assert!((taken - lost).abs() < 1e-2 * lost, "{taken} {lost}");
}

/// Balls dropped from small heights bounce many times within a step: a trusted answer has the height of the closed
/// form.
#[test]
fn bounces_that_are_left_out_are_over_within_the_step() {
    let mut trusted = 0;
    for (height, e, step) in [
        (0.01, 0.995, 0.1),
        (0.02, 0.99, 0.1),
        (2e-4, 0.99, 0.03),
        (3e-7, 0.99, 1e-3),
        (0.05, 0.8, 0.1),
        (2e-3, 0.9, 0.03),
    ] {
        let end = 5.0 * (2.0 * height / G).sqrt();
        let mut drop =
            on_the_ground(&[ball([0.0, 0.0, 0.1 + height], [0.0; 3], [0.0; 3])], &json!({"restitution": e}), end, step);
        drop["output"]["fields"] = json!(["ball.z"]);
        let solution = solve(&drop);
        let error = distance(&solution, "ball.z", |t| bounces(height, e, t).0 + 0.1) / height;
        assert!(!solution.verdict.trusted || error < 1e-2, "{height}, {e}, {step}: {error:e}");
        trusted += u32::from(solution.verdict.trusted);
    }
    assert!(trusted >= 4, "{trusted}");
}

/// Two balls in free fall meet at a small relative velocity, and separate with `e` times that velocity.
#[test]
fn balls_that_meet_in_flight_part_again_however_slowly() {
    let (mut lower, mut upper) =
        (ball([0.0; 3], [0.0; 3], [0.0; 3]), ball([0.0, 0.0, 0.201], [0.0, 0.0, -0.01], [0.0; 3]));
    (lower["name"], upper["name"]) = (json!("lower"), json!("upper"));
    for step in [0.1, 0.01] {
        let mut fall = on_the_ground(&[lower.clone(), upper.clone()], &json!({"restitution": 0.5}), 1.0, step);
        fall["problem"]["rigid_bodies"]["bodies"][0]["position"] = json!([0, 0, -100]);
        let solution = solve(&fall);
        // The balls meet after 0.1 s; relative to free fall they then have the velocities -0.0075 and -0.0025.
        let exact = |t: f64| -0.5 * G * t * t - 0.0075 * (t - 0.1_f64).max(0.0);
        assert!(
            solution.verdict.trusted && distance(&solution, "lower.z", exact) < 1e-9,
            "{step}: {:?}",
            solution.verdict
        );
    }
}
