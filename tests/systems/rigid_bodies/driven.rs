//! Forces, springs, dampers, motors, stops, and bodies with prescribed motion, each compared with a closed form and
//! checked by the energy balance.

use super::on_the_ground;
use crate::systems::harness::{column, distance, last, solve};
use dvi::solution::Solution;
use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};

const G: f64 = 9.81;

fn scene(members: &Value, end: f64, step: f64) -> Value {
    json!({"problem": {"rigid_bodies": members}, "time": {"end": end}, "method": {"step": step},
        "output": {"times": {"count": 101}}})
}

fn ball(at: [f64; 3], velocity: [f64; 3]) -> Value {
    json!({"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": at, "velocity": velocity})
}

/// A rod of 3 kg and 1 m along x on a hinge at its end, with the moment of inertia `I` about the hinge; `joint` has
/// further members of the hinge.
fn rod(joint: &Value, step: f64, end: f64) -> Value {
    let mut hinge = json!({"name": "hinge", "bodies": ["rod"], "at": [0, 0, 0], "axis": [0, 0, 1]});
    hinge.as_object_mut().unwrap().extend(joint.as_object().unwrap().clone());
    let rod = json!({"name": "rod", "shape": {"box": {"size": [1, 0.1, 0.1]}}, "mass": 3, "position": [0.5, 0, 0]});
    scene(&json!({"bodies": [rod], "joints": [{"hinge": hinge}]}), end, step)
}

const I: f64 = 3.0 * 0.25 + 3.0 * 1.01 / 12.0;

/// Returns the largest defect of the energy balance of a run, relative to all energy and work.
fn lacking(solution: &Solution) -> f64 {
    let energy = solution.diagnostics.energy.unwrap();
    energy.largest_defect / energy.size()
}

#[test]
fn a_spring_and_a_damper_swing_at_second_order_and_the_damper_has_what_is_gone() {
    let (k, c) = (100.0_f64, 2.0_f64);
    let run = |step: f64| {
        let spring =
            json!({"bodies": ["ball"], "at": [[1.1, 0, 0], [0, 0, 0]], "stiffness": k, "damping": c, "rest_length": 1});
        solve(&scene(&json!({"bodies": [ball([1.1, 0.0, 0.0], [0.0; 3])], "springs": [spring]}), 2.0, step))
    };
    let (decay, w) = (0.5 * c, (k - 0.25 * c * c).sqrt());
    let exact = |t: f64| 1.0 + 0.1 * (-decay * t).exp() * ((w * t).cos() + decay / w * (w * t).sin());
    let (coarse, fine) = (run(4e-3), run(2e-3));
    let [off, less] = [&coarse, &fine].map(|solution| distance(solution, "ball.x", exact));
    assert!(less < 1e-4 && (off / less).log2() > 1.95, "{off:e} {less:e}");
    assert!(lacking(&coarse) < 1e-12, "{:e}", lacking(&coarse));
    let energy = coarse.diagnostics.energy.unwrap();
    let rest = energy.kinetic_at_end + energy.potential_at_end;
    assert!((energy.dissipated_by_viscosity + rest - 0.5).abs() < 1e-12);
}

/// Two free bodies on a spring: for any step size, the oscillation conserves angular momentum and energy.
#[test]
fn a_spring_between_two_free_bodies_keeps_energy_and_momentum_in_long_steps() {
    let body = |name: &str, x: f64, mass: f64, vy: f64| json!({"name": name, "shape": {"sphere": {"radius": 0.1}}, "mass": mass, "position": [x, 0, 0], "velocity": [0, vy, 0]});
    let members = json!({"bodies": [body("a", 0.0, 1.0, 2.0), body("b", 1.0, 4.0, -0.5)],
        "springs": [{"bodies": ["a", "b"], "at": [[0, 0, 0], [1, 0, 0]], "stiffness": 50, "rest_length": 0.7}]});
    let solution = solve(&scene(&members, 50.0, 0.05));
    assert!(lacking(&solution) < 1e-12, "{:e}", lacking(&solution));
    for k in 0..=100 {
        let at = |name: &str| column(&solution, name)[k];
        let spin = |body: &str, mass: f64| {
            let [x, y, vx, vy] = ["x", "y", "vx", "vy"].map(|key| at(&format!("{body}.{key}")));
            mass * (x * vy - y * vx)
        };
        assert!((spin("a", 1.0) + spin("b", 4.0) + 2.0).abs() < 1e-10);
        assert!((at("a.vy") + 4.0 * at("b.vy")).abs() < 1e-12);
    }
}

/// An applied force `-k x - c x'` as an expression in the motion of its body, and the force on a charge in a magnetic
/// field, which does no work.
#[test]
fn forces_as_expressions_in_the_motion_of_their_body_act_at_second_order() {
    let run = |force: Value, step: f64| {
        let members = json!({"parameters": {"k": 100, "c": 2, "B": 3}, "bodies": [ball([0.1, 0.0, 0.0], [0.0, 1.0, 0.0])],
            "forces": [{"body": "ball", "force": force}]});
        solve(&scene(&members, 2.0, step))
    };
    let w = 99.0_f64.sqrt();
    let exact = |t: f64| 0.1 * (-t).exp() * ((w * t).cos() + (w * t).sin() / w);
    let [off, less] =
        [4e-3, 2e-3].map(|step| distance(&run(json!(["-k*ball.x - c*ball.vx", 0, 0]), step), "ball.x", exact));
    assert!(less < 1e-4 && (off / less).log2() > 1.95, "{off:e} {less:e}");
    let circle = run(json!(["B*ball.vy", "-B*ball.vx", 0]), 0.01);
    let radius = 1.0 / 3.0;
    for k in 0..=100 {
        let [x, y] = ["ball.x", "ball.y"].map(|name| column(&circle, name)[k]);
        assert!(((x - 0.1 - radius).hypot(y) - radius).abs() < 1e-4, "{x} {y}");
    }
    assert!(circle.diagnostics.energy.unwrap().work_of_forces.abs() < 1e-12 && lacking(&circle) < 1e-12);
}

#[test]
fn a_force_may_follow_another_body_and_act_off_the_centre_along_the_axes_of_its_own() {
    let leader = json!({"name": "leader", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 5, 0],
        "velocity": [1, 0, 0]});
    let members = json!({"bodies": [ball([0.0; 3], [0.0; 3]), leader],
        "forces": [{"body": "ball", "force": ["4*(leader.x - ball.x) + 4*(leader.vx - ball.vx)", 0, 0]}]});
    let solution = solve(&scene(&members, 5.0, 1e-3));
    // The position of the ball relative to its leader is x - t = -t e^{-2t}.
    assert!(distance(&solution, "ball.x", |t| t - t * (-2.0 * t).exp()) < 1e-5);
    let thruster = json!({"bodies": [ball([0.0; 3], [0.0; 3])],
        "forces": [{"body": "ball", "force": [0, 1, 0], "at": [0.05, 0, 0], "axes": "body"}]});
    let spun = solve(&scene(&thruster, 2.0, 1e-3));
    let rate = 0.05 / (0.4 * 0.01);
    assert!(distance(&spun, "ball.wz", |t| rate * t) < 1e-10);
    // Velocity of the ball with a thruster, as of a point on Cornu's spiral: the integral of (-sin, cos) of rate t^2 /
    // 2, by Simpson's rule.
    let [vx, vy] = [f64::sin as fn(f64) -> f64, f64::cos].map(|of| {
        let f = |t: f64| of(0.5 * rate * t * t);
        let n = 10_000;
        let h = 2.0 / f64::from(n);
        (0..n)
            .map(|i| {
                let t = h * f64::from(i);
                h / 6.0 * (f(t) + 4.0 * f(t + 0.5 * h) + f(t + h))
            })
            .sum::<f64>()
    });
    assert!((last(&spun, "ball.vx") + vx).abs() < 1e-4 && (last(&spun, "ball.vy") - vy).abs() < 1e-4);
    assert!(lacking(&spun) < 1e-10, "{:e}", lacking(&spun));
}

/// A drag with a time constant of a thousandth of a step removes the velocity relative to its target within one step.
#[test]
fn what_drags_and_dampers_take_within_a_step_is_gone() {
    let drag = json!({"bodies": [ball([0.0; 3], [1.0, 0.0, 0.0])],
        "forces": [{"body": "ball", "force": ["1e5*(2 - ball.vx)", 0, 0]}]});
    let solution = solve(&scene(&drag, 0.1, 1e-2));
    assert!((last(&solution, "ball.vx") - 2.0).abs() < 2e-3, "{}", last(&solution, "ball.vx"));
    let damper = json!({"bodies": [ball([1.0, 0.0, 0.0], [1.0, 0.0, 0.0])],
        "springs": [{"bodies": ["ball"], "at": [[1, 0, 0], [0, 0, 0]], "damping": 1e5}]});
    let solution = solve(&scene(&damper, 1.0, 1e-2));
    assert!(last(&solution, "ball.vx").abs() < 1e-3 && (last(&solution, "ball.x") - 1.0 - 1e-5).abs() < 1e-8);
    assert!(lacking(&solution) < 1e-6, "{:e}", lacking(&solution));
}

#[test]
fn motors_move_hinges_and_sliders_as_they_say_and_their_work_is_in_the_balance() {
    let turned = solve(&rod(&json!({"motor": {"position": "2*t^2"}}), 1e-3, 2.0));
    assert!(distance(&turned, "rod.y", |t| 0.5 * (2.0 * t * t).sin()) < 1e-12);
    assert!(distance(&turned, "rod.wz", |t| 4.0 * t) < 1e-10);
    // The angle of a hinge counts full turns, and the torque of its motor is 4 I.
    assert!((last(&turned, "hinge.coordinate") - 8.0).abs() < 1e-10);
    assert!((last(&turned, "hinge.effort") - 4.0 * I).abs() < 1e-3, "{}", last(&turned, "hinge.effort"));
    let energy = turned.diagnostics.energy.unwrap();
    assert!((energy.work_of_drives - 32.0 * I).abs() < 1e-5 && lacking(&turned) < 1e-6, "{energy:?}");
    let slider = json!({"name": "slide", "bodies": ["ball"], "at": [0, 0, 0], "axis": [1, 0, 0], "motor": {"velocity": "3*cos(3*t)"}});
    let members =
        json!({"gravity": [0, 0, -G], "bodies": [ball([0.0; 3], [3.0, 0.0, 0.0])], "joints": [{"slider": slider}]});
    let slid = solve(&scene(&members, 2.0, 1e-3));
    assert!(distance(&slid, "ball.x", |t| (3.0 * t).sin()) < 1e-12);
    assert!((last(&slid, "slide.fz") - G).abs() < 1e-9, "the guide carries the weight: {}", last(&slid, "slide.fz"));
    assert!((last(&slid, "slide.effort") + 9.0 * 6.0_f64.sin()).abs() < 0.02 && lacking(&slid) < 1e-6);
}

#[test]
fn efforts_servos_and_springs_turn_a_hinge_as_oscillators_do() {
    let pushed = solve(&rod(&json!({"motor": {"effort": "cos(t)"}}), TAU / 600.0, TAU));
    assert!(distance(&pushed, "hinge.coordinate", |t| (1.0 - t.cos()) / I) < 1e-4);
    assert!(lacking(&pushed) < 1e-6);
    // A servo with the natural frequency w = 5 and a damping ratio of 0.5 that follows t^2, initially at rest.
    let (k, c) = (25.0 * I, 5.0 * I);
    let servo = solve(&rod(&json!({"motor": {"servo": {"target": "t^2", "stiffness": k, "damping": c}}}), 1e-3, 5.0));
    // The tracking error e = t^2 - q satisfies e'' + 5 e' + 25 e = 2.
    let (decay, w) = (2.5, 18.75_f64.sqrt());
    let error = |t: f64| 0.08 * (1.0 - (-decay * t).exp() * ((w * t).cos() + decay / w * (w * t).sin()));
    assert!(distance(&servo, "hinge.coordinate", |t| t * t - error(t)) < 1e-5);
    let bound = solve(&rod(
        &json!({"motor": {"servo": {"target": "1000", "stiffness": k, "largest_effort": 2.0 * I}}}),
        1e-3,
        2.0,
    ));
    assert!(distance(&bound, "hinge.coordinate", |t| t * t) < 1e-5);
    let (angle, w) = (0.5, (10.0_f64 / I).sqrt());
    let swung = solve(&rod(&json!({"spring": {"stiffness": 10, "rest": angle}}), 1e-3, 5.0));
    assert!(distance(&swung, "hinge.coordinate", |t| angle * (1.0 - (w * t).cos())) < 1e-5);
    assert!(lacking(&swung) < 1e-6, "{:e}", lacking(&swung));
}

/// A torsion spring on a hinge counts full turns: wound up by three turns, it rotates the rod by six.
#[test]
fn a_spring_on_a_hinge_is_wound_up_by_whole_turns() {
    let w = (0.5_f64 / I).sqrt();
    let off = |step: f64| {
        let solution = solve(&rod(&json!({"spring": {"stiffness": 0.5, "rest": 3.0 * TAU}}), step, 8.0));
        assert!(lacking(&solution) < 1e-4);
        distance(&solution, "hinge.coordinate", |t| 3.0 * TAU * (1.0 - (w * t).cos()))
    };
    let (coarse, fine) = (off(4e-3), off(2e-3));
    assert!(fine < 1e-2 && (coarse / fine).log2() > 1.9, "{coarse:e} {fine:e}");
}

/// A stop of the hinge at half a radian: the rod hits it with the angular velocity of `w^2 = 2 g m l sin a / I`, and
/// rebounds with half of it.
#[test]
fn stops_of_joints_obey_the_law_of_impact_and_hold_what_rests_on_them() {
    let run = |restitution: f64, end: f64| {
        let mut document =
            rod(&json!({"axis": [0, 1, 0], "limits": {"upper": 0.5, "restitution": restitution}}), 1e-3, end);
        document["problem"]["rigid_bodies"]["gravity"] = json!([0, 0, -G]);
        solve(&document)
    };
    let rest = run(0.0, 2.0);
    assert!((last(&rest, "hinge.coordinate") - 0.5).abs() < 1e-6 && last(&rest, "rod.wy").abs() < 1e-9);
    let fallen = 3.0 * G * 0.5 * 0.5_f64.sin();
    let lost = rest.diagnostics.energy.unwrap().lost_in_impacts;
    assert!((lost - fallen).abs() < 1e-2 * fallen && lacking(&rest) < 1e-3, "{lost} {fallen}");
    let speeds = column(&run(0.5, 0.7), "rod.wy").to_vec();
    let (fastest, back) = speeds.iter().fold((0.0_f64, 0.0_f64), |(most, least), w| (most.max(*w), least.min(*w)));
    let hit = (2.0 * fallen / I).sqrt();
    assert!((fastest - hit).abs() < 0.05 * hit && (back + 0.5 * hit).abs() < 0.05 * hit, "{fastest} {back} {hit}");
}

/// A belt accelerates a block, and friction dissipates a part of the belt's work.
#[test]
fn a_belt_takes_up_a_block_and_does_the_work_of_friction_and_of_motion() {
    let members = json!({"gravity": [0, 0, -10], "contacts": {"friction": 0.5}, "bodies": [
        {"name": "block", "shape": {"box": {"size": [0.2, 0.2, 0.2]}}, "mass": 1, "position": [0, 0, 0.1]},
        {"name": "belt", "shape": {"box": {"size": [20, 1, 0.1]}}, "position": [0, 0, -0.05], "contact_forces": true,
            "motion": {"velocity": [1, 0, 0]}}]});
    let solution = solve(&scene(&members, 1.0, 1e-3));
    let exact = |t: f64| if t < 0.2 { 2.5 * t * t } else { 0.1 + (t - 0.2) };
    assert!(distance(&solution, "block.x", exact) < 6e-4);
    let energy = solution.diagnostics.energy.unwrap();
    assert!(
        (energy.work_of_drives - 1.0).abs() < 1e-9 && (energy.dissipated_by_friction - 0.5).abs() < 1e-9,
        "{energy:?}"
    );
    assert!(lacking(&solution) < 1e-12);
    let dragged = column(&solution, "belt.contact_fx");
    assert!((dragged[10] + 5.0).abs() < 1e-9 && dragged[90].abs() < 1e-9, "{} {}", dragged[10], dragged[90]);
    assert!((last(&solution, "belt.contact_fz") + 10.0).abs() < 1e-9);
}

#[test]
fn a_table_that_shakes_throws_a_block_up_where_it_falls_faster_than_gravity_takes_it() {
    let run = |w: f64| {
        let members = json!({"gravity": [0, 0, -G], "bodies": [
            {"name": "block", "shape": {"box": {"size": [0.2, 0.2, 0.2]}}, "mass": 1, "position": [0, 0, 0.1]},
            {"name": "table", "shape": {"half_space": {"normal": [0, 0, 1]}}, "motion": {"position": [0, 0, format!("0.1*(1 - cos({w}*t))")]}}]});
        solve(&scene(&members, 0.6, 1e-4))
    };
    let slow = run(9.0);
    assert!(distance(&slow, "block.z", |t| 0.2 - 0.1 * (9.0 * t).cos()) < 1e-3, "0.1 w^2 < g");
    // The body detaches from the table when the table decelerates with g: cos(w t) = -g / (0.1 w^2).
    let w = 12.0_f64;
    let (fast, leaves) = (run(w), (-G / (0.1 * w * w)).acos() / w);
    let (z, v) = (0.1 * (1.0 - (w * leaves).cos()), 0.1 * w * (w * leaves).sin());
    let flown = |t: f64| {
        if t < leaves { 0.1 * (1.0 - (w * t).cos()) } else { z + v * (t - leaves) - 0.5 * G * (t - leaves).powi(2) }
    };
    let until = 0.45;
    let times = &fast.trajectory.t;
    let off = column(&fast, "block.z")
        .iter()
        .zip(times)
        .filter(|(_, t)| **t < until)
        .map(|(z, t)| (z - 0.1 - flown(*t)).abs());
    let off = off.fold(0.0, f64::max);
    assert!(off < 1e-3 && flown(until) > 0.1 * (1.0 - (w * until).cos()), "{off}");
}

/// A ball whose centre of mass is below its geometric centre rocks with the frequency `w^2 = m g d / (I + m (r -
/// d)^2)`.
#[test]
fn a_ball_with_a_low_centre_of_mass_rocks_and_a_dumbbell_of_parts_has_their_inertia() {
    let (tilt, r, d) = (0.01_f64, 0.1, 0.02);
    let body = json!({"name": "toy", "mass": 1, "shape": {"sphere": {"radius": r}}, "centre_of_mass": [0, 0, -d],
        "inertia": [[0.004, 0, 0], [0, 0.004, 0], [0, 0, 0.004]], "position": [0, 0, r],
        "orientation": [(0.5 * tilt).cos(), (0.5 * tilt).sin(), 0, 0]});
    let solution = solve(&on_the_ground(&[body], &json!({"friction": 0.9}), 2.0, 1e-4));
    let w = (G * d / (0.004 + (r - d) * (r - d))).sqrt();
    assert!(distance(&solution, "toy.qx", |t| 0.5 * tilt * (w * t).cos()) < 1e-2 * tilt);
    let part = |x: f64| json!({"shape": {"sphere": {"radius": 0.1}}, "position": [x, 0, 0]});
    let dumbbell = json!({"name": "ball", "density": 1000, "shape": {"compound": [part(0.5), part(-0.5)]}});
    let members = json!({"bodies": [dumbbell], "forces": [{"body": "ball", "torque": [0, 0, 1]}]});
    let spun = solve(&scene(&members, 1.0, 1e-2));
    let mass = 1000.0 * 4.0 / 3.0 * PI * 1e-3;
    let inertia = 2.0 * mass * (0.4 * 0.01 + 0.25);
    assert!((last(&spun, "ball.wz") * inertia - 1.0).abs() < 1e-10);
}

/// A free body with products of inertia rotates steadily about a principal axis that is not an axis of its frame.
#[test]
fn a_full_inertia_turns_steadily_about_its_principal_axes() {
    let (c, s) = (0.3_f64.cos(), 0.3_f64.sin());
    // Tensor of inertia with the principal moments 1, 2 and 2.5, rotated by 0.3 rad about z.
    let (xx, yy, xy) = (c * c + 2.0 * s * s, s * s + 2.0 * c * c, -c * s);
    let body = json!({"name": "body", "mass": 1, "shape": {"sphere": {"radius": 0.1}},
        "inertia": [[xx, xy, 0], [xy, yy, 0], [0, 0, 2.5]], "angular_velocity": [c, s, 0]});
    let solution = solve(&scene(&json!({"bodies": [body]}), 10.0, 1e-2));
    assert!(distance(&solution, "body.wx", |_| c) < 1e-12 && distance(&solution, "body.wy", |_| s) < 1e-12);
}

#[test]
fn groups_that_exclude_each_other_go_through() {
    let block = |name: &str, z: f64, group: &str| json!({"name": name, "group": group, "shape": {"box": {"size": [0.2, 0.2, 0.2]}}, "mass": 1, "position": [0, 0, z]});
    let contacts = json!({"exclude": [["a", "b"]]});
    let blocks = [block("one", 0.1, "a"), block("two", 0.4, "b"), block("three", 0.7, "a")];
    let solution = solve(&on_the_ground(&blocks, &contacts, 2.0, 1e-3));
    let heights = ["one.z", "two.z", "three.z"].map(|name| last(&solution, name));
    assert!(
        (heights[0] - 0.1).abs() < 1e-3 && (heights[1] - 0.1).abs() < 1e-3 && (heights[2] - 0.3).abs() < 1e-3,
        "{heights:?}"
    );
}

/// The example of a crank, a rod and a piston: geometry gives the position of the piston.
#[test]
fn a_motor_turns_a_crank_and_the_piston_is_where_geometry_has_it() {
    let example = dvi::specification::EXAMPLES.iter().find(|example| example.name == "crank_slider").unwrap();
    let solution = solve(&serde_json::from_str(example.text).unwrap());
    let exact = |t: f64| {
        let angle = 6.0 * (t + 0.1 * ((-10.0 * t).exp() - 1.0));
        0.1 * angle.cos() + (0.09 - (0.1 * angle.sin()).powi(2)).sqrt()
    };
    assert!(distance(&solution, "piston.x", exact) < 1e-4);
    assert!(lacking(&solution) < 1e-6 && solution.verdict.trusted);
}

/// Motors and forces without an admissible motion fail, and the message names the possible cause.
#[test]
fn a_motor_that_jumps_and_forces_that_end_or_have_no_end_are_failures() {
    let failure = |document: &Value| {
        let specification = dvi::specification::Specification::from_json(document.to_string().as_bytes()).unwrap();
        let solution = dvi::solve(&specification, &dvi::problem::Control::new());
        let error = solution.error.expect("a failure");
        (error.code.to_string(), error.message.to_string())
    };
    let (code, message) = failure(&rod(&json!({"motor": {"position": "if(t > 0.1, 1, 0)"}}), 1e-3, 0.2));
    assert!(code == "joints" && message.contains("motor"), "{code} {message}");
    let force = |force: &str| {
        let forces = json!([{"body": "ball", "force": [force, 0, 0]}]);
        scene(&json!({"bodies": [ball([0.0; 3], [0.0; 3])], "forces": forces}), 1.0, 1e-2)
    };
    let (code, message) = failure(&force("sqrt(0.1 - t)"));
    assert!(code == "joints" && message.contains("force"), "{code} {message}");
    assert_eq!(failure(&force("1e4*ball.vx + 1")).0, "not_finite");
    let motion = json!({"name": "plate", "shape": {"box": {"size": [1, 1, 0.1]}}, "motion": {"position": [0, 0, "-1 - 0*sqrt(0.1 - t)"]}});
    let moved = scene(&json!({"bodies": [ball([0.0; 3], [0.0; 3]), motion]}), 1.0, 1e-2);
    assert_eq!(failure(&moved).0, "not_finite");
}

/// Motors, servos and prescribed velocities act by their integrals over a step: impulse and displacement of a pulse are
/// exact, also of one that is shorter than a step, or lies between two.
#[test]
fn no_pulse_of_a_motor_is_lost_between_steps() {
    let body =
        |place: [f64; 3]| json!({"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": place});
    let run = |joint: &Value| solve(&scene(&json!({"bodies": [body([0.0, 0.0, -1.0])], "joints": [joint]}), 1.0, 1e-2));
    let slider =
        |motor: Value| json!({"slider": {"bodies": ["ball"], "at": [0, 0, -1], "axis": [1, 0, 0], "motor": motor}});
    let hinge =
        |motor: Value| json!({"hinge": {"bodies": ["ball"], "at": [0, 0, 0], "axis": [0, -1, 0], "motor": motor}});
    // Impulses of 1 N s and 1 N m s; the ball has the moment of inertia 1 + 2/5 0.1^2 about the hinge.
    for pulse in ["1000*pulse(t, 0.303, 0.001)", "1e6*pulse(t, 0.303, 1e-6)", "pulse(t, 0.303, 0.015)/0.015"] {
        let slid = run(&slider(json!({"effort": pulse})));
        assert!(slid.verdict.trusted && (last(&slid, "ball.vx") - 1.0).abs() < 1e-9, "{pulse}: {:?}", slid.verdict);
        let turned = run(&hinge(json!({"effort": pulse})));
        let rate = last(&turned, "ball.wy");
        assert!((rate + 1.0 / 1.004).abs() < 1e-3, "{pulse}: {rate}");
    }
    for pulse in ["1000*pulse(t, 0.303, 0.001)", "pulse(t, 0.303, 0.015)/0.015"] {
        let moved = run(&slider(json!({"velocity": pulse})));
        assert!((last(&moved, "ball.x") - 1.0).abs() < 1e-9, "{pulse}: {}", last(&moved, "ball.x"));
    }
    let pwm = run(&slider(json!({"effort": "pwm(t + 0.003, 0.01, 0.1)"})));
    assert!(pwm.verdict.trusted && (last(&pwm, "ball.vx") - 0.1).abs() < 1e-9, "{}", last(&pwm, "ball.vx"));
    // A spring of stiffness one swings about the target: the impulse 1 at t = 0.3035 sets it in motion.
    let servo = run(&slider(
        json!({"servo": {"target": "1000*pulse(t, 0.303, 0.001)", "stiffness": 1, "largest_effort": 1e9}}),
    ));
    assert!((last(&servo, "ball.vx") - 0.6965_f64.cos()).abs() < 5e-3, "{}", last(&servo, "ball.vx"));
    // A body with a prescribed velocity carries another along.
    let carrier = json!({"name": "carrier", "shape": {"sphere": {"radius": 0.1}}, "position": [0, 0, 0],
        "motion": {"velocity": ["1000*pulse(t, 0.303, 0.001)", 0, 0]}});
    let members = json!({"gravity": [0, 0, 0], "bodies": [carrier, body([5.0, 0.0, 0.0])],
        "joints": [{"fixed": {"bodies": ["carrier", "ball"]}}]});
    let carried = solve(&scene(&members, 1.0, 1e-2));
    assert!((last(&carried, "ball.x") - 6.0).abs() < 1e-9, "{}", last(&carried, "ball.x"));
    // A smooth kick has no edges: what the quadrature of a step cannot show is doubted.
    let kick = run(&slider(json!({"effort": "1e5*exp(-((t - 0.3037)/1e-5)^2)"})));
    assert!(!kick.verdict.trusted, "{}", last(&kick, "ball.vx"));
}
