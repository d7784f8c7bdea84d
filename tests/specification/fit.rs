//! Error messages for faulty fits, each with the JSON pointer of the fault.

use crate::documents::{assert_errors, block, with};
use serde_json::{Value, json};

fn data() -> Value {
    json!({"t": [0.25, 0.5, 0.75], "x": [1, 2, 3]})
}

#[test]
fn every_wrong_value_of_a_fit_is_told_at_its_place() {
    let parameters = json!({"x.initial": {}});
    for (fit, expected) in [
        (json!({"parameters": {}, "data": data()}), ("/fit/parameters", "empty", "nothing to fit")),
        (
            json!({"parameters": {"x.start": {}}, "data": data()}),
            ("/fit/parameters/x.start", "unknown_name", "no parameter or initial value `x.start`"),
        ),
        (
            json!({"parameters": {"x.initial": {"lower": 2, "upper": 1}}, "data": data()}),
            ("/fit/parameters/x.initial/lower", "out_of_range", "the lower bound 2 is not below the upper bound 1"),
        ),
        (
            json!({"parameters": {"x.initial": {"initial": 9, "lower": 0, "upper": 1}}, "data": data()}),
            ("/fit/parameters/x.initial/initial", "out_of_range", "begins at 9, outside the bounds 0 to 1"),
        ),
        (
            json!({"parameters": {"x.initial": {"lower": 50}}, "data": data()}),
            ("/fit/parameters/x.initial", "out_of_range", "outside the bounds 50 to inf"),
        ),
        (
            json!({"parameters": {"x.initial": {"lower": -9}}, "data": data(), "starts": 2}),
            ("/fit/parameters/x.initial", "missing_key", "several starts"),
        ),
        (json!({"parameters": parameters, "data": data(), "starts": 0}), ("/fit/starts", "out_of_range", "0 is out")),
        (json!({"parameters": parameters, "data": {"t": [], "x": []}}), ("/fit/data/t", "empty", "no times")),
        (json!({"parameters": parameters, "data": {"t": [0.5]}}), ("/fit/data", "empty", "there are no values")),
        (
            json!({"parameters": parameters, "data": {"t": [0.5, 0.5, 0.7], "x": [1, 2, 3]}}),
            ("/fit/data/t/1", "not_increasing", "0.5 does not come after 0.5"),
        ),
        (
            json!({"parameters": parameters, "data": {"t": [0.5, 0.6, 700], "x": [1, 2, 3]}}),
            ("/fit/data/t/2", "out_of_range", "700 is outside the time of the run"),
        ),
        (
            json!({"parameters": parameters, "data": {"t": [0.5, 0.6], "x": [1, 2, 3]}}),
            ("/fit/data/x", "wrong_count", "3 values at 2 times"),
        ),
        (
            json!({"parameters": parameters, "data": {"t": [0.5, 0.6], "xx": [1, 2]}}),
            ("/fit/data/xx", "unknown_name", "`xx` is neither a state nor a definition"),
        ),
        (
            json!({"parameters": parameters, "data": {"t": [0.5, 0.6], "x": [1, 2], "sd": 0}}),
            ("/fit/data/sd", "out_of_range", "0 is out of range"),
        ),
        (
            json!({"parameters": parameters, "data": {"t": [0.5, 0.6], "x": [1, 2], "sd": {"x": [1]}}}),
            ("/fit/data/sd/x", "wrong_count", "1 standard deviations at 2 times"),
        ),
        (
            json!({"parameters": parameters, "data": {"t": [0.5, 0.6], "x": [1, 2], "sd": {"x": 1, "y": 1}}}),
            ("/fit/data/sd/y", "unknown_name", "`y` is not among the data"),
        ),
        (
            json!({"parameters": parameters, "data": {"t": [0.5], "x": [1]}}),
            ("/fit/data", "too_few_data", "1 values do not determine 1 parameters"),
        ),
        (
            json!({"parameters": parameters, "data": {"t": [0.5, 0.6], "x": [1, 2], "v": [1, 2]}}),
            ("/fit/data", "missing_key", "several columns are weighed"),
        ),
        (
            json!({"parameters": parameters, "data": data(), "loss": "huber"}),
            ("/fit/data", "missing_key", "huber's loss"),
        ),
        (json!({"parameters": parameters, "data": {"x": [1]}}), ("/fit/data", "missing_key", "`t` is missing")),
        (
            json!({"parameters": parameters, "data": {"t": [0.5, 0.6], "x": [1, "a"]}}),
            ("/fit/data/x/1", "wrong_type", ""),
        ),
        (json!({"parameters": parameters, "data": data(), "loss": "absolute"}), ("/fit/loss", "unknown_choice", "")),
    ] {
        assert_errors(&with(block(), "/fit", fit), &[expected]);
    }
}

#[test]
fn a_fit_stands_alone() {
    let fit = json!({"parameters": {"x.initial": {}}, "data": data()});
    for (key, value) in [
        ("steady_state", json!({})),
        ("study", json!({"rtol": [1e-3]})),
        ("sensitivities", json!({"to": ["x.initial"]})),
    ] {
        let document = with(with(block(), "/fit", fit.clone()), &format!("/{key}"), value);
        assert_errors(&document, &[("/fit", "conflict", key)]);
    }
}
