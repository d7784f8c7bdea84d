//! Scenes of rigid bodies that are not right: each fault at its place.

use crate::documents::*;
use dvi::problem::Control;
use dvi::solution::Status;
use dvi::specification::Specification;
use serde_json::{Value, json};

const BODIES: &str = "/problem/rigid_bodies/bodies";

fn scene() -> Value {
    json!({"problem": {"rigid_bodies": {
            "gravity": [0, 0, -9.81],
            "materials": {"steel": {"friction": 0.3}, "ice": {"friction": 0.02, "restitution": 0.1}},
            "bodies": [
                {"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true, "material": "ice"},
                {"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 1], "material": "steel"},
                {"name": "box", "shape": {"box": {"size": [1, 1, 1]}}, "density": 500, "position": [3, 0, 0.5]}
            ],
            "contacts": {"friction": 0.5, "pairs": [{"materials": ["steel", "ice"], "friction": 0.05}]},
            "joints": [{"hinge": {"bodies": ["box"], "at": [3, 0, 0.5], "axis": [0, 0, 1]}}]}},
        "time": {"end": 0.1}, "method": {"step": 0.001}})
}

fn body(key: &str, value: Value) -> Value {
    let mut document = scene();
    document["problem"]["rigid_bodies"]["bodies"][1][key] = value;
    document
}

fn at(key: &str) -> String {
    format!("{BODIES}/1/{key}")
}

#[test]
fn the_scene_to_break_is_right() {
    let specification = Specification::from_json(scene().to_string().as_bytes()).unwrap();
    assert!(specification.model().warnings().is_empty());
    assert_eq!(dvi::solve(&specification, &Control::new()).status, Status::Completed);
}

#[test]
fn masses_and_inertias_must_be_those_of_bodies() {
    assert_errors(&body("mass", json!(0)), &[(&at("mass"), "out_of_range", "mass")]);
    assert_errors(&body("mass", json!(-2)), &[(&at("mass"), "out_of_range", "-2")]);
    assert_errors(&body("mass", Value::Null), &[(&format!("{BODIES}/1"), "mass_or_density", "no mass")]);
    assert_errors(&body("density", json!(1)), &[(&format!("{BODIES}/1"), "mass_or_density", "both")]);
    assert_errors(&body("inertia", json!([1, 1, 3])), &[(&at("inertia"), "triangle_inequality", "3")]);
    assert_errors(&body("inertia", json!([1, 0, 1])), &[(&at("inertia/1"), "out_of_range", "inertia")]);
    Specification::from_json(body("inertia", json!([1, 1, 2])).to_string().as_bytes()).unwrap();
}

#[test]
fn shapes_must_have_a_size() {
    let shape = |shape: Value| body("shape", shape);
    assert_errors(&shape(json!({"sphere": {"radius": -1}})), &[(&at("shape/sphere/radius"), "out_of_range", "radius")]);
    assert_errors(&shape(json!({"box": {"size": [1, 0, 1]}})), &[(&at("shape/box/size/1"), "out_of_range", "side")]);
    let flat = json!({"convex_hull": {"points": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]}});
    assert_errors(&shape(flat), &[(&at("shape/convex_hull/points"), "degenerate_hull", "volume")]);
    let plane = json!({"half_space": {"normal": [0, 0, 1]}});
    assert_errors(&shape(plane), &[(&at("shape"), "must_be_fixed", "half_space")]);
    let mut document = body("fixed", json!(true));
    let mesh =
        json!({"triangle_mesh": {"vertices": [[0, 0, 0], [1, 0, 0], [2, 0, 0]], "triangles": [[0, 1, 2], [0, 1, 7]]}});
    document["problem"]["rigid_bodies"]["bodies"][1]["shape"] = mesh;
    let place = at("shape/triangle_mesh/triangles");
    assert_errors(
        &document,
        &[(&format!("{place}/0"), "degenerate_mesh", "area"), (&format!("{place}/1"), "degenerate_mesh", "7")],
    );
}

#[test]
fn names_of_bodies_and_materials_must_be_known() {
    assert_errors(&body("material", json!("stele")), &[(&at("material"), "unknown_name", "stele")]);
    assert_errors(&body("name", json!("box")), &[(&format!("{BODIES}/2/name"), "duplicate_name", "box")]);
    assert_errors(&body("name", json!("a.b")), &[(&at("name"), "malformed_name", "a.b")]);
    let joints = "/problem/rigid_bodies/joints/0/hinge";
    let document = with(scene(), &format!("{joints}/bodies"), json!(["bax"]));
    assert_errors(&document, &[(&format!("{joints}/bodies/0"), "unknown_name", "bax")]);
    let document = with(scene(), &format!("{joints}/bodies"), json!(["ground"]));
    assert_errors(&document, &[(&format!("{joints}/bodies"), "nothing_to_join", "moves")]);
    let document = with(scene(), &format!("{joints}/axis"), json!([0, 0, 0]));
    assert_errors(&document, &[(&format!("{joints}/axis"), "zero_direction", "direction")]);
}

#[test]
fn coefficients_have_their_ranges() {
    let contacts = "/problem/rigid_bodies/contacts";
    let document = with(scene(), &format!("{contacts}/friction"), json!(-0.1));
    assert_errors(&document, &[(&format!("{contacts}/friction"), "out_of_range", "friction")]);
    let document = with(scene(), "/problem/rigid_bodies/materials/ice/restitution", json!(1.5));
    assert_errors(&document, &[("/problem/rigid_bodies/materials/ice/restitution", "out_of_range", "restitution")]);
}

#[test]
fn a_quaternion_is_scaled_with_a_warning_and_none_is_refused() {
    let document = body("orientation", json!([2, 0, 0, 0]));
    let specification = Specification::from_json(document.to_string().as_bytes()).unwrap();
    assert_eq!(specification.model().warnings()[0].code, "quaternion_normalised");
    assert_errors(&body("orientation", json!([0, 0, 0, 0])), &[(&at("orientation"), "zero_quaternion", "direction")]);
}

#[test]
fn bodies_that_overlap_are_refused_by_name_or_moved_apart_as_asked() {
    let mut document = body("position", json!([3.2, 0.1, 1.05]));
    let place = format!("{BODIES}/2/position");
    assert_errors(&document, &[(&place, "interpenetration", "`ball` and `box` overlap by")]);
    document["problem"]["rigid_bodies"]["interpenetration"] = json!("resolve");
    let specification = Specification::from_json(document.to_string().as_bytes()).unwrap();
    let solution = dvi::solve(&specification, &Control::new());
    assert_eq!(solution.status, Status::Completed, "{:?}", solution.error);
    let field = |name: &str| solution.trajectory.field(name).unwrap();
    // The box is hinged about z and stands on the ground: the ball gives way, and no speed comes of it.
    assert!((field("ball.z")[0] - 1.1).abs() < 1e-6, "{}", field("ball.z")[0]);
    assert!(field("kinetic_energy").iter().all(|energy| *energy < 1e-3));
}

#[test]
fn velocities_that_tear_a_joint_at_the_start_are_refused_at_the_joint() {
    let spin = |about: [f64; 3], velocity: [f64; 3], joint: Value| {
        let mut document = scene();
        document["problem"]["rigid_bodies"]["bodies"][2]["angular_velocity"] = json!(about);
        document["problem"]["rigid_bodies"]["bodies"][2]["velocity"] = json!(velocity);
        document["problem"]["rigid_bodies"]["joints"] = json!([joint]);
        document
    };
    let on = |at: [f64; 3]| json!({"bodies": ["box"], "at": at, "axis": [0, 0, 1]});
    let hinge = json!({"hinge": on([3.0, 0.0, 0.5])});
    let place = "/problem/rigid_bodies/joints/0";
    let torn = |kind: &str| format!("{place}/{kind}");
    Specification::from_json(spin([0.0, 0.0, 2.0], [0.0; 3], hinge.clone()).to_string().as_bytes()).unwrap();
    let document = spin([0.0, 1.5, 2.0], [0.0; 3], hinge);
    assert_errors(&document, &[(&torn("hinge"), "interpenetration", "1.5 rad/s")]);
    // About an axis 2 m away the centre must go at w x r.
    let aside = || json!({"hinge": on([1.0, 0.0, 0.5])});
    Specification::from_json(spin([0.0, 0.0, 2.0], [0.0, 4.0, 0.0], aside()).to_string().as_bytes()).unwrap();
    let document = spin([0.0, 0.0, 2.0], [0.0; 3], aside());
    assert_errors(&document, &[(&torn("hinge"), "interpenetration", "4 m/s")]);
    let document = spin([0.0; 3], [1.0, 0.0, 3.0], json!({"slider": on([3.0, 0.0, 0.5])}));
    assert_errors(&document, &[(&torn("slider"), "interpenetration", "1 m/s")]);
    let document = spin([0.0; 3], [0.0, 0.0, 3.0], json!({"fixed": {"bodies": ["ball", "box"]}}));
    assert_errors(&document, &[(&torn("fixed"), "interpenetration", "3 m/s")]);
}

#[test]
fn what_the_stepper_of_bodies_does_not_use_is_refused_where_it_is_written() {
    let cases = [
        ("rtol", json!(1e-10), "no error is measured"),
        ("atol", json!(1e-9), "no error is measured"),
        ("stages", json!(5), "no stages"),
        ("switches", json!("step_over"), "steps of one size"),
        ("vi_solver", json!("lemke"), "solvers of its own"),
        ("accept_index_three", json!(true), "index three"),
    ];
    for (key, value, detail) in cases {
        let mut document = scene();
        document["method"][key] = value;
        assert_errors(&document, &[(&format!("/method/{key}"), "conflict", detail)]);
    }
    for key in ["first_step", "max_step", "min_step"] {
        let document = with(scene(), "/method", json!({ key: 1e-3 }));
        assert_errors(&document, &[(&format!("/method/{key}"), "conflict", "no error is measured")]);
    }
    Specification::from_json(with(scene(), "/method", json!({"name": "contact"})).to_string().as_bytes()).unwrap();
}

#[test]
fn too_many_bodies_are_refused_before_they_are_looked_at() {
    let ball = json!({"shape": {"sphere": {"radius": 0.1}}, "mass": 1});
    let document = with(scene(), BODIES, Value::Array(vec![ball; 100_001]));
    assert_errors(&document, &[(BODIES, "too_many_bodies", "100001")]);
}
