//! Joints, springs and bushings on bodies with prescribed motion, and bushings between bodies: each compared with a
//! closed form or an independent integration, with all work in the energy balance.

use crate::systems::harness::{column, distance, last, solve};
use dvi::solution::Solution;
use serde_json::{Value, json};
use std::f64::consts::PI;

const G: f64 = 9.81;

fn scene(members: &Value, end: f64, step: f64) -> Value {
    json!({"problem": {"rigid_bodies": members}, "time": {"end": end}, "method": {"step": step},
        "output": {"times": {"count": 101}}})
}

/// Returns the largest defect of the energy balance of a run, relative to all energy and work.
fn lacking(solution: &Solution) -> f64 {
    let energy = solution.diagnostics.energy.unwrap();
    energy.largest_defect / energy.size()
}

fn assert_sound(solution: &Solution) {
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    assert!(lacking(solution) < 1e-5, "{:e}", lacking(solution));
}

/// A body with prescribed motion that supports others by joints, and touches no other body.
fn support(motion: Value) -> Value {
    json!({"name": "support", "shape": {"sphere": {"radius": 0.01}}, "motion": motion})
}

/// A pendulum of 1 kg whose centre is 0.5 m below its pivot, with a moment of inertia of 0.1 kg m^2 about the y axis,
/// released at 1 rad.
fn pendulum_on(motion: Value, joint: &str, step: f64, end: f64) -> Value {
    let (x, z) = (0.5 * 1.0_f64.sin(), -0.5 * 1.0_f64.cos());
    let body = json!({"name": "bob", "shape": {"sphere": {"radius": 0.01}}, "mass": 1, "inertia": [0.1, 0.1, 0.1],
        "position": [x, 0, z]});
    let mut held = json!({"name": "pivot", "bodies": ["bob", "support"], "at": [0, 0, 0]});
    if joint == "hinge" {
        held["axis"] = json!([0, 1, 0]);
    }
    scene(
        &json!({"gravity": [0, 0, -G], "bodies": [support(motion), body], "joints": [{joint: held}],
        "interpenetration": "resolve"}),
        end,
        step,
    )
}

/// Returns the final angle of the pendulum of `pendulum_on`, from its equation of motion with the accelerations `x`
/// and `z` of the pivot, by Radau IIA.
fn pendulum_exactly(x: &str, z: &str, spin: f64, end: f64) -> f64 {
    let solution = solve(&json!({
        "problem": {"dvi": {"states": {
            "a": {"initial": 1, "rate": "b"},
            "b": {"initial": spin, "rate": format!("-0.5*((9.81 + ({z}))*sin(a) + ({x})*cos(a))/(0.1 + 0.25)")}}}},
        "time": {"end": end}, "method": {"rtol": 1e-12, "atol": 1e-13}}));
    last(&solution, "a")
}

#[test]
fn a_pendulum_on_a_shaken_pivot_swings_as_in_its_angle_at_second_order() {
    // The pivot starts at rest, so that the pendulum on it starts at rest, too.
    let moves = json!({"position": ["0.2*(1 - cos(3*t))", 0, "0.1*(1 - cos(5*t))"]});
    let (x, z) = ("1.8*cos(3*t)", "2.5*cos(5*t)");
    let angle = pendulum_exactly(x, z, 0.0, 3.0);
    let pivot = [0.2 * (1.0 - 9.0_f64.cos()), 0.1 * (1.0 - 15.0_f64.cos())];
    for joint in ["ball", "hinge"] {
        let errors = [4e-3, 2e-3].map(|step| {
            let solution = solve(&pendulum_on(moves.clone(), joint, step, 3.0));
            assert_sound(&solution);
            let [x, z] = ["bob.x", "bob.z"].map(|name| last(&solution, name));
            (x - pivot[0] - 0.5 * angle.sin()).hypot(z - pivot[1] + 0.5 * angle.cos())
        });
        assert!(errors[1] < 1e-4 && (errors[0] / errors[1]).log2() > 1.9, "{joint}: {errors:?}");
    }
    // The motion of the pivot is the same when its specification gives a velocity in place of a position.
    let by_velocity = json!({"velocity": ["0.6*sin(3*t)", 0, "0.5*sin(5*t)"]});
    let [a, b] = [moves, by_velocity].map(|motion| last(&solve(&pendulum_on(motion, "ball", 2e-3, 3.0)), "bob.x"));
    assert!((a - b).abs() < 1e-9, "{a} {b}");
}

/// A pendulum is stable upside down if its pivot shakes fast enough, `a w > sqrt(2 g l_eff)` (Stephenson 1908).
#[test]
fn a_pendulum_stands_on_its_head_on_a_pivot_that_shakes_fast() {
    let upright = |speed: f64| {
        let w = 150.0;
        let motion = json!({"position": [0, 0, format!("{}*(1 - cos({w}*t))", speed / w)]});
        let mut specification = pendulum_on(motion, "ball", 5e-4, 3.0);
        specification["problem"]["rigid_bodies"]["bodies"][1]["position"] = json!([0.05, 0, 0.4974937185533]);
        let solution = solve(&specification);
        assert_sound(&solution);
        column(&solution, "bob.z").iter().skip(1).all(|z| *z > 0.3)
    };
    // The length of the equivalent simple pendulum is (0.1 + 0.25)/0.5 = 0.7 m.
    let least = (2.0 * G * 0.7_f64).sqrt();
    assert!(upright(1.5 * least) && !upright(0.6 * least));
}

/// A mass on a spring whose other end moves by `s sin(w t)`: `m x'' = -k (x - s sin(w t))`.
#[test]
fn a_spring_on_a_driven_body_forces_an_oscillation() {
    let (k, w, s) = (100.0_f64, 4.0_f64, 0.05_f64);
    let run = |step: f64| {
        let ball = json!({"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [2, 0, 0]});
        let spring =
            json!({"name": "coil", "bodies": ["support", "ball"], "at": [[0, 0, 0], [2, 0, 0]], "stiffness": k});
        let moved = support(json!({"position": ["0.05*sin(4*t)", 0, 0]}));
        solve(&scene(&json!({"bodies": [moved, ball], "springs": [spring]}), 3.0, step))
    };
    let own = k.sqrt();
    let exact = |t: f64| 2.0 + s * k / (k - w * w) * ((w * t).sin() - w / own * (own * t).sin());
    let errors = [4e-3, 2e-3].map(|step| {
        let solution = run(step);
        assert_sound(&solution);
        assert!(
            (last(&solution, "coil.length") - (last(&solution, "ball.x") - s * (4.0_f64 * 3.0).sin())).abs() < 1e-12
        );
        distance(&solution, "ball.x", exact)
    });
    assert!(errors[1] < 1e-4 && (errors[0] / errors[1]).log2() > 1.95, "{errors:?}");
}

/// A ball fixed to a rotating arm stays on a circle, and the arm pulls it with the force `m w^2 r`. The rotation,
/// about a line that is not a coordinate axis, is given as an angular velocity and as a rotation vector.
#[test]
fn a_body_on_a_driven_arm_stays_on_its_circle_and_is_pulled_to_its_centre() {
    let axis = [2.0_f64 / 3.0, -1.0 / 3.0, 2.0 / 3.0];
    let at = [0.5, 0.0, -0.5];
    for motion in
        [json!({"angular_velocity": axis.map(|a| 3.0 * a)}), json!({"rotation": axis.map(|a| format!("3*({a})*t"))})]
    {
        let ball = json!({"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 2, "position": at});
        let solution = solve(&scene(
            &json!({"bodies": [support(motion), ball],
            "joints": [{"fixed": {"name": "arm", "bodies": ["ball", "support"]}}], "interpenetration": "resolve"}),
            2.0,
            2e-3,
        ));
        assert_sound(&solution);
        let line = nalgebra::Unit::new_normalize(nalgebra::Vector3::from(axis));
        for (k, t) in solution.trajectory.t.iter().enumerate() {
            let turn = nalgebra::UnitQuaternion::from_axis_angle(&line, 3.0 * t);
            let exact = turn * nalgebra::Vector3::from(at);
            for (i, name) in ["ball.x", "ball.y", "ball.z"].into_iter().enumerate() {
                assert!((column(&solution, name)[k] - exact[i]).abs() < 1e-9, "{t}: {name}");
            }
        }
        let radius = (nalgebra::Vector3::from(at) - line.into_inner() * line.dot(&nalgebra::Vector3::from(at))).norm();
        let pull =
            ["arm.fx", "arm.fy", "arm.fz"].map(|name| last(&solution, name)).map(|f| f * f).iter().sum::<f64>().sqrt();
        assert!((pull - 2.0 * 9.0 * radius).abs() < 1e-3 * pull, "{pull} for {}", 2.0 * 9.0 * radius);
        // A steady rotation of the arm needs no work other than that which gives the ball its initial speed.
        let energy = solution.diagnostics.energy.unwrap();
        assert!(energy.work_of_drives.abs() < 1e-6 * energy.kinetic_at_end, "{energy:?}");
    }
}

/// A support that rotates about two axes at once: a body fixed to it has the angular velocity that follows from the
/// derivative of the rotation.
#[test]
fn a_rotation_about_a_moving_line_has_the_angular_velocity_of_its_derivative() {
    let rotation = |t: f64| nalgebra::Vector3::new(0.8 * (2.0 * t).sin(), 0.5 * t, 0.3 * t * t);
    let motion = json!({"rotation": ["0.8*sin(2*t)", "0.5*t", "0.3*t^2"]});
    let ball =
        json!({"name": "ball", "shape": {"box": {"size": [0.2, 0.1, 0.1]}}, "mass": 2, "position": [0.3, 0.2, 0]});
    let errors = [4e-3, 2e-3].map(|step| {
        let solution = solve(&scene(
            &json!({"bodies": [support(motion.clone()), ball.clone()],
            "joints": [{"fixed": {"bodies": ["ball", "support"]}}], "interpenetration": "resolve"}),
            1.5,
            step,
        ));
        assert_sound(&solution);
        let turn = |t: f64| nalgebra::UnitQuaternion::from_scaled_axis(rotation(t));
        let small = 1e-4;
        let omega = (turn(1.5 + small) * turn(1.5 - small).inverse()).scaled_axis() / (2.0 * small);
        let exact = turn(1.5) * nalgebra::Vector3::new(0.3, 0.2, 0.0);
        for (i, name) in ["ball.x", "ball.y", "ball.z"].into_iter().enumerate() {
            assert!((last(&solution, name) - exact[i]).abs() < 1e-9, "{name}");
        }
        ["ball.wx", "ball.wy", "ball.wz"]
            .iter()
            .enumerate()
            .map(|(i, name)| (last(&solution, name) - omega[i]).abs())
            .fold(0.0, f64::max)
    });
    // Joint constraints on velocities are satisfied at the end of each step, so that the fixed body has the angular
    // velocity of the support.
    assert!(errors.iter().all(|error| *error < 1e-6), "{errors:?}");
}

/// The stops of a hinge on a rotating body carry along the arm that is hinged to it.
#[test]
fn a_stop_on_a_driven_body_pushes() {
    let arm = json!({"name": "arm", "shape": {"box": {"size": [1, 0.1, 0.1]}}, "mass": 3, "position": [0.5, 0, 0]});
    let hinge = json!({"name": "hinge", "bodies": ["arm", "support"], "at": [0, 0, 0], "axis": [0, 0, 1],
        "limits": {"lower": -0.5, "upper": 0.5}});
    let solution = solve(&scene(
        &json!({"bodies": [support(json!({"angular_velocity": [0, 0, "2*t"]})), arm],
        "joints": [{"hinge": hinge}]}),
        2.0,
        1e-3,
    ));
    // The support rotates by the angle t^2. Once it has turned by half a radian, a stop carries the arm along, half a
    // radian behind, and the arm does not overtake the support.
    let coordinate = column(&solution, "hinge.coordinate");
    assert!(coordinate.iter().all(|angle| *angle > -0.5 - 1e-3 && *angle < 0.5 + 1e-3), "{coordinate:?}");
    assert!((last(&solution, "arm.wz") - 4.0).abs() < 0.05, "{}", last(&solution, "arm.wz"));
    assert!(lacking(&solution) < 1e-3, "{:e}", lacking(&solution));
}

/// Solves a body on a bushing to the world, and asserts its energy balance.
fn on_bushing(bushing: &Value, body: &Value, step: f64, end: f64) -> Solution {
    let mut body_of = json!({"name": "block", "shape": {"box": {"size": [0.2, 0.2, 0.2]}}, "mass": 2,
        "inertia": [0.5, 0.4, 0.3]});
    body_of.as_object_mut().unwrap().extend(body.as_object().unwrap().clone());
    let mut bushing_of = json!({"name": "mount", "bodies": ["block"], "at": [0, 0, 0]});
    bushing_of.as_object_mut().unwrap().extend(bushing.as_object().unwrap().clone());
    let solution = solve(&scene(&json!({"bodies": [body_of], "bushings": [bushing_of]}), end, step));
    assert!(lacking(&solution) < 1e-9, "{:e}", lacking(&solution));
    solution
}

#[test]
fn a_block_on_a_bushing_swings_along_each_axis_with_its_own_frequency() {
    let stiffness = [50.0_f64, 200.0, 800.0];
    let velocity = [0.3_f64, -0.2, 0.5];
    let errors = [4e-3, 2e-3].map(|step| {
        let solution = on_bushing(&json!({"stiffness": stiffness}), &json!({"velocity": velocity}), step, 2.0);
        let of_axis = |i: usize| {
            let w = (stiffness[i] / 2.0).sqrt();
            distance(&solution, ["block.x", "block.y", "block.z"][i], |t| velocity[i] / w * (w * t).sin())
        };
        (0..3).map(of_axis).fold(0.0, f64::max)
    });
    assert!(errors[1] < 1e-3 && (errors[0] / errors[1]).log2() > 1.9, "{errors:?}");
    // With the axes of the bushing rotated by a quarter turn, its stiff axis is along x.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let turned = json!({"stiffness": [0, 0, 800], "orientation": [half, 0, half, 0]});
    let solution = on_bushing(&turned, &json!({"velocity": [0.5, 0, 0]}), 1e-3, 2.0);
    assert!(distance(&solution, "block.x", |t| 0.025 * (20.0 * t).sin()) < 1e-4);
    assert!(solution.trajectory.field("mount.x").is_none() && solution.trajectory.field("mount.fz").is_some());
}

/// Rotation about one axis obeys `I a'' = -k sin a cos a`: twice the angle is that of a pendulum, whose period
/// follows from the arithmetic-geometric mean.
#[test]
fn a_block_turns_on_a_bushing_as_a_pendulum_of_twice_its_angle() {
    let (k, inertia, most) = (12.0_f64, 0.3_f64, 0.7_f64);
    let spin = (k / inertia).sqrt() * most.sin();
    let (mut a, mut b) = (1.0_f64, most.cos());
    for _ in 0..8 {
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
    }
    // A quarter of the period of the block on the bushing is K(sin(phi/2))/w, with phi = 2 most and w^2 = k/I.
    let period = 4.0 * 0.5 * PI / a / (k / inertia).sqrt();
    let errors = [200.0, 400.0].map(|steps| {
        let bushing = json!({"rotational_stiffness": [5, 7, k], "stiffness": [10, 10, 10]});
        let solution = on_bushing(&bushing, &json!({"angular_velocity": [0, 0, spin]}), period / steps, period);
        let largest = column(&solution, "mount.rz").iter().copied().fold(0.0, f64::max);
        assert!((largest - most.sin()).abs() < 2e-3, "{largest}");
        (last(&solution, "mount.rz")).abs().max((last(&solution, "block.wz") - spin).abs() / spin)
    });
    assert!(errors[1] < 1e-2 && (errors[0] / errors[1]).log2() > 1.9, "{errors:?}");
}

#[test]
fn a_bushing_bears_a_weight_and_its_damping_brings_it_to_rest() {
    let block =
        json!({"name": "block", "shape": {"box": {"size": [0.2, 0.2, 0.2]}}, "mass": 2, "position": [0.1, 0, 0]});
    let bushing = json!({"name": "mount", "bodies": ["block"], "at": [0, 0, 0], "stiffness": [1e4, 1e4, 1e4],
        "damping": [200, 200, 200], "rotational_stiffness": [100, 100, 100], "rotational_damping": [4, 4, 4]});
    let solution = solve(&scene(&json!({"gravity": [0, 0, -G], "bodies": [block], "bushings": [bushing]}), 6.0, 2e-3));
    assert!(lacking(&solution) < 1e-9 && solution.verdict.trusted, "{:?}", solution.verdict);
    // The weight of the block acts at 0.1 m from the bushing: at rest 2 g 0.1 cos a = 100 sin a cos a.
    let angle = (2.0 * G * 0.1 / 100.0_f64).asin();
    assert!((last(&solution, "mount.fz") - 2.0 * G).abs() < 1e-6, "{}", last(&solution, "mount.fz"));
    assert!((last(&solution, "mount.ry") - angle.sin()).abs() < 1e-6, "{}", last(&solution, "mount.ry"));
    assert!((last(&solution, "mount.z") + 2.0 * G / 1e4).abs() < 1e-7);
    assert!((last(&solution, "block.x") - 0.1 * angle.cos()).abs() < 1e-6);
}

/// A train of cars on stiff bushings in long steps: its energy does not grow, whatever the step size.
#[test]
fn a_train_on_stiff_bushings_gains_no_energy_in_long_steps() {
    let car = |k: usize| {
        json!({"name": format!("c{k}"), "shape": {"box": {"size": [0.6, 0.3, 0.3]}}, "mass": 1 + k, "position": [k, 0, 0],
            "velocity": [0, if k == 0 { 2 } else { 0 }, 0], "angular_velocity": [k, 0, 1]})
    };
    let coupling = |k: usize| {
        json!({"bodies": [format!("c{k}"), format!("c{}", k + 1)], "at": [k as f64 + 0.5, 0, 0], "stiffness": [1e5, 1e4, 1e4],
            "rotational_stiffness": [100, 200, 300]})
    };
    let cars: Vec<Value> = (0..6).map(car).collect();
    let couplings: Vec<Value> = (0..5).map(coupling).collect();
    let solution = solve(&scene(&json!({"bodies": cars, "bushings": couplings}), 5.0, 1e-2));
    let (kinetic, potential) = (column(&solution, "kinetic_energy"), column(&solution, "potential_energy"));
    let start = kinetic[0] + potential[0];
    for (kinetic, potential) in kinetic.iter().zip(potential) {
        assert!(kinetic + potential <= start * (1.0 + 1e-9), "{} of {start}", kinetic + potential);
    }
    assert!(lacking(&solution) < 1e-2, "{:e}", lacking(&solution));
}

/// A mount on a shaken table transmits `1/(1 - (w/w0)^2)` of its motion once the transient has decayed.
#[test]
fn a_bushing_on_a_driven_table_isolates() {
    let (k, c, w) = (200.0_f64, 3.0_f64, 30.0_f64);
    let block = json!({"name": "block", "shape": {"box": {"size": [0.2, 0.2, 0.2]}}, "mass": 2, "position": [0, 0, 1]});
    let bushing = json!({"bodies": ["block", "support"], "at": [0, 0, 1], "stiffness": [k, k, k], "damping": [c, c, c],
        "rotational_stiffness": [10, 10, 10], "rotational_damping": [1, 1, 1]});
    let moved = support(json!({"position": [0, 0, format!("0.01*sin({w}*t)")]}));
    let solution = solve(&scene(&json!({"bodies": [moved, block], "bushings": [bushing]}), 12.0, 5e-4));
    assert_sound(&solution);
    // The complex amplitude of the block, relative to the table's, is (k + i c w)/(k - m w^2 + i c w).
    let (re, im) = (k - 2.0 * w * w, c * w);
    let size = re * re + im * im;
    let of = [(k * re + im * im) / size, (im * re - k * im) / size];
    let late = solution.trajectory.t.iter().zip(column(&solution, "block.z")).filter(|(t, _)| **t > 11.0);
    let off =
        late.map(|(t, z)| (z - 1.0 - 0.01 * (of[0] * (w * t).sin() + of[1] * (w * t).cos())).abs()).fold(0.0, f64::max);
    assert!(off < 2e-6, "{off:e}");
}
