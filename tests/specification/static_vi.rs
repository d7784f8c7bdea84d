//! Error messages for faulty static problems, each with the JSON pointer of the fault.

use crate::documents::{assert_errors, with, without};
use serde_json::{Value, json};

fn market() -> Value {
    json!({"problem": {"vi": {"parameters": {"c": 1}, "variables": {
        "x": {"initial": 1, "inequality": "x + y - c"}, "y": {"inequality": "y - x"}},
        "set": [{"nonnegative": ["x", "y"]}]}}})
}

#[test]
fn every_wrong_value_of_a_static_problem_is_told_at_its_place() {
    let of = "/problem/vi";
    for (pointer, value, expected) in [
        ("/time", json!({"end": 1}), ("/time", "conflict", "a static problem has no time")),
        (
            "/problem/vi/variables/x/inequality",
            json!("x - t"),
            ("/problem/vi/variables/x/inequality", "depends_on_time", "depends on `t`"),
        ),
        (
            "/problem/vi/variables/x/inequality",
            json!("x - zz"),
            ("/problem/vi/variables/x/inequality", "unknown_name", "`zz`"),
        ),
        ("/problem/vi/variables/x/initial", json!("y"), ("/problem/vi/variables/x/initial", "unknown_name", "`y`")),
        (
            "/problem/vi/set",
            json!([{"nonnegative": ["x"]}]),
            ("/problem/vi/variables/y", "variable_without_block", "`y` is in no block"),
        ),
        (
            "/problem/vi/set",
            json!([{"box": {"of": ["x", "y"], "lower": 0, "upper": "t"}}]),
            ("/problem/vi/set/0/box/upper", "depends_on_time", "a bound of a static problem must be constant"),
        ),
        ("/method", json!({"step": 0.1}), ("/method/step", "conflict", "no steps")),
        ("/method", json!({"name": "radau"}), ("/method/name", "conflict", "no steps")),
        ("/study", json!({"rtol": [1e-3]}), ("/study", "conflict", "a static problem has none")),
        ("/steady_state", json!({}), ("/steady_state", "conflict", "")),
        (
            "/sensitivities",
            json!({"to": ["c"]}),
            ("/sensitivities", "conflict", "derivatives are computed only for problems that Radau IIA solves"),
        ),
    ] {
        assert_errors(&with(market(), pointer, value), &[expected]);
    }
    assert_errors(&without(market(), "/problem/vi/set"), &[(of, "missing_key", "`set` is missing")]);
    let empty = json!({"problem": {"vi": {"variables": {}}}});
    assert_errors(&empty, &[("/problem/vi/variables", "empty", "there are no variables")]);
}
