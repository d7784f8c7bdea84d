//! Error messages for invalid mechanical systems, and for inadmissible initial states.

use crate::documents::*;
use dvi::problem::{Control, Mechanical};
use dvi::solution::Status;
use dvi::specification::Specification;
use nalgebra::DMatrix;
use serde_json::{Value, json};

const AT: &str = "/problem/mechanical";

/// A valid specification of a mechanical system: a block on a floor, with a string to a wall.
fn block_on_floor() -> Value {
    json!({"problem": {"mechanical": {
        "parameters": {"m": 2},
        "coordinates": {"x": {"initial": 3, "velocity": 0}, "y": {"initial": 1}},
        "mass": [["m", 0], [0, "m"]], "potential": "9.81*m*y", "forces": {"x": "-0.1*x_dot"},
        "contacts": [{"name": "floor", "gap": "y", "restitution": 0.5,
                      "friction": {"coefficient": 0.3, "slip": ["x_dot"]}}],
        "joints": [{"name": "string", "constraint": "x^2 + y^2 - 10"}]}},
        "time": {"end": 1}})
}

fn refused(key: &str, value: Value, expected: &[(&str, &str, &str)]) {
    let expected: Vec<(String, &str, &str)> =
        expected.iter().map(|&(pointer, code, part)| (format!("{AT}/{pointer}"), code, part)).collect();
    let expected: Vec<(&str, &str, &str)> =
        expected.iter().map(|(pointer, code, part)| (pointer.as_str(), *code, *part)).collect();
    assert_errors(&with(block_on_floor(), &format!("{AT}/{key}"), value), &expected);
}

#[test]
fn the_system_to_break_is_right() {
    Specification::from_json(block_on_floor().to_string().as_bytes()).unwrap();
}

#[test]
fn derivatives_of_a_start_that_is_found_are_refused_once() {
    let mut problem = json!({"problem": {"mechanical": {
        "parameters": {"h": 1, "g": 9.81, "e": 0.6}, "coordinates": {"y": {"initial": "h"}}, "mass": [[1]],
        "potential": "g*y", "contacts": [{"name": "floor", "gap": "y", "restitution": "e"}],
        "interpenetration": "resolve"}},
        "time": {"end": 1}, "method": {"impacts": "locate"}, "sensitivities": {"to": ["h", "g", "e"]}});
    assert_errors(&problem, &[("/sensitivities/to", "conflict", "the start is found by moving bodies apart")]);
    problem["sensitivities"] = json!({"to": ["y.initial"]});
    Specification::from_json(problem.to_string().as_bytes()).unwrap();
}

#[test]
fn a_mass_that_is_none_is_refused() {
    for mass in [json!(0), json!(-1)] {
        refused("parameters/m", mass, &[("mass", "mass_not_positive", "entry (0, 0)")]);
    }
    refused("mass", json!([[1, 2], [2, 1]]), &[("mass", "mass_not_positive", "not positive definite")]);
    refused("mass", json!([[1, 0.5], [0, 1]]), &[("mass", "mass_not_symmetric", "(0, 1) and (1, 0)")]);
    refused("mass", json!([["x_dot", 0], [0, 1]]), &[("mass/0", "depends_on_velocity", "mass matrix")]);
    refused("mass", json!([[1, 0]]), &[("mass", "wrong_shape", "expected 2 rows")]);
}

#[test]
fn gaps_and_joints_need_a_direction_and_no_velocities() {
    refused("contacts/0/gap", json!("1 + t"), &[("contacts/0/gap", "zero_gradient", "")]);
    refused("contacts/0/gap", json!("(x - 3)^2 + 1"), &[("contacts/0/gap", "zero_gradient", "at the start")]);
    refused("contacts/0/gap", json!("y + x_dot"), &[("contacts/0/gap", "depends_on_velocity", "a gap")]);
    refused("joints/0/constraint", json!("y_dot"), &[("joints/0/constraint", "depends_on_velocity", "a joint")]);
    refused("contacts/0/gap", json!("ln(-y)"), &[("contacts/0/gap", "outside_domain", "NaN")]);
}

#[test]
fn slips_are_linear_in_the_velocities() {
    let slip = "contacts/0/friction/slip";
    for law in ["x_dot^2", "sin(x_dot)", "x_dot*y_dot", "x"] {
        refused(slip, json!([law]), &[("contacts/0/friction/slip/0", "slip_not_linear", "")]);
    }
    refused(slip, json!(["x_dot", "y_dot", "x_dot"]), &[(slip, "wrong_shape", "3 slip velocities")]);
    Specification::from_json(
        with(block_on_floor(), &format!("{AT}/{slip}"), json!(["x_dot*y - sin(t)"])).to_string().as_bytes(),
    )
    .unwrap();
}

#[test]
fn coefficients_names_and_cones_are_in_their_ranges() {
    let friction = "contacts/0/friction";
    refused("contacts/0/restitution", json!(1.5), &[("contacts/0/restitution", "out_of_range", "1.5")]);
    refused("contacts/0/friction/coefficient", json!(-0.1), &[("contacts/0/friction/coefficient", "out_of_range", "")]);
    let of =
        |cone: &str, facets: u64| json!({"coefficient": 1, "slip": ["x_dot", "y_dot"], "cone": cone, "facets": facets});
    refused(friction, of("quadratic", 8), &[("contacts/0/friction/facets", "out_of_range", "quadratic")]);
    refused(friction, of("polyhedral", 3), &[("contacts/0/friction/facets", "out_of_range", "3 corners")]);
    refused("joints/0/name", json!("9"), &[("joints/0/name", "contact_name", "")]);
    refused("contacts/0/name", json!("string"), &[("contacts/0/name", "contact_name", "in use")]);
    let document = with(block_on_floor(), &format!("{AT}/forces"), json!({"xx": 1}));
    assert_suggestion(&document, &format!("{AT}/forces/xx"), "unknown_name", "x");
    let document = with(block_on_floor(), &format!("{AT}/coordinates/x_dot"), json!({"initial": 0}));
    assert!(errors_of(document.to_string()).iter().any(|error| error.code == "duplicate_name"));
}

#[test]
fn coefficients_that_vary_and_ellipses_of_friction_say_what_cannot_be() {
    let place = "contacts/0/friction/coefficient";
    for law in ["0.2 + 0.1*exp(-slip_speed)", "0.1*(1 + x^2)", "0.3 + 0.1*sin(t)", "0.1 + 0.1*abs(x_dot)"] {
        let document = with(block_on_floor(), &format!("{AT}/{place}"), json!(law));
        Specification::from_json(document.to_string().as_bytes()).unwrap_or_else(|errors| panic!("{law}: {errors:#?}"));
    }
    refused(place, json!("0.3 - x"), &[(place, "out_of_range", "-2.7 at the start")]);
    refused(place, json!("ln(-y)"), &[(place, "out_of_range", "NaN")]);
    refused(place, json!("0.3*slip_sped"), &[(place, "unknown_name", "slip_sped")]);
    // `slip_speed` is a predefined name in friction coefficients only; a parameter with this name takes precedence.
    refused("potential", json!("slip_speed"), &[("potential", "unknown_name", "slip_speed")]);
    let document = with(block_on_floor(), &format!("{AT}/parameters/slip_speed"), json!(0.4));
    let document = with(document, &format!("{AT}/{place}"), json!("slip_speed"));
    Specification::from_json(document.to_string().as_bytes()).unwrap();
    let ratio = "contacts/0/friction/ratio";
    refused(ratio, json!(0.5), &[(ratio, "conflict", "one slip")]);
    let slips = with(block_on_floor(), &format!("{AT}/contacts/0/friction/slip"), json!(["x_dot", "2*x_dot"]));
    let bad = with(slips.clone(), &format!("{AT}/{ratio}"), json!(0));
    assert_errors(&bad, &[(&format!("{AT}/{ratio}"), "out_of_range", "ratio of 0")]);
    let right = with(slips, &format!("{AT}/{ratio}"), json!("m/4"));
    Specification::from_json(right.to_string().as_bytes()).unwrap();
}

#[test]
fn an_overlapping_start_is_refused_or_resolved_as_asked() {
    refused(
        "coordinates/y/initial",
        json!(-0.5),
        &[
            ("joints/0/constraint", "interpenetration", "violated by"),
            ("contacts/0/gap", "interpenetration", "`floor` overlaps by 0.5"),
        ],
    );
    refused("coordinates/x/velocity", json!(1), &[("joints/0/constraint", "interpenetration", "violated in velocity")]);
    let document = with(block_on_floor(), &format!("{AT}/coordinates/y/initial"), json!(-0.5));
    let document = with(document, &format!("{AT}/coordinates/x/velocity"), json!(1));
    let document = with(document, &format!("{AT}/interpenetration"), json!("resolve"));
    let specification = Specification::from_json(document.to_string().as_bytes()).unwrap();
    let [x, y, x_dot, y_dot] = specification.model().initial()[..] else { panic!("two coordinates") };
    assert!((x * x + y * y - 10.0).abs() < 1e-12 && y >= -1e-12, "{x} {y}");
    assert!((x * x_dot + y * y_dot).abs() < 1e-12);
    let solution = dvi::solve(&specification, &Control::new());
    assert_eq!(solution.status, Status::Completed);
    // The block may gain kinetic energy by its fall from the initial position, but not by the correction of that
    // position.
    let kinetic = solution.trajectory.field("kinetic_energy").unwrap();
    assert!(kinetic.iter().all(|kinetic| *kinetic < 1.0), "an explosion");
}

#[test]
fn methods_are_for_the_problems_they_fit() {
    let document = with(block_on_floor(), "/method", json!({"name": "radau"}));
    assert_errors(&document, &[("/method/name", "conflict", "does not treat impacts")]);
    let document = with(block(), "/method", json!({"name": "contact"}));
    assert_errors(&document, &[("/method/name", "conflict", "no contacts")]);
    let document = with(block(), "/method", json!({"impacts": "locate"}));
    assert_errors(&document, &[("/method/impacts", "conflict", "only mechanical systems")]);
    let document = with(block_on_floor(), "/output", json!({"global_error": true}));
    assert_errors(&document, &[("/output/global_error", "conflict", "impacts")]);
}

/// The double pendulum in angles, whose mass matrix depends on the angles: the forces `f` agree with the textbook.
#[test]
fn coriolis_forces_are_those_of_the_textbook() {
    let document = json!({"problem": {"mechanical": {
        "coordinates": {"a": {"initial": 0.3, "velocity": 1.1}, "b": {"initial": -0.7, "velocity": 2.3}},
        "mass": [[2, "cos(a - b)"], ["cos(a - b)", 1]], "potential": "-9.81*(2*cos(a) + cos(b))"}},
        "time": {"end": 1}});
    let specification = Specification::from_json(document.to_string().as_bytes()).unwrap();
    let model: &dyn std::any::Any = specification.model();
    let model: &dvi::models::MechanicalModel = model.downcast_ref().expect("a mechanical system");
    let mut problem: Box<dyn Mechanical> = model.problem();
    let (a, b, a_dot, b_dot) = (0.3_f64, -0.7_f64, 1.1_f64, 2.3_f64);
    let mut f = [0.0; 2];
    problem.forces(0.0, &[a, b], &[a_dot, b_dot], &mut f);
    let s = (a - b).sin();
    let expected = [-s * b_dot * b_dot - 19.62 * a.sin(), s * a_dot * a_dot - 9.81 * b.sin()];
    assert!((f[0] - expected[0]).abs() < 1e-13 && (f[1] - expected[1]).abs() < 1e-13, "{f:?} {expected:?}");
    // The derivatives of the forces agree with difference quotients.
    let (mut by_q, mut by_v) = (DMatrix::zeros(2, 2), DMatrix::zeros(2, 2));
    problem.stiffness(0.0, &[a, b], &[a_dot, b_dot], &mut by_q, &mut by_v);
    let h = 1e-6;
    for j in 0..2 {
        let mut at = |q: [f64; 2], v: [f64; 2]| {
            let mut f = [0.0; 2];
            problem.forces(0.0, &q, &v, &mut f);
            f
        };
        let moved = |x: [f64; 2], by: f64| if j == 0 { [x[0] + by, x[1]] } else { [x[0], x[1] + by] };
        let (q, v) = ([a, b], [a_dot, b_dot]);
        let (up, down) = (at(moved(q, h), v), at(moved(q, -h), v));
        let (faster, slower) = (at(q, moved(v, h)), at(q, moved(v, -h)));
        for i in 0..2 {
            assert!((by_q[(i, j)] - (up[i] - down[i]) / (2.0 * h)).abs() < 1e-7);
            assert!((by_v[(i, j)] - (faster[i] - slower[i]) / (2.0 * h)).abs() < 1e-7);
        }
    }
}

#[test]
fn a_polyhedral_cone_is_refused_where_impacts_are_located() {
    let friction = json!({"coefficient": 1, "slip": ["x_dot", "y_dot"], "cone": "polyhedral", "facets": 4});
    let document = json!({"problem": {"mechanical": {
        "coordinates": {"x": {"initial": 0, "velocity": 1}, "y": {"initial": 0}, "z": {"initial": 0}},
        "mass": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "potential": "9.81*z",
        "contacts": [{"name": "plane", "gap": "z", "friction": friction}]}},
        "time": {"end": 1}});
    let cone = format!("{AT}/contacts/0/friction/cone");
    assert_errors(&document, &[(cone.as_str(), "conflict", "disk")]);
    let stepped = with(document, "/method", json!({"step": 0.01}));
    Specification::from_json(stepped.to_string().as_bytes()).unwrap();
}

#[test]
fn stages_are_refused_where_time_stepping_is_asked_for() {
    let staged = with(block_on_floor(), "/method", json!({"step": 0.01, "impacts": "time_stepping", "stages": 3}));
    assert_errors(&staged, &[("/method/stages", "conflict", "stages")]);
}

/// Varying friction, and parameters whose values determine the form of the equations, have no derivatives: a solve
/// must be refused, since the computed derivatives would be zero or NaN.
#[test]
fn derivatives_are_refused_where_the_equations_do_not_show_them() {
    let document = |friction: Value, to: &str| {
        json!({"problem": {"mechanical": {
            "parameters": {"mu": 0.3, "r": 0.5, "none": 0},
            "coordinates": {"x": {"initial": 0, "velocity": 1}, "y": {"initial": 0}, "z": {"initial": 0}},
            "mass": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "potential": "9.81*z",
            "contacts": [{"name": "plane", "gap": "z", "friction": friction}]}},
            "time": {"end": 1}, "method": {"impacts": "locate"}, "sensitivities": {"to": [to]}})
    };
    let slips = |coefficient: &str| json!({"coefficient": coefficient, "ratio": "r", "slip": ["x_dot", "y_dot"]});
    Specification::from_json(document(slips("mu"), "mu").to_string().as_bytes()).unwrap();
    assert_errors(&document(slips("mu"), "r"), &[("/sensitivities/to/0", "conflict", "`r` decides the structure")]);
    let zero = document(json!({"coefficient": "none", "slip": ["x_dot", "y_dot"]}), "none");
    assert_errors(&zero, &[("/sensitivities/to/0", "conflict", "`none` decides the structure")]);
    let varying = document(slips("mu/(1 + slip_speed)"), "mu");
    assert_errors(&varying, &[("/sensitivities", "conflict", "the coefficient of friction of `plane` varies")]);
}
