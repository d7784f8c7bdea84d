//! Contacts of robots in MJCF and URDF: which shapes touch, and with which friction.

use super::specification;
use crate::systems::harness::{column, last, solve};
use serde_json::{Value, json};

fn mjcf(worldbody: &str, end: f64) -> Value {
    let text = format!("<mujoco><worldbody>{worldbody}</worldbody></mujoco>");
    json!({"problem": {"rigid_bodies": {"robot": {"mjcf": text}}}, "time": {"end": end}, "method": {"step": 1e-3}})
}

const BOX: &str =
    r#"<body name="box" pos="0 0 0.1"><freejoint/><geom type="box" size=".1 .1 .1" friction="FRICTION"/></body>"#;

#[test]
fn the_larger_friction_of_two_shapes_holds() {
    // A box on a slope of 30 degrees, whose gradient is 0.577: it sticks if either friction coefficient is larger.
    let slope = |of_floor: &str, of_box: &str| {
        let gravity = r#"<option gravity="4.905 0 -8.4957"/>"#;
        let floor = format!(r#"<geom type="plane" size="1 1 1" friction="{of_floor}"/>"#);
        let text =
            format!("<mujoco>{gravity}<worldbody>{floor}{}</worldbody></mujoco>", BOX.replace("FRICTION", of_box));
        let document = json!({"problem": {"rigid_bodies": {"robot": {"mjcf": text}}}, "time": {"end": 0.5}, "method": {"step": 1e-3}});
        last(&solve(&document), "box.x")
    };
    assert!(slope("0.1", "0.7").abs() < 1e-6 && slope("0.7 0.1 0.1", "0.1").abs() < 1e-6);
    let slides = 0.5 * (4.905 - 0.3 * 8.4957) * 0.25;
    let found = slope("0.3", "0.1");
    assert!((found - slides).abs() < 2e-3, "{found} instead of {slides}");
}

#[test]
fn masks_say_what_touches() {
    // Balls above a plane, with collision masks: two balls touch only the plane, so that the upper one falls through
    // the lower one and rests on the plane, and the third touches nothing.
    let world = r#"<geom type="plane" size="1 1 1" contype="1" conaffinity="6"/>
        <body name="low" pos="0 0 0.1"><freejoint/><geom size="0.1" contype="2" conaffinity="0"/></body>
        <body name="high" pos="0 0 0.5"><freejoint/><geom size="0.1" contype="4" conaffinity="0"/></body>
        <body name="ghost" pos="0 0 0.9"><freejoint/><geom size="0.1" contype="0" conaffinity="0"/></body>"#;
    let solution = solve(&mjcf(world, 1.0));
    assert!((last(&solution, "low.z") - 0.1).abs() < 1e-6 && (last(&solution, "high.z") - 0.1).abs() < 1e-3);
    assert!((last(&solution, "ghost.z") - (0.9 - 0.5 * 9.81)).abs() < 0.01);
}

#[test]
fn excluded_pairs_and_neighbours_go_through_each_other() {
    let balls = |more: &str| {
        let text = format!(
            r#"<mujoco><option gravity="0 0 0"/><worldbody>
            <body name="a" pos="-1 0 0"><joint type="slide" axis="1 0 0" name="a"/><geom size="0.1"/></body>
            <body name="b" pos="1 0 0"><joint type="slide" axis="1 0 0" name="b"/><geom size="0.1"/></body>
            </worldbody>{more}</mujoco>"#
        );
        let robot = json!({"mjcf": text, "pose": {"a": {"velocity": 2}}});
        let document =
            json!({"problem": {"rigid_bodies": {"robot": robot}}, "time": {"end": 1.5}, "method": {"step": 1e-3}});
        last(&solve(&document), "a.x")
    };
    // After the inelastic impact both balls move on together at half of the speed.
    assert!((balls("") - 1.4).abs() < 5e-3);
    assert!((balls(r#"<contact><exclude body1="a" body2="b"/></contact>"#) - 2.0).abs() < 1e-9);
    assert!((balls(r#"<option><flag contact="disable"/></option>"#) - 2.0).abs() < 1e-9);
}

#[test]
fn a_quadruped_stands_on_a_floor_that_stands_beside_it() {
    // The legs of the quadruped are folded, and servos hold them.
    let mut document = specification("quadruped", json!({}), 0.6, 1e-3);
    let mut pose = serde_json::Map::new();
    let mut motors = serde_json::Map::new();
    for leg in ["FR", "FL", "RR", "RL"] {
        pose.insert(format!("{leg}_thigh_joint"), json!(0.8));
        pose.insert(format!("{leg}_calf_joint"), json!(-1.6));
        for joint in ["hip", "thigh", "calf"] {
            let servo = json!({"servo": {"target": 0, "stiffness": 400, "damping": 8}});
            motors.insert(format!("{leg}_{joint}_joint"), servo);
        }
    }
    pose.insert("trunk".to_owned(), json!({"position": [0, 0, 0.32]}));
    let scene = &mut document["problem"]["rigid_bodies"];
    scene["robot"]["pose"] = Value::Object(pose);
    scene["robot"]["motors"] = Value::Object(motors);
    scene["bodies"] = json!([{"name": "floor", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true}]);
    scene["contacts"] = json!({"friction": 0.8});
    let solution = solve(&document);
    let z = last(&solution, "trunk.z");
    assert!((0.2..0.32).contains(&z), "{z}");
    let (x, y) = (last(&solution, "trunk.x"), last(&solution, "trunk.y"));
    assert!(x.hypot(y) < 0.05, "{x}, {y}");
    assert!(column(&solution, "trunk.z").windows(2).rev().take(50).all(|pair| (pair[0] - pair[1]).abs() < 1e-3));
}

#[test]
fn an_ant_lands_on_its_floor() {
    let pose = json!({"ankle_1": 1.0, "ankle_2": -1.0, "ankle_3": -1.0, "ankle_4": 1.0});
    let solution = solve(&specification("ant", pose, 1.0, 2e-3));
    let z = last(&solution, "torso.z");
    assert!((0.25..0.75).contains(&z), "{z}");
}
