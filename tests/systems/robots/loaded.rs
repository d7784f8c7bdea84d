//! Every robot model of the tests loads as it is, and the remarks name the elements that were left out.

use super::{MODELS, specification};
use crate::systems::harness::{column, last, solve};
use dvi::specification::{Specification, document_of};
use serde_json::{Value, json};

#[test]
fn every_model_is_a_file_that_solves() {
    for (name, _, text) in MODELS {
        let mut document: Value = serde_json::from_slice(&document_of(text.as_bytes())).expect("a document");
        document["time"]["end"] = json!(0.02);
        document["method"] = json!({"step": 1e-3});
        let solution = solve(&document);
        assert!(solution.trajectory.fields.len() > 6, "{name}");
        let label = &solution.provenance.as_ref().expect("provenance").label;
        assert!(label.is_some(), "{name}");
    }
}

fn remarks(name: &str) -> Vec<String> {
    let text = specification(name, json!({}), 0.1, 1e-3).to_string();
    let specification =
        Specification::from_json(text.as_bytes()).unwrap_or_else(|errors| panic!("{name}: {errors:#?}"));
    specification.warnings().filter(|warning| warning.code == "robot").map(|warning| warning.message.clone()).collect()
}

#[test]
fn what_is_left_out_is_told_with_its_lines() {
    let told = |name: &str, part: &str| {
        let remarks = remarks(name);
        assert!(remarks.iter().any(|remark| remark.contains(part)), "{name}: {remarks:#?}");
    };
    told("hopper", "`armature`");
    told("hopper", "several joints of one body");
    told("hopper", "(line 14)");
    told("quadruped", "friction in joints is left out (lines ");
    told("quadruped", "begin in their middle");
    told("half_cheetah", "motors have no control");
    assert!(remarks("pendulum").is_empty() && remarks("double_pendulum").is_empty() && remarks("cartpole").is_empty());
}

#[test]
fn masses_are_those_of_the_shapes() {
    // Masses of the hopper, a robot whose description gives only shapes: capsules with the density of water, and a
    // torso whose mass a sweep overrides.
    let text = specification("hopper", json!({}), 1e-3, 1e-3).to_string();
    let edited =
        dvi::specification::edited(text.as_bytes(), &[("torso.mass".to_owned(), "7".to_owned())]).expect("a mass");
    let written: Value = serde_json::from_slice(&edited).expect("a document");
    let bodies = written["problem"]["rigid_bodies"]["bodies"].as_array().expect("bodies");
    let of = |name: &str| bodies.iter().find(|body| body["name"] == name).unwrap_or_else(|| panic!("no `{name}`"));
    assert_eq!(of("torso")["mass"], 7);
    let exact = |r: f64, l: f64| 1000.0 * std::f64::consts::PI * r * r * (l + 4.0 / 3.0 * r);
    for (name, r, l) in [("thigh", 0.05, 0.45), ("leg", 0.04, 0.5), ("foot", 0.06, 0.26)] {
        let mass = of(name)["mass"].as_f64().expect("a mass");
        assert!((mass - exact(r, l)).abs() < 1e-12 * mass, "{name}: {mass}");
    }
    // A sweep may vary the mass of a body of the robot, but not its friction, which belongs to pairs of bodies.
    let edited = dvi::specification::edited(
        specification("half_cheetah", json!({}), 1e-3, 1e-3).to_string().as_bytes(),
        &[("torso.friction".to_owned(), "1".to_owned())],
    );
    assert!(edited.is_err(), "a body has no friction");
}

#[test]
fn joints_begin_where_the_pose_says() {
    let pose = json!({"shoulder_lift": -1.2, "elbow": {"position": 0.7, "velocity": 2}, "wrist_1": 0.3});
    let solution = solve(&specification("arm", pose, 1e-3, 1e-4));
    // Initial positions of the arm's links from forward kinematics by hand: the arm moves in the x-z plane.
    let (l1, l2) = (0.425, 0.3922);
    let (a, b): (f64, f64) = (-1.2, -1.2 + 0.7);
    let elbow = [-l1 * a.cos(), 0.163 - l1 * a.sin()];
    let first = |name: &str| column(&solution, name)[0];
    assert!((first("forearm_link.x") - elbow[0]).abs() < 1e-12 && (first("forearm_link.z") - elbow[1]).abs() < 1e-12);
    assert!((first("wrist_1_link.x") - (elbow[0] - l2 * b.cos())).abs() < 1e-12);
    assert!((first("wrist_1_link.z") - (elbow[1] - l2 * b.sin())).abs() < 1e-12);
    // A positive rotation of the elbow joint is one about the -y axis of the world.
    assert!((first("forearm_link.wy") + 2.0).abs() < 1e-12 && first("upper_arm_link.wy").abs() < 1e-12);
    assert!((first("wrist_1_link.vx") - 2.0 * l2 * b.sin()).abs() < 1e-12);
    assert!(last(&solution, "elbow.coordinate") > 1e-3);
}

#[test]
fn a_sweep_goes_over_starts_and_masses() {
    let mut document = specification("pendulum", json!({"theta": {"position": 0.1, "velocity": 0}}), 0.1, 1e-3);
    document["sweep"] =
        json!({"over": {"theta.position": [0.1, 0.2], "arm.mass": [1, 5]}, "collect": {"x": {"initial": "arm.x"}}});
    let solution = solve(&document);
    let table = solution.table.expect("a table");
    let x: Vec<f64> = (0..4).map(|row| table.column("x").and_then(|x| x.number(row)).expect("a number")).collect();
    // The origin of the arm's frame is at its pivot, which does not move.
    assert!(x.iter().all(|x| x.abs() < 1e-15), "{x:?}");
    assert_eq!(table.failed, 0);
    let mut document = specification("double_pendulum", json!({"shoulder": {"position": 0.1}}), 0.1, 1e-3);
    document["sweep"] = json!({"over": {"shoulder.position": [0.1, 0.2]}, "collect": {"x": {"initial": "lower.x"}}});
    let table = solve(&document).table.expect("a table");
    for (row, angle) in [0.1_f64, 0.2].into_iter().enumerate() {
        let x = table.column("x").and_then(|x| x.number(row)).expect("a number");
        assert!((x + 0.8 * angle.sin()).abs() < 1e-12, "{x}");
    }
}

#[test]
fn a_free_body_goes_on_from_its_end_and_joints_do_not() {
    let text =
        "<mujoco><worldbody><body name='a' pos='0 0 9'><freejoint/><geom size='0.1'/></body></worldbody></mujoco>";
    let document = json!({"problem": {"rigid_bodies": {"robot": {"mjcf": text, "pose": {"a": {"velocity": [1, 0, 2]}}}}},
        "time": {"end": 0.5}, "method": {"step": 1e-3}});
    let first = solve(&document);
    let at_end = |name: &str| first.trajectory.field(name).and_then(|column| column.last().copied());
    let next =
        dvi::specification::continued(document.to_string().as_bytes(), 0.5, 1.0, at_end).expect("a continuation");
    let second = solve(&serde_json::from_slice(&next).expect("a document"));
    assert!(
        (last(&second, "a.x") - 1.0).abs() < 1e-9 && (last(&second, "a.z") - (9.0 + 2.0 - 0.5 * 9.81)).abs() < 1e-9
    );
    let joined = specification("double_pendulum", json!({}), 0.5, 1e-3).to_string();
    let refused = dvi::specification::continued(joined.as_bytes(), 0.5, 1.0, |_| Some(0.0)).expect_err("joints");
    assert!(refused.to_string().contains("joints"), "{refused}");
}
