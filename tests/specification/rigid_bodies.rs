//! Error messages for faulty rigid-body problems, each with the JSON pointer of the fault.

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
    assert_errors(
        &body("orientation", json!([0, 0, 0, 0])),
        &[(&at("orientation"), "zero_quaternion", "zero or not finite")],
    );
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
    // The initially overlapping ball and box are moved apart: since the box is hinged about z and stands on the ground,
    // only the ball is moved, without gaining velocity.
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
    // For a box that rotates with the angular velocity w about a hinge axis at the distance r = 2 m, the specified
    // velocity of the centre must be w x r.
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
fn impacts_are_located_where_that_is_possible_and_the_answer_says_what_else_there_is() {
    let mut document = scene();
    document["problem"]["rigid_bodies"].as_object_mut().unwrap().remove("joints");
    let steppers = |document: &Value| {
        let specification = Specification::from_json(document.to_string().as_bytes()).unwrap();
        let described = dvi::solve(&specification, &Control::new()).diagnostics;
        (described.built[0], described.left_out.iter().any(|line| line.starts_with("location of impacts: ")))
    };
    // A box has edges: its impacts are not located in time, and the method is time stepping.
    assert_eq!(steppers(&document), ("time stepping", true));
    document["problem"]["rigid_bodies"]["bodies"][2]["shape"] = json!({"sphere": {"radius": 0.5}});
    for (impacts, expected) in [
        (Value::Null, ("location of impacts", false)),
        (json!("locate"), ("location of impacts", false)),
        (json!("time_stepping"), ("time stepping", true)),
    ] {
        document["method"]["impacts"] = impacts;
        assert_eq!(steppers(&document), expected);
    }
    document["method"]["impacts"] = json!("locate");
    let joint = json!([{"hinge": {"bodies": ["box"], "at": [3, 0, 0.5], "axis": [0, 0, 1]}}]);
    document["problem"]["rigid_bodies"]["joints"] = joint;
    assert_errors(&document, &[("/method/impacts", "conflict", "joints")]);
}

#[test]
fn what_the_stepper_of_bodies_does_not_use_is_refused_where_it_is_written() {
    let cases = [
        ("rtol", json!(1e-10), "without an error estimate"),
        ("atol", json!(1e-9), "without an error estimate"),
        ("stages", json!(5), "no stages"),
        ("switches", json!("step_over"), "step over all events"),
        ("vi_solver", json!("lemke"), "its own solvers"),
        ("accept_index_three", json!(true), "index three"),
    ];
    for (key, value, detail) in cases {
        let mut document = scene();
        document["method"][key] = value;
        assert_errors(&document, &[(&format!("/method/{key}"), "conflict", detail)]);
    }
    for key in ["first_step", "max_step", "min_step"] {
        let document = with(scene(), "/method", json!({ key: 1e-3 }));
        assert_errors(&document, &[(&format!("/method/{key}"), "conflict", "without an error estimate")]);
    }
    Specification::from_json(with(scene(), "/method", json!({"name": "contact"})).to_string().as_bytes()).unwrap();
}

#[test]
fn too_many_bodies_are_refused_before_they_are_looked_at() {
    let ball = json!({"shape": {"sphere": {"radius": 0.1}}, "mass": 1});
    let document = with(scene(), BODIES, Value::Array(vec![ball; 100_001]));
    assert_errors(&document, &[(BODIES, "too_many_bodies", "100001")]);
}

const PROBLEM: &str = "/problem/rigid_bodies";

/// Returns the scene of rigid bodies with one hinge that has these members.
fn hinged(members: &Value) -> Value {
    let mut hinge = json!({"bodies": ["box"], "at": [3, 0, 0.5], "axis": [0, 0, 1]});
    hinge.as_object_mut().unwrap().extend(members.as_object().unwrap().clone());
    with(scene(), &format!("{PROBLEM}/joints"), json!([{"hinge": hinge}]))
}

#[test]
fn motors_springs_and_limits_say_what_cannot_be() {
    let hinge = format!("{PROBLEM}/joints/0/hinge");
    let refused = |members: Value, key: &str, code: &str, words: &str| {
        assert_errors(&hinged(&members), &[(&format!("{hinge}/{key}"), code, words)]);
    };
    refused(json!({"motor": {"position": "1 + t"}}), "motor/position", "inconsistent_start", "1 at the start");
    refused(json!({"motor": {"position": "2*t"}}), "motor", "inconsistent_start", "rate of 2");
    refused(json!({"motor": {"velocity": "ball.x"}}), "motor/velocity", "depends_on_state", "the motion of bodies");
    refused(json!({"motor": {"effort": "1/t"}}), "motor/effort", "outside_domain", "not finite");
    refused(json!({"motor": {"servo": {"target": 1}}}), "motor/servo", "empty", "stiffness");
    refused(
        json!({"motor": {"servo": {"target": 1, "stiffness": 1, "largest_effort": 0}}}),
        "motor/servo/largest_effort",
        "out_of_range",
        "largest effort",
    );
    refused(json!({"motor": {"position": "0*t"}, "limits": {"upper": 1}}), "motor/position", "conflict", "limits");
    refused(json!({"spring": {"stiffness": -1}}), "spring/stiffness", "out_of_range", "-1");
    refused(json!({"spring": {}}), "spring", "empty", "damping");
    refused(json!({"limits": {}}), "limits", "empty", "limit");
    refused(json!({"limits": {"lower": 0.1}}), "limits/lower", "out_of_range", "0.1");
    refused(json!({"limits": {"lower": 0, "upper": 0}}), "limits", "out_of_range", "0");
    // An initial angle or velocity of the hinge's motor that differs from that of the hinge by rounding errors only is
    // accepted.
    let document = hinged(&json!({"motor": {"position": "6*(t + 0.1*(exp(-10*t) - 1))"}}));
    Specification::from_json(document.to_string().as_bytes()).unwrap();
}

#[test]
fn forces_and_springs_act_on_bodies_that_move() {
    let forces = |force: Value| with(scene(), &format!("{PROBLEM}/forces"), json!([force]));
    let place = format!("{PROBLEM}/forces/0");
    let refused = |force: Value, key: &str, code: &str, words: &str| {
        assert_errors(&forces(force), &[(&format!("{place}{key}"), code, words)]);
    };
    refused(json!({"body": "bal", "force": [0, 0, 1]}), "/body", "unknown_name", "bal");
    refused(json!({"body": "ground", "force": [0, 0, 1]}), "/body", "conflict", "ground");
    refused(json!({"body": "ball"}), "", "empty", "force");
    refused(json!({"body": "ball", "force": ["boll.x", 0, 0]}), "/force/0", "unknown_name", "boll.x");
    refused(json!({"body": "ball", "force": ["1/ball.x", 0, 0]}), "", "outside_domain", "not finite");
    let springs = |spring: Value| with(scene(), &format!("{PROBLEM}/springs"), json!([spring]));
    let place = format!("{PROBLEM}/springs/0");
    let spring = |members: Value| {
        let mut spring = json!({"bodies": ["ball"], "at": [[0, 0, 1], [0, 0, 2]], "stiffness": 10});
        spring.as_object_mut().unwrap().extend(members.as_object().unwrap().clone());
        springs(spring)
    };
    assert_errors(
        &spring(json!({"at": [[0, 0, 1], [0, 0, 1]]})),
        &[(&format!("{place}/at"), "zero_direction", "points")],
    );
    assert_errors(
        &spring(json!({"rest_length": 0})),
        &[(&format!("{place}/rest_length"), "out_of_range", "rest length")],
    );
    assert_errors(&spring(json!({"bodies": ["ground"]})), &[(&format!("{place}/bodies"), "nothing_to_join", "moves")]);
    assert_errors(&spring(json!({"name": "ball"})), &[(&format!("{place}/name"), "duplicate_name", "ball")]);
}

#[test]
fn bushings_say_what_is_wrong_with_them() {
    let place = format!("{PROBLEM}/bushings/0");
    let bushing = |members: Value| {
        let mut bushing = json!({"bodies": ["ball"], "at": [0, 0, 1]});
        bushing.as_object_mut().unwrap().extend(members.as_object().unwrap().clone());
        with(scene(), &format!("{PROBLEM}/bushings"), json!([bushing]))
    };
    assert_errors(&bushing(json!({})), &[(&place, "empty", "neither stiffness nor damping")]);
    assert_errors(&bushing(json!({"stiffness": [0, 0, 0]})), &[(&place, "empty", "neither stiffness nor damping")]);
    assert_errors(
        &bushing(json!({"stiffness": [1, -2, 0]})),
        &[(&format!("{place}/stiffness/1"), "out_of_range", "stiffness")],
    );
    assert_errors(
        &bushing(json!({"rotational_damping": [1, 0, "-1"]})),
        &[(&format!("{place}/rotational_damping/2"), "out_of_range", "rotational damping")],
    );
    assert_errors(
        &bushing(json!({"stiffness": [1, 1, 1], "bodies": ["ground"]})),
        &[(&format!("{place}/bodies"), "nothing_to_join", "moves")],
    );
    assert_errors(
        &bushing(json!({"stiffness": [1, 1, 1], "orientation": [0, 0, 0, 0]})),
        &[(&format!("{place}/orientation"), "zero_quaternion", "quaternion is zero")],
    );
    let document = bushing(json!({"stiffness": [1, 1, 1], "rotational_stiffness": [1, 1, 1], "name": "mount"}));
    Specification::from_json(document.to_string().as_bytes()).unwrap();
}

#[test]
fn motions_parts_and_groups_say_what_cannot_be() {
    let bodies = |k: usize, key: &str, value: Value| with(scene(), &format!("{BODIES}/{k}/{key}"), value);
    let at = |k: usize, key: &str| format!("{BODIES}/{k}/{key}");
    let moved = json!({"position": ["t", 0, 1]});
    let mut document = bodies(1, "motion", moved);
    // A body with a prescribed motion must have neither a position nor a mass.
    assert_errors(&document, &[(&at(1, "motion"), "conflict", "position"), (&at(1, "motion"), "conflict", "mass")]);
    let ball = document["problem"]["rigid_bodies"]["bodies"][1].as_object_mut().unwrap();
    ball.remove("mass");
    ball.remove("position");
    Specification::from_json(document.to_string().as_bytes()).unwrap();
    document["problem"]["rigid_bodies"]["joints"] = json!([{"ball": {"bodies": ["box", "ball"], "at": [0, 0, 1]}}]);
    // The ball moves at a prescribed 1 m/s while the box is at rest, so that a joint between them is violated.
    assert_errors(&document, &[(&format!("{PROBLEM}/joints/0/ball"), "interpenetration", "violated in velocity")]);
    document["problem"]["rigid_bodies"]["joints"] = json!([{"ball": {"bodies": ["ball"], "at": [0, 0, 1]}}]);
    assert_errors(&document, &[(&format!("{PROBLEM}/joints/0/ball/bodies"), "nothing_to_join", "mass")]);
    document["problem"]["rigid_bodies"]["joints"] = json!([]);
    let turned = json!({"position": ["t", 0, 1], "rotation": [0, 0, "t"], "angular_velocity": [0, 0, 1]});
    document["problem"]["rigid_bodies"]["bodies"][1]["motion"] = turned;
    assert_errors(&document, &[(&at(1, "motion"), "conflict", "`rotation` and `angular_velocity`")]);
    document["problem"]["rigid_bodies"]["bodies"][1]["motion"] = json!({"rotation": [0, 0, "1/t"]});
    assert_errors(&document, &[(&at(1, "motion/rotation/2"), "outside_domain", "not finite")]);
    assert_errors(&bodies(0, "motion", json!({})), &[(&at(0, "motion"), "conflict", "fixed")]);
    let compound = |parts: Value| bodies(1, "shape", json!({"compound": parts}));
    assert_errors(&compound(json!([])), &[(&at(1, "shape/compound"), "wrong_count", "0 shapes")]);
    let nested = json!([{"shape": {"compound": [{"shape": {"sphere": {"radius": 1}}}]}}]);
    assert_errors(&compound(nested), &[(&at(1, "shape/compound/0/shape"), "conflict", "compound")]);
    let plane = json!([{"shape": {"half_space": {"normal": [0, 0, 1]}}}]);
    assert_errors(&compound(plane), &[(&at(1, "shape"), "must_be_fixed", "half_space")]);
    assert_errors(
        &bodies(1, "centre_of_mass", json!([0, 0, 0.1])),
        &[(&at(1, "centre_of_mass"), "conflict", "inertia")],
    );
    let matrix = |rows: Value| bodies(1, "inertia", rows);
    let skew = json!([[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]);
    assert_errors(&matrix(skew), &[(&at(1, "inertia"), "mass_not_symmetric", "0.1")]);
    let negative = json!([[1, 2, 0], [2, 1, 0], [0, 0, 1]]);
    assert_errors(&matrix(negative), &[(&at(1, "inertia"), "out_of_range", "-1")]);
    let thin = json!([[1, 0, 0], [0, 1, 0], [0, 0, 3]]);
    assert_errors(&matrix(thin), &[(&at(1, "inertia"), "triangle_inequality", "3")]);
    let exclude = with(scene(), &format!("{PROBLEM}/contacts/exclude"), json!([["arm", "arm"]]));
    assert_errors(
        &exclude,
        &[
            (&format!("{PROBLEM}/contacts/exclude/0/0"), "unknown_name", "arm"),
            (&format!("{PROBLEM}/contacts/exclude/0/1"), "unknown_name", "arm"),
        ],
    );
}

#[test]
fn friction_is_told_what_it_may_depend_on_and_where_directions_fit() {
    let contacts = |key: &str, value: Value| with(scene(), &format!("{PROBLEM}/contacts/{key}"), value);
    let at = |key: &str| format!("{PROBLEM}/contacts/{key}");
    let accepted =
        ["0.2 + 0.1*exp(-slip_speed/0.05)", "0.1*(2 + sin(contact_x))*exp(-t)", "0.1 + contact_y^2 + contact_z^2"];
    for text in accepted {
        let text = contacts("friction", json!(text)).to_string();
        Specification::from_json(text.as_bytes()).unwrap();
    }
    assert_suggestion(&contacts("friction", json!("0.1 + slip_sped")), &at("friction"), "unknown_name", "slip_speed");
    assert_errors(&contacts("friction", json!("-0.1")), &[(&at("friction"), "out_of_range", "-0.1")]);
    assert_errors(&contacts("ratio", json!(0)), &[(&at("ratio"), "out_of_range", "0")]);
    assert_errors(&contacts("along", json!([1, 0, 0])), &[(&at("along"), "conflict", "without a `ratio`")]);
    assert_errors(&contacts("axes", json!("body")), &[(&at("axes"), "conflict", "without a `ratio`")]);
    let mut flat = contacts("ratio", json!(2));
    flat["problem"]["rigid_bodies"]["contacts"]["along"] = json!([0, 0, 0]);
    assert_errors(&flat, &[(&at("along"), "zero_direction", "no direction")]);
    flat["problem"]["rigid_bodies"]["contacts"]["along"] = json!([0, 1, 0]);
    flat["problem"]["rigid_bodies"]["contacts"]["cone"] = json!("polyhedral");
    assert_errors(&flat, &[(&at("ratio"), "conflict", "polyhedral")]);
    let mut forced = contacts("friction", json!("0.1 + ball.x^2"));
    forced["problem"]["rigid_bodies"]["forces"] = json!([{"body": "ball", "force": [0, 0, 1]}]);
    assert_errors(&forced, &[(&at("friction"), "depends_on_body", "`x` of a body")]);
}

#[test]
fn patches_have_lengths_and_no_directions() {
    let contacts = |given: Value| {
        let mut document = scene();
        for (key, value) in given.as_object().unwrap() {
            document["problem"]["rigid_bodies"]["contacts"][key] = value.clone();
        }
        document
    };
    let at = |key: &str| format!("{PROBLEM}/contacts/{key}");
    for right in [json!({"patch": 0.01, "rolling": 0}), json!({"patch": 0, "ratio": 2, "rolling": 0.001})] {
        Specification::from_json(contacts(right).to_string().as_bytes()).unwrap();
    }
    assert_errors(&contacts(json!({"patch": -0.1})), &[(&at("patch"), "out_of_range", "-0.1")]);
    assert_errors(&contacts(json!({"rolling": "0 - 1"})), &[(&at("rolling"), "out_of_range", "-1")]);
    assert_errors(&contacts(json!({"patch": 0.1, "ratio": 2})), &[(&at("patch"), "conflict", "`ratio`")]);
    let faceted = contacts(json!({"rolling": 0.1, "cone": "polyhedral"}));
    assert_errors(&faceted, &[(&at("rolling"), "conflict", "polyhedral")]);
    let mut pair = scene();
    pair["problem"]["rigid_bodies"]["contacts"]["pairs"][0]["patch"] = json!("t");
    assert_errors(&pair, &[(&at("pairs/0/patch"), "unknown_name", "t")]);
}
