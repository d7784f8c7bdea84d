//! Error messages for faulty obstacle problems.

use crate::documents::*;
use dvi::specification::Specification;
use serde_json::{Value, json};

fn interval() -> Value {
    json!({
        "problem": {"obstacle": {
            "domain": {"x": [0, 1]}, "elements": 10, "diffusion": 1, "obstacle": "x - 1", "initial": 0,
            "boundary": {"x_min": {"dirichlet": 0}}, "probes": {"middle": [0.5]}
        }},
        "time": {"end": 1}
    })
}

fn rectangle() -> Value {
    let document = with(interval(), "/problem/obstacle/domain", json!({"x": [0, 1], "y": [0, 2]}));
    with(document, "/problem/obstacle/probes", json!({"middle": [0.5, 1]}))
}

/// Asserts the error after the member `key` of an obstacle problem is replaced by `value`: its JSON pointer, its code,
/// and words of its message.
fn says(document: Value, key: &str, value: Value, place: &str, code: &str, words: &str) {
    let document = with(document, &format!("/problem/obstacle/{key}"), value);
    assert_errors(&document, &[(&format!("/problem/obstacle/{place}"), code, words)]);
}

fn passes(document: &Value) {
    let read = Specification::from_json(document.to_string().as_bytes());
    assert!(read.is_ok(), "{:#?}", read.err());
}

#[test]
fn what_is_right_passes() {
    passes(&interval());
    passes(&rectangle());
    let anisotropic = with(rectangle(), "/problem/obstacle/diffusion", json!({"x": 1, "y": "1 + t"}));
    passes(&with(anisotropic, "/problem/obstacle/elements", json!({"x": 4, "y": 8})));
}

#[test]
fn a_domain_has_directions_of_some_length_in_their_order() {
    says(interval(), "domain", json!({"x": [1, 1]}), "domain/x", "empty_interval", "[1, 1]");
    says(interval(), "domain", json!({"x": [0, "b"]}), "domain/x/1", "unknown_name", "b");
    says(interval(), "domain", json!({"x": [0, 1], "z": [0, 1]}), "domain", "missing_key", "no `y`");
    says(interval(), "domain", json!({"x": [1, 0]}), "domain/x", "empty_interval", "[1, 0]");
    says(interval(), "domain", json!({"x": [0, "1 + t"]}), "domain/x/1", "unknown_name", "`t`");
    says(interval(), "domain", json!({"x": [0, "1/0"]}), "domain/x/1", "not_finite", "inf");
    says(interval(), "domain", json!({"x": [0]}), "domain/x", "wrong_type", "1 entries");
}

#[test]
fn elements_are_at_least_two_in_each_direction_and_not_too_many() {
    says(interval(), "elements", json!(1), "elements", "out_of_range", "1 elements");
    says(interval(), "elements", json!({"x": 4, "y": 4}), "elements/y", "no_such_direction", "`y`");
    says(rectangle(), "elements", json!({"x": 4}), "elements", "missing_key", "`y` is missing");
    says(rectangle(), "elements", json!({"x": 4, "y": 0}), "elements/y", "out_of_range", "0 elements");
    says(interval(), "elements", json!(-4), "elements", "wrong_type", "-4");
    says(interval(), "elements", json!(2.5), "elements", "wrong_type", "2.5");
    let document = with(interval(), "/problem/obstacle/elements", json!(10_000_000));
    assert_errors(&document, &[("/problem/obstacle", "too_many_unknowns", "10000001 unknowns")]);
    for elements in [2_000_000_u64, u64::MAX] {
        let document = with(rectangle(), "/problem/obstacle/elements", json!(elements));
        assert_errors(&document, &[("/problem/obstacle", "too_many_unknowns", "unknowns")]);
    }
}

#[test]
fn coefficients_are_finite_and_diffusion_does_not_run_backwards() {
    says(interval(), "diffusion", json!("1 - 2*x"), "diffusion", "out_of_range", "the diffusion is");
    says(interval(), "reaction", json!("1/(x - 0.05)"), "reaction", "not_finite", "`reaction` is inf");
    says(interval(), "source", json!("ln(x - 0.5)"), "source", "not_finite", "`source` is NaN");
    says(interval(), "source", json!("y"), "source", "unknown_name", "y");
    says(interval(), "diffusion", json!(-1), "diffusion", "out_of_range", "the diffusion is -1");
    says(interval(), "diffusion", json!("0/0"), "diffusion", "not_finite", "`diffusion` is NaN");
    says(interval(), "advection", json!("1/x^400"), "advection", "not_finite", "`advection` is inf");
    says(rectangle(), "advection", json!(1), "advection", "wrong_shape", "2 directions");
    says(rectangle(), "advection", json!({"x": 1}), "advection", "missing_key", "`y` is missing");
    says(rectangle(), "diffusion", json!({"x": 1, "y": 1, "z": 1}), "diffusion/z", "no_such_direction", "`z`");
}

#[test]
fn values_lie_between_the_obstacles() {
    says(interval(), "obstacle", json!("x - 0.5"), "initial", "beyond_obstacle", "by 5e-1");
    says(interval(), "upper_obstacle", json!(-0.5), "obstacle", "empty_set", "is above the upper one");
    says(
        interval(),
        "boundary",
        json!({"x_min": {"dirichlet": -2}}),
        "boundary/x_min/dirichlet",
        "beyond_obstacle",
        "given on `x_min`",
    );
    says(interval(), "obstacle", json!("1/x"), "obstacle", "not_finite", "at (0, 0, 0)");
    says(interval(), "upper_obstacle", json!("ln(-x)"), "upper_obstacle", "not_finite", "`upper_obstacle` is");
    says(interval(), "initial", json!("sqrt(x - 1)"), "initial", "not_finite", "`initial` is NaN");
    says(interval(), "obstacle", json!("1 - x"), "boundary/x_min/dirichlet", "beyond_obstacle", "obstacle 1 at");
    says(
        interval(),
        "boundary",
        json!({"x_max": {"neumann": "sqrt(-x)"}}),
        "boundary/x_max/neumann",
        "not_finite",
        "is NaN",
    );
    let sides = json!({"y_min": {"neumann": 0}});
    says(interval(), "boundary", sides, "boundary/y_min", "no_such_direction", "no side `y_min`");
}

#[test]
fn probes_are_points_of_the_domain_with_names_of_their_own() {
    says(interval(), "probes", json!({"p": [2]}), "probes/p/0", "outside_domain", "2 is outside");
    says(interval(), "probes", json!({"p": [0.1, 0.2]}), "probes/p", "wrong_shape", "2 coordinates");
    says(interval(), "probes", json!({"total": [0.1]}), "probes/total", "duplicate_name", "`total`");
}

#[test]
fn keys_and_choices_are_those_that_there_are() {
    says(interval(), "mass", json!("diagonal"), "mass", "unknown_choice", "diagonal");
    says(interval(), "obstacles", json!(0), "obstacles", "unknown_key", "obstacles");
    says(interval(), "boundary", json!({"x_min": {"robin": 0}}), "boundary/x_min/robin", "unknown_choice", "robin");
    says(interval(), "parameters", json!({"a": "a + 1"}), "parameters/a", "unknown_name", "`a`");
}

#[test]
fn the_method_is_the_one_for_grids() {
    for (key, value) in [("name", json!("radau")), ("stages", json!(3)), ("vi_solver", json!("lemke"))] {
        let place = format!("/method/{key}");
        let document = with(with(interval(), "/method", json!({})), &place, value);
        assert_errors(&document, &[(&place, "conflict", "obstacle problems")]);
    }
    passes(&with(interval(), "/method", json!({"name": "tr_bdf2", "vi_solver": "active_set"})));
}
