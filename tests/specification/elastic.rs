//! Error messages for faulty elastic bodies.

use crate::documents::*;
use serde_json::{Value, json};

fn block() -> Value {
    json!({
        "problem": {"elastic": {
            "body": {"rectangle": {"x": [0, 2], "y": [0, 1], "plane": "strain"}}, "elements": {"x": 4, "y": 2},
            "density": 1, "young": 100, "poisson": 0.3, "viscosity": 1, "force": [0, -1],
            "traction": {"y_max": [0, "-t"]}, "clamped": ["x_max"],
            "contact": {"y_min": {"gap": "0.1 + x^2", "friction": 0.2}},
            "initial": {"displacement": [0, 0], "velocity": [0, "-y"]}, "probes": {"top": [1, 1]}
        }},
        "time": {"end": 1}
    })
}

fn string() -> Value {
    json!({
        "problem": {"elastic": {
            "body": {"string": {"x": [0, 1]}}, "elements": 8, "density": 1, "tension": 1,
            "clamped": ["x_min"], "contact": {"below": {"gap": 1, "between": [0.5, 0.5]}}
        }},
        "time": {"end": 1}
    })
}

#[test]
fn every_key_is_held_to_its_range() {
    for (place, value, code, says) in [
        ("density", json!(0), "out_of_range", "density"),
        ("young", json!(-1), "out_of_range", "young"),
        ("poisson", json!(0.5), "out_of_range", "Poisson"),
        ("viscosity", json!(-1), "out_of_range", "viscosity"),
        ("elements/x", json!(0), "out_of_range", "0 elements"),
        ("elements/y", json!(1), "out_of_range", "one layer"),
        ("body/rectangle/y", json!([1, 1]), "empty_interval", "its beginning at 1"),
        ("body/rectangle/x/0", json!("1/0"), "not_finite", ""),
        ("contact/y_min/friction", json!(-0.1), "out_of_range", "friction"),
        ("contact/y_min/gap", json!("-0.1"), "penetrates_obstacle", "beyond"),
        ("contact/y_min/gap", json!("1/abs(x - 1)"), "not_finite", "x = 1, y = 0"),
        ("probes/top/0", json!(3), "out_of_range", "outside the body"),
    ] {
        let place = format!("/problem/elastic/{place}");
        assert_errors(&with(block(), &place, value), &[(place.as_str(), code, says)]);
    }
}

#[test]
fn components_are_as_many_as_directions() {
    for (place, value, says) in [
        ("force", json!([0]), "1 components"),
        ("traction/y_max", json!([0, 0, 0]), "3 components"),
        ("initial/velocity", json!([]), "0 components"),
        ("probes/top", json!([1]), "1 coordinates"),
    ] {
        let place = format!("/problem/elastic/{place}");
        assert_errors(&with(block(), &place, value), &[(place.as_str(), "wrong_shape", says)]);
    }
}

#[test]
fn names_of_sides_are_checked_and_the_nearest_is_told() {
    let errors = errors_of(with(block(), "/problem/elastic/clamped/0", json!("xmax")).to_string());
    assert_eq!((errors[0].code, errors[0].did_you_mean.as_deref()), ("unknown_name", Some("x_max")));
    for (place, value) in [("contact/z_min", json!({"gap": 1})), ("traction/top", json!([0, 0]))] {
        let place = format!("/problem/elastic/{place}");
        assert_errors(&with(block(), &place, value), &[(place.as_str(), "unknown_name", "not a side")]);
    }
    let twice = with(block(), "/problem/elastic/clamped", json!(["x_max", "x_max"]));
    assert_errors(&twice, &[("/problem/elastic/clamped/1", "duplicate_name", "clamped already")]);
    let held = with(block(), "/problem/elastic/clamped", json!(["x_max", "y_min"]));
    assert_errors(&held, &[("/problem/elastic/contact/y_min", "no_contact_node", "no free node")]);
    let along = with(string(), "/problem/elastic/contact/x_max", json!({"gap": 1}));
    assert_errors(&along, &[("/problem/elastic/contact/x_max", "unknown_name", "not a side")]);
}

#[test]
fn a_body_has_the_constants_of_its_kind_and_no_others() {
    let place = "/problem/elastic";
    assert_errors(&without(block(), "/problem/elastic/young"), &[(place, "missing_key", "`young`")]);
    assert_errors(&without(string(), "/problem/elastic/tension"), &[(place, "missing_key", "`tension`")]);
    for (document, key) in [(block(), "tension"), (string(), "young"), (string(), "poisson")] {
        let place = format!("/problem/elastic/{key}");
        assert_errors(&with(document, &place, json!(0.1)), &[(place.as_str(), "conflict", "has no")]);
    }
    for (document, key, value) in
        [(block(), "contact/y_min/between", json!([0, 1])), (string(), "contact/below/friction", json!(0.1))]
    {
        let place = format!("/problem/elastic/{key}");
        assert_errors(&with(document, &place, value), &[(place.as_str(), "conflict", "")]);
    }
}

#[test]
fn an_obstacle_of_a_string_meets_every_other_node() {
    let odd = with(string(), "/problem/elastic/elements", json!(7));
    assert_errors(&odd, &[("/problem/elastic/elements", "odd_elements", "7 elements is odd")]);
    let between = with(string(), "/problem/elastic/contact/below/between", json!([0.3, 0.4]));
    assert_errors(&between, &[("/problem/elastic/contact/below", "no_contact_node", "no free node")]);
}

#[test]
fn what_time_has_no_say_in_depends_on_places_alone() {
    let place = "/problem/elastic/initial/velocity/1";
    assert_errors(&with(block(), place, json!("y*t")), &[(place, "depends_on_time", "`t`")]);
    let place = "/problem/elastic/probes/top/0";
    assert_errors(&with(block(), place, json!("x")), &[(place, "unknown_name", "x")]);
    let place = "/problem/elastic/contact/below/gap";
    assert_errors(&with(string(), place, json!("y")), &[(place, "unknown_name", "y")]);
}

#[test]
fn a_body_too_large_or_held_everywhere_is_refused() {
    let large = with(block(), "/problem/elastic/elements", json!(10_000_000));
    assert_errors(&large, &[("/problem/elastic", "too_many_unknowns", "")]);
    let large = with(block(), "/problem/elastic/elements", json!(300));
    assert_errors(&large, &[("/problem/elastic/elements", "too_many_unknowns", "181202")]);
    let held = with(without(string(), "/problem/elastic/contact"), "/problem/elastic/elements", json!(1));
    let held = with(held, "/problem/elastic/clamped", json!(["x_min", "x_max"]));
    assert_errors(&held, &[("/problem/elastic/clamped", "nothing_moves", "no node")]);
}
