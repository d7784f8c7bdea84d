//! Error messages for specifications that are well-formed JSON but meaningless: names, expressions, sets, times,
//! ranges.

use crate::documents::*;
use dvi::specification::Specification;
use serde_json::{Value, json};

const RATE: &str = "/problem/dvi/states/x/rate";

#[test]
fn the_documents_to_break_are_right() {
    for document in [block(), linear()] {
        Specification::from_json(document.to_string().as_bytes()).unwrap();
    }
}

#[test]
fn an_unknown_name_shows_its_place_and_the_nearest_name() {
    let document = with(block(), "/problem/dvi/states/v/rate", json!("-k*x - Fo/m"));
    let errors = errors_of(document.to_string());
    assert_eq!((errors.len(), errors[0].code), (1, "unknown_name"));
    assert!(errors[0].detail.ends_with("-k*x - Fo/m\n       ^"), "{}", errors[0].detail);
    let document = with(block(), RATE, json!("x + veloctiy"));
    assert_errors(&document, &[(RATE, "unknown_name", "veloctiy")]);
}

#[test]
fn a_syntax_error_in_an_expression_shows_the_place() {
    let document = with(block(), RATE, json!("v + * 2"));
    let errors = errors_of(document.to_string());
    assert_eq!((errors.len(), errors[0].pointer.as_str(), errors[0].code), (1, RATE, "syntax"));
    assert!(errors[0].detail.ends_with("v + * 2\n    ^"), "{}", errors[0].detail);
}

#[test]
fn functions_are_checked_by_name_and_number_of_arguments() {
    assert_errors(&with(block(), RATE, json!("sine(v)")), &[(RATE, "unknown_function", "sine")]);
    assert_errors(&with(block(), RATE, json!("sin(v, x)")), &[(RATE, "wrong_arity", "sin")]);
}

#[test]
fn nesting_is_bounded_without_a_hang() {
    let nested = |depth: usize| json!(format!("{}v{}", "(".repeat(depth), ")".repeat(depth)));
    dvi::specification::Specification::from_json(with(block(), RATE, nested(190)).to_string().as_bytes()).unwrap();
    for depth in [201, 300, 30_000] {
        assert_errors(&with(block(), RATE, nested(depth)), &[(RATE, "too_deep", "")]);
    }
}

#[test]
fn a_string_of_a_megabyte_is_too_long_wherever_it_stands() {
    let long = "x".repeat(1 << 20);
    assert_errors(&with(block(), RATE, json!(long)), &[(RATE, "too_long", "")]);
    assert_errors(&with(block(), "/label", json!(long)), &[("/label", "label_too_long", "1048576 characters")]);
    assert_errors(&with(block(), "/time/end", json!(long)), &[("/time/end", "wrong_type", "... (1048576 bytes)")]);
    assert_errors(
        &with(block(), "/problem/dvi/set/0/box/of", json!(["F", long])),
        &[("/problem/dvi/set/0/box/of/1", "unknown_name", "... (1048576 bytes)")],
    );
    for error in errors_of(with(block(), &format!("/{long}"), json!(1)).to_string()) {
        assert_eq!((error.code, error.did_you_mean), ("unknown_key", None));
        assert!(error.detail.len() < 200);
    }
}

#[test]
fn literals_and_letters_outside_the_language_are_refused() {
    assert_errors(&with(block(), RATE, json!("1e999*v")), &[(RATE, "number_out_of_range", "")]);
    assert_errors(&with(block(), RATE, json!("\u{3bc}*v")), &[(RATE, "not_ascii", "")]);
    assert_errors(&with(block(), RATE, json!("")), &[(RATE, "syntax", "")]);
}

#[test]
fn a_rate_must_be_affine_in_the_variables() {
    let rate = "/problem/dvi/states/v/rate";
    for law in ["-k*x - F^2", "-k*x - sin(F)", "-k*x - abs(F)", "x/F"] {
        let document = with(block(), rate, json!(law));
        assert_errors(&document, &[(rate, "rate_not_affine", "the rate of `v` is not affine in the variables")]);
    }
    let affine = with(block(), rate, json!("(-k*x - F)/m - F*x^2*sin(t)"));
    dvi::specification::Specification::from_json(affine.to_string().as_bytes()).unwrap();
}

#[test]
fn a_missing_set_is_one_error() {
    assert_errors(&without(block(), "/problem/dvi/set"), &[("/problem/dvi", "missing_key", "`set` is missing")]);
}

#[test]
fn every_variable_stands_in_exactly_one_block() {
    assert_errors(
        &with(block(), "/problem/dvi/set", json!([])),
        &[("/problem/dvi/variables/F", "variable_without_block", "`F` is in no block")],
    );
    assert_errors(
        &with(block(), "/problem/dvi/set", json!([{"free": ["F"]}, {"nonnegative": ["F"]}])),
        &[("/problem/dvi/set/1/nonnegative/0", "variable_in_two_blocks", "already, at /problem/dvi/set/0/free/0")],
    );
    assert_errors(
        &with(linear(), "/problem/lcs/set", json!([{"nonnegative": []}])),
        &[("/problem/lcs", "variable_without_block", "`z1`")],
    );
}

#[test]
fn a_block_names_variables_only() {
    let document = with(block(), "/problem/dvi/set/0/box/of", json!(["F", "x"]));
    assert_errors(&document, &[("/problem/dvi/set/0/box/of/1", "unknown_name", "`x` is not a variable")]);
    let two = json!({"force": {"inequality": "-v"}});
    let document = with(with(block(), "/problem/dvi/variables", two), "/problem/dvi/states/v/rate", json!("-force"));
    let document = with(document, "/problem/dvi/set", json!([{"free": ["force", "forse"]}]));
    assert_suggestion(&document, "/problem/dvi/set/0/free/1", "unknown_name", "force");
}

#[test]
fn bounds_depend_on_time_and_states_alone_and_are_in_order() {
    let upper = "/problem/dvi/set/0/box/upper";
    assert_errors(&with(block(), upper, json!("1 + F")), &[(upper, "bound_depends_on_variable", "")]);
    assert_errors(&with(block(), upper, json!("1/0")), &[(upper, "not_finite", "")]);
    assert_errors(
        &with(block(), upper, json!(-2)),
        &[("/problem/dvi/set/0/box", "empty_interval", "the lower bound -0.3 is above the upper bound -2")],
    );
    assert_errors(
        &with(block(), upper, json!("-x")),
        &[(upper, "empty_interval", "at the start the lower bound of `F` is -0.3, above its upper bound -1")],
    );
    assert_errors(&with(block(), upper, json!("ln(-x)")), &[(upper, "outside_domain", "NaN at t = 0, x = 1")]);
}

#[test]
fn blocks_that_bind_variables_have_the_right_sizes_and_a_point() {
    let set = "/problem/lcs/set";
    let two = || {
        let document = with(linear(), "/problem/lcs/B", json!([[0, 0], [1, 1]]));
        let document = with(document, "/problem/lcs/C", json!([[0, 1], [1, 0]]));
        with(document, "/problem/lcs/D", json!([[0, 0], [0, 0]]))
    };
    let refused = |block: Value, expected: (&str, &str, &str)| {
        let pointer = format!("{set}/0/{}", expected.0);
        assert_errors(&with(two(), set, json!([block])), &[(&pointer, expected.1, expected.2)]);
    };
    for block in [
        json!({"ball": {"of": ["z1", "z2"], "radius": "1 + x1^2"}}),
        json!({"second_order_cone": ["z2", "z1"]}),
        json!({"simplex": ["z1", "z2"]}),
        json!({"polyhedron": {"of": ["z1", "z2"], "A": [[1, 1], [-1, 0]], "b": [1, "2/3"]}}),
    ] {
        Specification::from_json(with(two(), set, json!([block])).to_string().as_bytes()).expect("a valid set");
    }
    let ball = |radius: Value| json!({"ball": {"of": ["z1", "z2"], "radius": radius}});
    for solver in ["lemke", "active_set"] {
        let mut document = with(two(), set, json!([ball(json!(1))]));
        document["method"] = json!({"vi_solver": solver});
        assert_errors(&document, &[("/method/vi_solver", "unsuitable_solver", "one for intervals")]);
    }
    refused(ball(json!(-1)), ("ball/radius", "negative_radius", "-1"));
    refused(ball(json!("-x1")), ("ball/radius", "negative_radius", "at the start this radius is -1"));
    refused(ball(json!("z1")), ("ball/radius", "bound_depends_on_variable", ""));
    refused(ball(json!("1/x2")), ("ball/radius", "outside_domain", "inf at t = 0"));
    let polyhedron = |a: Value, b: Value| json!({"polyhedron": {"of": ["z1", "z2"], "A": a, "b": b}});
    refused(polyhedron(json!([[1, 1]]), json!([1, 2])), ("polyhedron/A", "wrong_shape", "expected 2 rows, got 1"));
    refused(polyhedron(json!([[1]]), json!([1])), ("polyhedron/A/0", "wrong_shape", "expected 2 entries in this row"));
    refused(polyhedron(json!([[1, 0]]), json!(["x1"])), ("polyhedron/b/0", "unknown_name", ""));
    refused(polyhedron(json!([[1, 0], [-1, 0]]), json!([0, -1])), ("polyhedron", "empty_set", "no point"));
    let one = |block: Value| with(linear(), set, json!([block]));
    assert_errors(
        &one(json!({"second_order_cone": ["z1"]})),
        &[("/problem/lcs/set/0/second_order_cone", "too_few_members", "1 variables")],
    );
    assert_errors(
        &with(linear(), set, json!([{"nonnegative": ["z1"]}, {"simplex": []}])),
        &[("/problem/lcs/set/1/simplex", "too_few_members", "0 variables")],
    );
    assert_errors(&one(json!({"ball": {"of": ["z1"]}})), &[("/problem/lcs/set/0/ball", "missing_key", "`radius`")]);
}

#[test]
fn names_are_well_formed_and_used_once() {
    let state = json!({"initial": 0, "rate": 0});
    for (name, code) in
        [("1x", "malformed_name"), ("a b", "malformed_name"), ("", "malformed_name"), ("exp", "reserved_name")]
    {
        let pointer = format!("/problem/dvi/states/{name}");
        assert_errors(&with(block(), &pointer, state.clone()), &[(&pointer, code, "")]);
    }
    for name in ["k", "t"] {
        let pointer = format!("/problem/dvi/states/{name}");
        assert_errors(&with(block(), &pointer, state.clone()), &[(&pointer, "duplicate_name", "")]);
    }
    let document = with(linear(), "/problem/lcs/state_names", json!(["z1", "b"]));
    assert_errors(&document, &[("/problem/lcs", "duplicate_name", "`z1`")]);
}

#[test]
fn parameters_are_constants_built_on_each_other_in_any_order() {
    let text = |parameters: &str| block().to_string().replace("{\"F0\":0.3,\"k\":1,\"m\":1}", parameters);
    let k = "/problem/dvi/parameters/k";
    let good = text("{\"m\":1,\"k\":\"2*m\",\"F0\":\"k/10\"}");
    dvi::specification::Specification::from_json(good.as_bytes()).unwrap();
    let backwards = text("{\"F0\":\"k/10\",\"k\":\"2*m\",\"m\":1}");
    dvi::specification::Specification::from_json(backwards.as_bytes()).unwrap();
    let circle = text("{\"F0\":1,\"k\":\"2*m\",\"m\":\"k\"}");
    assert_text(circle, &[(k, "unknown_name", "m")]);
    assert_text(text("{\"k\":\"2*x\",\"m\":1,\"F0\":1}"), &[(k, "unknown_name", "x")]);
    assert_text(text("{\"k\":\"2*t\",\"m\":1,\"F0\":1}"), &[(k, "unknown_name", "t")]);
    assert_text(text("{\"k\":\"1/0\",\"m\":1,\"F0\":1}"), &[(k, "not_finite", "`1/0` is inf")]);
}

#[test]
fn there_is_at_least_one_state() {
    let document = json!({"problem": {"dvi": {"states": {}}}, "time": {"end": 1}});
    assert_errors(&document, &[("/problem/dvi/states", "empty_states", "")]);
    let document = json!({"problem": {"lcs": {"initial": []}}, "time": {"end": 1}});
    assert_errors(&document, &[("/problem/lcs/initial", "empty_states", "")]);
}

#[test]
fn an_initial_value_outside_the_domain_says_where() {
    let document = json!({
        "problem": {"dvi": {"states": {"x": {"initial": -1, "rate": "ln(x)"}}}}, "time": {"start": 2, "end": 3}
    });
    let detail = "the rate of `x` is NaN at t = 2, x = -1";
    assert_errors(&document, &[(RATE, "outside_domain", detail)]);
    let document = with(block(), "/problem/dvi/variables/F/inequality", json!("-v + 1/(x - 1)"));
    assert_errors(
        &document,
        &[(
            "/problem/dvi/variables/F/inequality",
            "outside_domain",
            "the inequality of `F` is inf at t = 0, v = 0, x = 1",
        )],
    );
}

#[test]
fn an_initial_value_is_a_finite_constant() {
    let initial = "/problem/dvi/states/x/initial";
    assert_errors(&with(block(), initial, json!("1/0")), &[(initial, "not_finite", "`1/0` is inf")]);
    assert_errors(&with(block(), initial, json!("v")), &[(initial, "unknown_name", "v")]);
}

#[test]
fn matrices_have_the_shape_of_their_place() {
    let matrix = |key: &str, value| with(linear(), &format!("/problem/lcs/{key}"), value);
    assert_errors(
        &matrix("A", json!([[0, 1], [-1, 0], [0, 0]])),
        &[("/problem/lcs/A", "wrong_shape", "expected 2 rows, got 3")],
    );
    assert_errors(
        &matrix("A", json!([[0, 1], [-1]])),
        &[("/problem/lcs/A/1", "wrong_shape", "expected 2 entries in this row, got 1")],
    );
    assert_errors(&matrix("B", json!([[0], [1, 2]])), &[("/problem/lcs/B/1", "wrong_shape", "got 2")]);
    assert_errors(&matrix("a", json!([1])), &[("/problem/lcs/a", "wrong_shape", "expected 2 entries, got 1")]);
    assert_errors(
        &matrix("A", json!({"shape": [2, 3], "entries": []})),
        &[("/problem/lcs/A/shape", "wrong_shape", "expected 2 x 2, got 2 x 3")],
    );
    assert_errors(
        &matrix("A", json!({"shape": [2, 2], "entries": [[0, 1, 1], [1, 2, 5]]})),
        &[("/problem/lcs/A/entries/1", "index_out_of_range", "(1, 2) is outside")],
    );
    assert_errors(&matrix("A", json!([[0, "x1"], [-1, 0]])), &[("/problem/lcs/A/0/1", "unknown_name", "x1")]);
    assert_errors(
        &with(block(), "/problem/dvi/mass", json!([[1]])),
        &[
            ("/problem/dvi/mass", "wrong_shape", "expected 2 rows, got 1"),
            ("/problem/dvi/mass/0", "wrong_shape", "expected 2 entries in this row, got 1"),
        ],
    );
}

#[test]
fn a_forcing_depends_on_time_alone() {
    let document = with(linear(), "/problem/lcs/a/1", json!("sin(t) + x2"));
    assert_errors(&document, &[("/problem/lcs/a/1", "forcing_depends_on_unknown", "")]);
    let document = with(linear(), "/problem/lcs/a/1", json!("1/t"));
    assert_errors(&document, &[("/problem/lcs/a/1", "outside_domain", "the rate of `x2` is inf at t = 0")]);
}

#[test]
fn the_end_comes_after_the_start() {
    for time in [json!({"start": 3, "end": 1}), json!({"start": 1, "end": 1}), json!({"start": -1e308, "end": 1e308})] {
        assert_errors(&with(block(), "/time", time), &[("/time/end", "end_before_start", "")]);
    }
}

#[test]
fn an_even_number_of_stages_needs_a_fixed_step() {
    for stages in [2, 4, 6, 8] {
        let document = with(block(), "/method", json!({"stages": stages}));
        let reason = "no embedded error estimate";
        assert_errors(&document, &[("/method/stages", "even_stages_need_step", reason)]);
        let document = with(block(), "/method", json!({"stages": stages, "step": 0.1}));
        dvi::specification::Specification::from_json(document.to_string().as_bytes()).unwrap();
    }
    for stages in [0, 10] {
        let document = with(block(), "/method", json!({"stages": stages}));
        assert_errors(&document, &[("/method/stages", "out_of_range", "")]);
    }
}

#[test]
fn tolerances_and_steps_are_positive_and_in_range() {
    for (method, pointer, code) in [
        (json!({"rtol": 0}), "/method/rtol", "out_of_range"),
        (json!({"rtol": 1}), "/method/rtol", "out_of_range"),
        (json!({"atol": -1e-9}), "/method/atol", "out_of_range"),
        (json!({"atol": {"x": 0}}), "/method/atol/x", "out_of_range"),
        (json!({"atol": {"F": 1e-9}}), "/method/atol/F", "unknown_name"),
        (json!({"step": 0}), "/method/step", "out_of_range"),
        (json!({"step": 1e-9}), "/method/step", "too_many_steps"),
        (json!({"step": 0.1, "max_step": 1}), "/method/max_step", "conflict"),
        (json!({"min_step": 1, "max_step": 0.1}), "/method/min_step", "out_of_range"),
        (json!({"first_step": 1, "max_step": 0.1}), "/method/first_step", "out_of_range"),
        (json!({"vi_tolerance": 1}), "/method/vi_tolerance", "out_of_range"),
    ] {
        assert_errors(&with(block(), "/method", method), &[(pointer, code, "")]);
    }
}

#[test]
fn output_times_increase_within_the_horizon_and_are_not_too_many() {
    for (times, expected) in [
        (json!([0, 5, 5]), vec![("/output/times/2", "not_increasing", "5 does not come after 5")]),
        (
            json!([-1, 5, 11]),
            vec![("/output/times/0", "outside_horizon", ""), ("/output/times/2", "outside_horizon", "")],
        ),
        (json!([]), vec![("/output/times", "empty", "")]),
        (json!({"count": 1}), vec![("/output/times/count", "out_of_range", "")]),
        (json!({"count": 3_000_000}), vec![("/output/times/count", "too_many_times", "3000000 output times")]),
        (json!({"every": 0}), vec![("/output/times/every", "out_of_range", "")]),
        (json!({"every": 1e-7}), vec![("/output/times/every", "too_many_times", "")]),
        (json!("step"), vec![("/output/times", "wrong_type", "expected \"steps\", {\"count\": n}")]),
        (json!({"count": 3, "every": 1}), vec![("/output/times", "wrong_type", "found 2 entries")]),
    ] {
        assert_errors(&with(block(), "/output", json!({"times": times})), &expected);
    }
}

#[test]
fn output_fields_are_states_and_variables() {
    let document = with(block(), "/output", json!({"fields": ["x", "F", "k", "x"]}));
    assert_errors(
        &document,
        &[
            ("/output/fields/2", "unknown_name", "`k` is not an output: neither a state, a variable nor a definition"),
            ("/output/fields/3", "duplicate_name", "`x` is named already"),
        ],
    );
}

#[test]
fn limits_are_positive() {
    let document = with(block(), "/limits", json!({"wall_seconds": 0, "steps": 0}));
    assert_errors(&document, &[("/limits/wall_seconds", "out_of_range", ""), ("/limits/steps", "out_of_range", "")]);
}

#[test]
fn the_label_has_two_hundred_characters_at_most() {
    let label = |length| with(block(), "/label", json!("\u{e9}".repeat(length)));
    dvi::specification::Specification::from_json(label(200).to_string().as_bytes()).unwrap();
    assert_errors(&label(201), &[("/label", "label_too_long", "201 characters")]);
}

#[test]
fn the_first_version_of_the_language_is_the_one_there_is() {
    let versioned = |version: Value| with(block(), "/version", version);
    assert!(Specification::from_json(versioned(json!(1)).to_string().as_bytes()).is_ok());
    assert_errors(&versioned(json!(2)), &[("/version", "unknown_version", "version 2")]);
    let errors = Specification::from_json(versioned(json!(0)).to_string().as_bytes()).unwrap_err();
    assert_eq!(errors[0].expected.as_deref(), Some("1, or nothing"));
    assert!(Specification::from_json(versioned(json!("1")).to_string().as_bytes()).is_err());
}

/// Output fields of problems in SI units state their units; other problems leave the units to the user.
#[test]
fn fields_have_units_where_the_problem_has() {
    let units = |text: &str| Specification::from_json(text.as_bytes()).unwrap().provenance().units;
    let circuit = r#"{"problem": {"circuit": {"components": [
        {"voltage_source": {"name": "V1", "nodes": ["in", "0"], "volts": 5}},
        {"resistor": {"name": "R1", "nodes": ["in", "out"], "ohms": 1}},
        {"capacitor": {"name": "C1", "nodes": ["out", "0"], "farads": 1}}]}}, "time": {"end": 1}, "output": {"fields": ["v(out)", "i(R1)"]}}"#;
    let told: Vec<(String, String)> = units(circuit).into_iter().collect();
    let wanted = [("i(R1)", "A"), ("t", "s"), ("v(out)", "V")].map(|(name, unit)| (name.to_owned(), unit.to_owned()));
    assert_eq!(told, wanted);
    let scene = r#"{"problem": {"rigid_bodies": {"gravity": [0, 0, -9.81], "bodies": [
        {"name": "ball", "shape": {"sphere": {"radius": 1}}, "mass": 1, "position": [0, 0, 5]}]}}, "time": {"end": 1}}"#;
    let units_of_scene = units(scene);
    for (name, unit) in
        [("ball.z", "m"), ("ball.vz", "m/s"), ("ball.wz", "rad/s"), ("kinetic_energy", "J"), ("normal_impulse", "N s")]
    {
        assert_eq!(units_of_scene.get(name).map(String::as_str), Some(unit), "{name}");
    }
    assert!(
        units(r#"{"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "-x"}}}}, "time": {"end": 1}}"#)
            .is_empty()
    );
}
