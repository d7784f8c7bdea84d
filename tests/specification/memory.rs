//! Error messages for faulty problems with memory.

use crate::documents::*;
use dvi::specification::Specification;
use serde_json::{Value, json};

const PLACE: &str = "/problem/convolution";
const KERNEL: &str = "/problem/convolution/kernel";

fn fractional() -> Value {
    json!({
        "problem": {"convolution": {
            "variables": {"u": {"q": "1 - t"}},
            "kernel": {"fractional": {"exponent": 0.5, "matrix": [[1]]}},
            "set": [{"nonnegative": ["u"]}]
        }},
        "time": {"end": 2}
    })
}

fn entries(kernel: Value) -> Value {
    with(fractional(), KERNEL, kernel)
}

fn accepted(document: &Value) -> Specification {
    Specification::from_json(document.to_string().as_bytes()).unwrap_or_else(|errors| panic!("{errors:#?}"))
}

#[test]
fn a_kernel_is_a_power_or_entries_and_not_both() {
    let neither = entries(json!({}));
    assert_errors(&neither, &[(KERNEL, "fractional_or_entries", "either")]);
    let both = with(fractional(), "/problem/convolution/kernel/entries", json!([[1]]));
    assert_errors(&both, &[(KERNEL, "fractional_or_entries", "either")]);
    let stray = with(fractional(), "/problem/convolution/kernel/exponent", json!(1));
    assert_errors(&stray, &[("/problem/convolution/kernel/exponent", "conflict", "`fractional`")]);
}

#[test]
fn the_exponent_is_above_zero_and_at_most_two() {
    let place = "/problem/convolution/kernel/fractional/exponent";
    assert_errors(&with(fractional(), place, json!(0)), &[(place, "out_of_range", "0")]);
    assert_errors(&with(fractional(), place, json!(2.5)), &[(place, "index_too_high", "the index is 2.5")]);
    assert_errors(&with(fractional(), place, json!("1/0")), &[(place, "not_finite", "")]);
    assert_errors(&with(fractional(), place, json!("t")), &[(place, "unknown_name", "`t`")]);
    let place = "/problem/convolution/kernel/exponent";
    assert_errors(&entries(json!({"entries": [[1]], "exponent": 2.1})), &[(place, "index_too_high", "2.1")]);
}

#[test]
fn the_matrix_has_a_row_and_a_column_for_each_variable() {
    let place = "/problem/convolution/kernel/fractional/matrix";
    assert_errors(&with(fractional(), place, json!([[1], [2]])), &[(place, "wrong_shape", "expected 1 rows, got 2")]);
    let row = "/problem/convolution/kernel/entries/0";
    assert_errors(&entries(json!({"entries": [[1, 2]]})), &[(row, "wrong_shape", "expected 1 entries")]);
    let entry = "/problem/convolution/kernel/entries/0/0";
    assert_errors(&entries(json!({"entries": [["exp(-s)"]]})), &[(entry, "unknown_name", "`s`")]);
}

#[test]
fn entries_are_smooth_at_zero_and_of_an_index_that_can_be_solved() {
    let place = "/problem/convolution/kernel/entries";
    assert_errors(&entries(json!({"entries": [["t^(-0.5)"]]})), &[(place, "outside_domain", "entry (0, 0)")]);
    assert_errors(&entries(json!({"entries": [["t^2"]]})), &[(place, "index_too_high", "the index is 3")]);
    assert_errors(&entries(json!({"entries": [[0]]})), &[(place, "index_too_high", "")]);
    assert_errors(&entries(json!({"entries": [["t"]], "exponent": 0.5})), &[(place, "conflict", "zero at t = 0")]);
}

#[test]
fn q_depends_on_time_alone_and_variables_have_names() {
    let q = "/problem/convolution/variables/u/q";
    assert_errors(&with(fractional(), q, json!("1 - u")), &[(q, "unknown_name", "`u`")]);
    assert_errors(&with(fractional(), q, json!("1/t")), &[(q, "outside_domain", "inf")]);
    assert_errors(&without(fractional(), q), &[("/problem/convolution/variables/u", "missing_key", "`q`")]);
    let none = with(fractional(), "/problem/convolution/variables", json!({}));
    assert_errors(&none, &[("/problem/convolution/variables", "empty_variables", "")]);
    let reserved = with(fractional(), "/problem/convolution/variables", json!({"t": {"q": 1}}));
    let reserved = with(reserved, "/problem/convolution/set", json!([{"nonnegative": ["t"]}]));
    assert_errors(&reserved, &[("/problem/convolution/variables/t", "duplicate_name", "")]);
}

#[test]
fn a_set_is_needed_and_may_move_with_time_alone() {
    assert_errors(&without(fractional(), "/problem/convolution/set"), &[(PLACE, "missing_key", "`set` is missing")]);
    let moving = json!([{"box": {"of": ["u"], "lower": 0, "upper": "1 + t"}}]);
    accepted(&with(fractional(), "/problem/convolution/set", moving));
}

#[test]
fn only_the_method_with_memory_solves_it_and_it_solves_nothing_else() {
    for name in ["radau", "contact"] {
        let document = with(fractional(), "/method", json!({"name": name}));
        assert_errors(&document, &[("/method/name", "conflict", "memory")]);
    }
    accepted(&with(fractional(), "/method", json!({"name": "convolution"})));
    let other = with(block(), "/method", json!({"name": "convolution"}));
    assert_errors(&other, &[("/method/name", "conflict", "no memory")]);
    let impacts = with(fractional(), "/method", json!({"impacts": "locate"}));
    assert_errors(&impacts, &[("/method/impacts", "conflict", "impacts")]);
    let error = with(fractional(), "/output", json!({"global_error": true}));
    assert_errors(&error, &[("/output/global_error", "conflict", "memory")]);
    let steps = with(fractional(), "/method", json!({"step": 2.1e-7}));
    assert_errors(&steps, &[("/method/step", "too_many_steps", "history")]);
}

#[test]
fn the_index_is_the_exponent_and_says_whether_the_solution_is_unique() {
    for (exponent, index, uniqueness) in [
        (0.5, json!(0.5), json!("unique")),
        (1.0, json!(1), json!("unique")),
        (1.5, json!(1.5), json!("exists_not_certified")),
    ] {
        let document = with(fractional(), "/problem/convolution/kernel/fractional/exponent", json!(exponent));
        let summary = serde_json::to_value(accepted(&document).summary()).expect("a summary in JSON");
        assert_eq!((&summary["index"], &summary["uniqueness"]), (&index, &uniqueness));
    }
}
