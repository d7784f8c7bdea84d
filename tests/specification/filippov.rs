//! Error messages for faulty Filippov systems.

use crate::documents::*;
use serde_json::{Value, json};

fn surface() -> Value {
    json!({
        "problem": {"filippov": {"states": {"x": {"initial": 2, "plus": -0.7, "minus": 1.3}}, "surface": "x"}},
        "time": {"end": 5}
    })
}

fn regions() -> Value {
    json!({
        "problem": {"filippov": {
            "states": {"x": {"initial": 2}},
            "regions": [{"indicator": "-x", "rates": {"x": -0.7}}, {"indicator": "x", "rates": {"x": 1.3}}]
        }},
        "time": {"end": 5}
    })
}

#[test]
fn a_system_has_a_surface_or_regions_and_not_both() {
    let place = "/problem/filippov";
    assert_errors(&without(surface(), "/problem/filippov/surface"), &[(place, "surface_or_regions", "either")]);
    let both = with(regions(), "/problem/filippov/surface", json!("x"));
    assert_errors(&both, &[(place, "surface_or_regions", "either")]);
    let stray = with(regions(), "/problem/filippov/states/x/plus", json!(1));
    assert_errors(&stray, &[("/problem/filippov/states/x/plus", "surface_or_regions", "one side")]);
}

#[test]
fn every_region_has_the_rate_of_every_state() {
    let document = without(surface(), "/problem/filippov/states/x/minus");
    assert_errors(&document, &[("/problem/filippov/states/x", "missing_key", "`minus`")]);
    let document = without(regions(), "/problem/filippov/regions/1/rates/x");
    assert_errors(&document, &[("/problem/filippov/regions/1/rates", "missing_key", "`x`")]);
    let document = with(regions(), "/problem/filippov/regions/0/rates/y", json!(0));
    assert_errors(&document, &[("/problem/filippov/regions/0/rates/y", "unknown_name", "`y`")]);
    let document = with(regions(), "/problem/filippov/regions", json!([{"indicator": "x", "rates": {"x": 1}}]));
    assert_errors(&document, &[("/problem/filippov/regions", "too_few_regions", "")]);
}

#[test]
fn what_is_wrong_in_an_expression_has_its_place() {
    let document = with(surface(), "/problem/filippov/surface", json!("x - xx"));
    assert_errors(&document, &[("/problem/filippov/surface", "unknown_name", "xx")]);
    // The weights of the regions in a Filippov system are unknowns, not names available to expressions.
    let document = with(surface(), "/problem/filippov/states/x/plus", json!("z"));
    assert_errors(&document, &[("/problem/filippov/states/x/plus", "unknown_name", "z")]);
    let document = with(regions(), "/problem/filippov/regions/1/rates/x", json!("ln(x - 2)"));
    assert_errors(&document, &[("/problem/filippov/states/x", "outside_domain", "the rate of `x`")]);
    let document =
        with(with(surface(), "/problem/filippov/states", json!({})), "/problem/filippov/surface", json!("t"));
    assert_errors(&document, &[("/problem/filippov/states", "empty_states", "")]);
}
