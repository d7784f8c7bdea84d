//! Friction on a contact patch: sliding and drilling of a disc with uniform pressure, and rolling friction, compared
//! with closed forms and an independent integration.

mod hostile;

use super::on_the_ground;
use crate::systems::harness::{column, distance, last, solve};
use crate::systems::reference::example;
use dvi::solution::Solution;
use serde_json::{Value, json};
use std::f64::consts::PI;

const G: f64 = 9.81;
const MU: f64 = 0.3;
const R: f64 = 0.1;

/// A disc of unit mass and radius `R`, which touches the ground below its centre of mass, on a contact patch of its own
/// radius.
fn disc(velocity: [f64; 2], spin: f64) -> Value {
    let axial = 0.5 * R * R;
    json!({"name": "disc", "shape": {"sphere": {"radius": 0.02}}, "mass": 1, "centre_of_mass": [0, 0, -0.02],
        "inertia": [0.5 * axial, 0.5 * axial, axial], "position": [0, 0, 0.02],
        "velocity": [velocity[0], velocity[1], 0], "angular_velocity": [0, 0, spin]})
}

fn on_a_patch(velocity: [f64; 2], spin: f64, end: f64, step: f64) -> Value {
    on_the_ground(&[disc(velocity, spin)], &json!({"friction": MU, "patch": R}), end, step)
}

/// Asserts that every step solved the contact law to its tolerance, and that friction dissipated the energy `lost`.
fn assert_sound(solution: &Solution, lost: f64) {
    let residual = solution.diagnostics.vi.as_ref().unwrap().largest_residual;
    assert!(residual <= 1e-10, "{residual:e}");
    let booked = last(solution, "dissipated_by_friction");
    assert!((booked - lost).abs() < 1e-9 * lost.max(1.0), "{booked} for {lost}");
}

#[test]
fn pure_spin_has_two_thirds_of_the_torque_and_pure_sliding_the_whole_force() {
    // For any step size, pure drilling of the disc has w' = -2/3 mu m g R/I = -4/3 mu g/R, and pure sliding v' = -mu g.
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

/// Returns the friction force and torque on a disc of unit radius with the velocity `v` and the spin `w`, for unit
/// normal force and friction coefficient, by sums over its surface in place of elliptic integrals.
fn of_surface(v: f64, w: f64) -> [f64; 2] {
    let (rings, parts) = (120, 60);
    let mut sums = [0.0; 2];
    for j in 0..parts {
        // The sums cover half of the disc, since the other half is its mirror image.
        let (sine, cosine) = (PI * (f64::from(j) + 0.5) / f64::from(parts) - 0.5 * PI).sin_cos();
        for i in 0..rings {
            let r = (f64::from(i) + 0.5) / f64::from(rings);
            let (x, y) = (v - w * r * sine, w * r * cosine);
            let weight = 2.0 * r / (f64::from(rings * parts) * (x * x + y * y).sqrt());
            sums[0] += weight * x;
            sums[1] += weight * r * (y * cosine - x * sine);
        }
    }
    sums
}

/// Integrates a disc with the velocity `v` and the spin velocity `R w` up to the time `t` by the classical
/// Runge-Kutta method.
fn of_runge_kutta([mut v, mut w]: [f64; 2], t: f64, steps: u32) -> [f64; 2] {
    let h = t / f64::from(steps);
    let rates = |v: f64, w: f64| {
        let [force, torque] = of_surface(v, w);
        [-MU * G * force, -2.0 * MU * G * torque]
    };
    for _ in 0..steps {
        let k1 = rates(v, w);
        let k2 = rates(v + 0.5 * h * k1[0], w + 0.5 * h * k1[1]);
        let k3 = rates(v + 0.5 * h * k2[0], w + 0.5 * h * k2[1]);
        let k4 = rates(v + h * k3[0], w + h * k3[1]);
        let mean = |i: usize| h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        (v, w) = (v + mean(0), w + mean(1));
    }
    [v, w]
}

/// Solves the disc by time stepping with steps of size `h`, and returns its velocity `v` and spin velocity `R w` at the
/// time `t`.
fn at_the_end_of(v: f64, spin: f64, t: f64, h: f64) -> [f64; 2] {
    let solution = solve(&on_a_patch([0.6 * v, 0.8 * v], spin, t, h));
    assert!(solution.diagnostics.vi.as_ref().unwrap().largest_residual <= 1e-10);
    let (x, y) = (last(&solution, "disc.vx"), last(&solution, "disc.vy"));
    assert!((0.8 * x - 0.6 * y).abs() < 1e-12, "the disc leaves its line");
    [x.hypot(y), R * last(&solution, "disc.wz")]
}

#[test]
fn a_disc_that_slides_and_spins_follows_an_integration_over_its_surface() {
    for (v, spin) in [(1.0, 8.0), (0.3, 10.0), (1.0, 3.0)] {
        let time = 0.9 * stop(v, R * spin);
        let exact = of_runge_kutta([v, R * spin], time, 100);
        let found = [16, 32, 64].map(|parts| at_the_end_of(v, spin, time, time / f64::from(parts)));
        let off = |found: [f64; 2]| [0, 1].map(|i| found[i] - exact[i]);
        let errors = found.map(|found| off(found).map(f64::abs)).map(|[v, w]| v.max(w));
        // Time stepping is of first order, and Richardson extrapolation from two step sizes is of second order.
        assert!(errors[2] < 0.6 * errors[1] && errors[1] < 0.7 * errors[0] && errors[2] < 5e-3, "{errors:?}");
        let beyond = |a: usize| off([0, 1].map(|i| 2.0 * found[a + 1][i] - found[a][i])).map(f64::abs);
        let [coarse, fine] = [0, 1].map(|a| beyond(a)[0].max(beyond(a)[1]));
        println!("{v} {spin}: {errors:?} {coarse:e} {fine:e} {exact:?}");
        // Friction laws in which force and torque are not coupled would have an error of 0.1 m/s in the disc's
        // velocity.
        assert!(fine < 3e-4, "{v} {spin}: {coarse:e}, {fine:e}");
    }
}

/// Returns the time at which the disc with the velocity `v` and the spin velocity `w` stops, by Runge-Kutta steps
/// proportional to the remaining velocities.
fn stop(v: f64, w: f64) -> f64 {
    let (mut t, mut at) = (0.0, [v, w]);
    while at[0] + at[1] > 1e-6 * (v + w) {
        let h = 0.1 * (at[0] + at[1]) / (MU * G);
        (t, at) = (t + h, of_runge_kutta(at, h, 1));
    }
    t
}

/// Returns the velocity and the spin velocity of the disc when its sliding velocity has fallen to `least`, by
/// Runge-Kutta steps proportional to the remaining velocities.
fn until(least: f64, mut at: [f64; 2]) -> [f64; 2] {
    loop {
        let h = 0.05 * (at[0] + at[1]) / (MU * G);
        let next = of_runge_kutta(at, h, 1);
        if next[0] < least {
            let (mut lower, mut upper) = (0.0, h);
            for _ in 0..40 {
                let middle = 0.5 * (lower + upper);
                *if of_runge_kutta(at, middle, 1)[0] < least { &mut upper } else { &mut lower } = middle;
            }
            return of_runge_kutta(at, lower, 1);
        }
        at = next;
    }
}

/// Sliding and spinning of a disc end together, and the ratio `v/(R w)` tends to 0.653 (Farkas, Bartels, Unger and
/// Wolf 2003). The limit is approached slowly, about as the square root of the speed: from 0.35 the ratio has come to
/// 0.60 when 2 % of the speed are left.
#[test]
fn a_disc_stops_to_slide_and_to_spin_together_at_the_ratio_of_farkas() {
    const RATIO: f64 = 0.653;
    for ratio in [RATIO, 0.1, 0.35, 1.1, 3.0] {
        let (v, w) = (1.0, 1.0 / ratio);
        let (end, h) = (stop(v, w), 1e-4);
        let mut scene = on_a_patch([v, 0.0], w / R, 1.1 * end, h);
        scene["output"]["times"] = json!("steps");
        let solution = solve(&scene);
        assert_sound(&solution, 0.5 * v * v + 0.25 * w * w);
        let (vx, wz) = (column(&solution, "disc.vx"), column(&solution, "disc.wz"));
        // Velocities that remain when the disc is at rest are within the tolerance of the contact law.
        let moving = vx.iter().filter(|vx| **vx > 1e-9 * v).count();
        let spinning = wz.iter().filter(|wz| **wz > 1e-9 * w / R).count();
        assert_eq!(moving, spinning, "sliding and spinning end in different steps");
        assert!((solution.trajectory.t[moving] - end).abs() < 2.0 * h, "{} {end}", solution.trajectory.t[moving]);
        // The ratio of the disc's sliding and spin velocities differs from that of the independent integration by at
        // most the relative velocity change in a step.
        let mut exact = [v, w];
        for left in [0.3, 0.1, 0.02, 0.005] {
            let place = vx.iter().position(|speed| *speed < left * v).unwrap();
            exact = until(vx[place], exact);
            let apart = vx[place] / (R * wz[place]) - exact[0] / exact[1];
            println!("{ratio} {left}: {apart:e} {}", exact[0] / exact[1]);
            assert!(apart.abs() < MU * G * h / vx[place], "{ratio} {left}: {apart:e}");
        }
        let at_the_end = until(1e-9, exact);
        assert!((at_the_end[0] / at_the_end[1] - RATIO).abs() < 5e-4, "{ratio}: {at_the_end:?}");
        let apart: Vec<f64> = (0..moving - 1).map(|k| vx[k] / (R * wz[k]) - RATIO).collect();
        if ratio == RATIO {
            // The self-similar motion of the disc has a constant ratio of sliding to spin velocity, at all speeds down
            // to rest.
            assert!(apart.iter().all(|apart| apart.abs() < 2e-4), "{apart:?}");
        } else {
            assert!(apart.windows(2).all(|pair| pair[1].abs() < pair[0].abs() + 1e-9 && pair[1] * pair[0] > 0.0));
        }
    }
}

#[test]
fn the_disc_of_the_example_follows_the_integration_to_its_stop() {
    let (start, h) = ([1.0, 2.5], 5e-4);
    let solution = solve(&example("spinning_disc"));
    assert_sound(&solution, 0.5 + 0.25 * 2.5 * 2.5);
    let (t, vx, wz) = (&solution.trajectory.t, column(&solution, "disc.vx"), column(&solution, "disc.wz"));
    let end = stop(start[0], start[1]);
    for k in [20, 40, 60, 80] {
        let exact = if t[k] < end { of_runge_kutta(start, t[k], 50) } else { [0.0; 2] };
        // The velocities of the disc in the two computations differ by at most what friction changes in two steps.
        let off = (vx[k] - exact[0]).abs().max((R * wz[k] - exact[1]).abs());
        assert!(off < 2.0 * MU * G * h, "{}: {off:e} {exact:?}", t[k]);
    }
    assert!(t[160] > end && vx[160].abs() < 1e-9 && wz[160].abs() < 1e-8);
}

#[test]
fn a_ball_rolls_to_the_place_of_its_closed_form() {
    // The angular momentum of the rolling ball about the point of contact gives 7/5 m v' = -c m g/r: it stops after 7 r
    // v^2/(10 c g).
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
        // A run with long steps is not trusted: they rotate the ball by a tenth of a radian each.
        assert_eq!(solution.verdict.trusted, step < 2e-3, "{:?}", solution.verdict);
        assert_sound(&solution, 0.7 * 2.0 * v * v);
    }
    // On a slope of gradient s the ball stays at rest if s r < c, and rolls with the acceleration 5/7 g (s - c/r)
    // otherwise.
    for (slope, acceleration) in [(0.019, 0.0), (0.05, 5.0 / 7.0 * G * (0.05 - c / r))] {
        let mut rest = ball.clone();
        (rest["velocity"], rest["angular_velocity"]) = (json!([0, 0, 0]), json!([0, 0, 0]));
        let mut scene = on_the_ground(&[rest], &json!({"friction": 0.5, "rolling": c}), 1.0, 1e-3);
        scene["problem"]["rigid_bodies"]["gravity"] = json!([G * slope, 0, -G]);
        let found = last(&solve(&scene), "ball.vx");
        assert!((found - acceleration).abs() < 1e-9, "{slope}: {found}");
    }
}

/// A carriage on a vertical slider and a ball hinged to it, which transmits the weight of both to a body with
/// prescribed motion, `below`.
fn carried(below: &Value, axis: [f64; 3], contacts: &Value) -> Value {
    let carriage =
        json!({"name": "carriage", "shape": {"sphere": {"radius": 0.1}}, "mass": 2, "position": [0, 0, 0.5]});
    let ball = json!({"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 0.1]});
    let joints = json!([{"slider": {"bodies": ["carriage"], "at": [0, 0, 0.5], "axis": [0, 0, 1]}},
        {"hinge": {"bodies": ["carriage", "ball"], "at": [0, 0, 0.1], "axis": axis}}]);
    json!({"problem": {"rigid_bodies": {"gravity": [0, 0, -G], "bodies": [below, carriage, ball], "joints": joints,
        "contacts": contacts}}, "time": {"end": 1}, "method": {"step": 1e-3}, "output": {"times": {"count": 101}}})
}

#[test]
fn a_turning_table_turns_a_ball_by_drilling_alone_and_on_a_hinge() {
    let table = json!({"name": "table", "shape": {"cylinder": {"radius": 1, "length": 0.1}}, "position": [0, 0, -0.05],
        "motion": {"angular_velocity": [0, 0, 3]}});
    let contacts = json!({"friction": 0.1, "patch": 0.02});
    // The drilling torque 2/3 mu N R of the table's friction drives the ball until it rotates with the table.
    let rate = |mass: f64| 2.0 / 3.0 * 0.1 * mass * G * 0.02 / (0.4 * 0.01);
    let ball = json!({"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 0.1]});
    let mut alone = carried(&table, [0.0, 0.0, 1.0], &contacts);
    alone["problem"]["rigid_bodies"]["bodies"] = json!([table, ball]);
    alone["problem"]["rigid_bodies"]["joints"] = json!([]);
    for (scene, mass) in [(alone, 1.0), (carried(&table, [0.0, 0.0, 1.0], &contacts), 3.0)] {
        let solution = solve(&scene);
        let rate = rate(mass);
        let error = distance(&solution, "ball.wz", |t| (rate * t).min(3.0));
        assert!(error < 1e-8, "{mass}: {error:e}");
        assert!((last(&solution, "ball.wz") - 3.0).abs() < 1e-8);
        assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    }
}

#[test]
fn a_running_belt_turns_a_roller_against_rolling_friction() {
    // The roller accelerates with I w' = (mu r - c) N until its surface moves with the belt; from then on friction
    // only balances the rolling torque.
    let belt = json!({"name": "belt", "shape": {"box": {"size": [10, 1, 0.1]}}, "position": [0, 0, -0.05],
        "motion": {"velocity": [0.5, 0, 0]}});
    let (mu, c) = (0.02, 1e-3);
    let solution = solve(&carried(&belt, [0.0, 1.0, 0.0], &json!({"friction": mu, "rolling": c})));
    let rate = (mu * 0.1 - c) * 3.0 * G / (0.4 * 0.01);
    let error = distance(&solution, "ball.wy", |t| -(rate * t).min(5.0));
    assert!(error < 1e-8, "{error:e}");
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    // Slip and rolling friction dissipate the work of the belt, except for the kinetic energy of the roller.
    let work = mu * 3.0 * G * 0.5 * (5.0 / rate) + c / 0.1 * 3.0 * G * 0.5 * (1.0 - 5.0 / rate);
    let lost = work - 0.5 * 0.4 * 0.01 * 25.0;
    assert!((last(&solution, "dissipated_by_friction") - lost).abs() < 1e-3 * lost);
}
