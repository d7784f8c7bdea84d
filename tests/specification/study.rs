//! Error messages for faulty studies, each with the JSON pointer of the fault.

use crate::documents::{assert_errors, block, with};
use serde_json::json;

#[test]
fn every_wrong_value_of_a_study_is_told_at_its_place() {
    for (study, expected) in [
        (json!({}), ("/study", "conflict", "neither `rtol` nor `step` is given")),
        (json!({"rtol": [1e-3], "step": [0.1]}), ("/study", "conflict", "both `rtol` and `step` are given")),
        (json!({"rtol": []}), ("/study/rtol", "empty", "nothing to run")),
        (json!({"rtol": [1e-3, 1]}), ("/study/rtol/1", "out_of_range", "1 is out of range")),
        (json!({"step": [0.1, 0]}), ("/study/step/1", "out_of_range", "0 is out of range")),
        (json!({"step": [1e-12]}), ("/study/step/0", "too_many_steps", "steps")),
        (json!({"rtol": [1e-3], "stages": [2]}), ("/study/stages/0", "even_stages_need_step", "2 stages")),
        (json!({"step": [0.1], "stages": [10]}), ("/study/stages/0", "out_of_range", "10 stages")),
        (json!({"rtol": [1e-3], "repeats": 0}), ("/study/repeats", "out_of_range", "0 is out of range")),
        (json!({"rtol": [1e-3], "exact": {"y": 1}}), ("/study/exact/y", "unknown_name", "`y` is neither")),
        (json!({"rtol": [1e-3], "exact": {"x": "cos(v)"}}), ("/study/exact/x", "unknown_name", "`v`")),
        (json!({"rtol": vec![1e-3; 65]}), ("/study", "too_many_runs", "65 runs")),
    ] {
        assert_errors(&with(block(), "/study", study), &[expected]);
    }
}
