//! Error messages for faulty sweeps, each with the JSON pointer of the fault; and the names by which a sweep sets
//! numbers of a specification.

use crate::documents::*;
use dvi::specification::{Specification, edited};
use serde_json::{Value, json};

fn swept(sweep: Value) -> Value {
    with(block(), "/sweep", sweep)
}

#[test]
fn names_that_stand_for_nothing_are_told_with_the_nearest() {
    let errors =
        errors_of(swept(json!({"over": {"kk": [1], "xx.initial": [1], "x.velocity": [1], "m": [1]}})).to_string());
    let told: Vec<(&str, &str, Option<&str>)> =
        errors.iter().map(|e| (e.pointer.as_str(), e.code, e.did_you_mean.as_deref())).collect();
    assert_eq!(told[0], ("/sweep/over/kk", "unknown_name", Some("k")));
    assert!(told.contains(&("/sweep/over/xx.initial", "unknown_name", Some("x.initial"))), "{told:?}");
    assert!(told.iter().any(|error| error.0 == "/sweep/over/x.velocity"), "{told:?}");
    assert_eq!(told.len(), 3);
}

#[test]
fn trajectories_are_kept_at_given_times_and_within_bounds() {
    let told = |sweep: Value, output: Value| {
        let errors = errors_of(with(swept(sweep), "/output", output).to_string());
        assert_eq!(errors.len(), 1, "{errors:#?}");
        (errors[0].pointer.clone(), errors[0].code, errors[0].detail.clone())
    };
    let many = json!({"over": {"k": {"linspace": [1, 2, 1_000_000]}}, "keep": "trajectories"});
    let (pointer, code, detail) = told(many, json!({"times": {"count": 11}, "fields": ["x", "v"]}));
    assert_eq!((pointer.as_str(), code), ("/sweep/keep", "too_many_runs"));
    assert!(detail.starts_with("22000000 numbers: 11 times of 2 fields of 1000000 members"), "{detail}");
    let (pointer, code, _) = told(json!({"over": {"k": [1, 2]}, "keep": "trajectories"}), json!({}));
    assert_eq!((pointer.as_str(), code), ("/sweep/keep", "missing_key"));
}

#[test]
fn designs_and_ranges_that_do_not_go_together_are_refused() {
    let told: [(Value, &str, &str); 16] = [
        (json!({}), "/sweep", "missing_key"),
        (json!({"over": {}}), "/sweep/over", "empty"),
        (json!({"over": {"k": []}}), "/sweep/over/k", "out_of_range"),
        (json!({"over": {"k": {"linspace": [0, 1, 0]}}}), "/sweep/over/k", "out_of_range"),
        (json!({"over": {"k": {"logspace": [-1, 1, 3]}}}), "/sweep/over/k", "out_of_range"),
        (json!({"over": {"k": {"logspace": [0, 1, 3]}}}), "/sweep/over/k", "out_of_range"),
        (json!({"over": {"k": {"normal": [0, -1]}}, "design": "random", "count": 3}), "/sweep/over/k", "out_of_range"),
        (json!({"over": {"k": {"uniform": [1, 0]}}, "design": "random", "count": 3}), "/sweep/over/k", "out_of_range"),
        (json!({"over": {"k": {"uniform": [0, 1]}}}), "/sweep/over/k", "conflict"),
        (json!({"over": {"k": [1]}, "design": "sobol"}), "/sweep", "missing_key"),
        (json!({"over": {"k": [1]}, "count": 3}), "/sweep/count", "conflict"),
        (json!({"over": {"k": [1]}, "design": "table"}), "/sweep/design", "conflict"),
        (json!({"over": {"k": [1, 2], "m": [1]}, "design": "zip"}), "/sweep/over/m", "wrong_count"),
        (json!({"table": {"columns": ["k", "m"], "rows": [[1, 2], [1]]}}), "/sweep/table/rows/1", "wrong_count"),
        (
            json!({"over": {"k": {"linspace": [1, 2, 4000]}, "m": {"linspace": [1, 2, 4000]}}}),
            "/sweep",
            "too_many_runs",
        ),
        (json!({"over": {"k": [1]}, "sead": 3}), "/sweep/sead", "unknown_key"),
    ];
    for (sweep, pointer, code) in told {
        let errors = errors_of(swept(sweep.clone()).to_string());
        assert_eq!((errors[0].pointer.as_str(), errors[0].code), (pointer, code), "{sweep}");
        assert_eq!(errors.len(), 1, "{sweep}: {errors:#?}");
    }
}

#[test]
fn what_is_collected_is_checked_in_its_place() {
    let collect = json!({"a": {"final": "xx"}, "b": {"count": {"kind": "activated", "of": "G"}},
        "c": {"at": {"t": 99, "of": "x"}}, "k": {"final": "x"}, "status": {"max": "v"}, "ok": {"max": "abs(v)*k"}});
    let errors = errors_of(swept(json!({"over": {"k": [1]}, "collect": collect})).to_string());
    let told: Vec<(&str, &str)> = errors.iter().map(|e| (e.pointer.as_str(), e.code)).collect();
    for expected in [
        ("/sweep/collect/a/final", "unknown_name"),
        ("/sweep/collect/b/count/of", "unknown_name"),
        ("/sweep/collect/c/at/t", "outside_horizon"),
        ("/sweep/collect/k", "duplicate_name"),
        ("/sweep/collect/status", "duplicate_name"),
    ] {
        assert!(told.contains(&expected), "{expected:?} in {told:?}");
    }
    assert_eq!(told.len(), 5, "{told:?}");
    let errors = errors_of(swept(json!({"over": {"k": [1]}, "collect": {"a": {"count": "impcat"}}})).to_string());
    assert_eq!((errors[0].code, errors[0].did_you_mean.as_deref()), ("unknown_choice", Some("impact")));
}

#[test]
fn the_values_that_are_swept_may_be_expressions_in_the_problem() {
    let document = with(swept(json!({"over": {"x.initial": [1, 2]}})), "/problem/dvi/states/x/initial", json!("2*k"));
    let specification = Specification::from_json(document.to_string().as_bytes()).unwrap();
    let plan = specification.sweep().unwrap();
    assert_eq!((plan.members(), plan.targets[0].name.as_str()), (2, "x.initial"));
    let at = specification.model().state_names().iter().position(|name| name == "x").unwrap();
    assert_eq!(specification.member(&[7.0]).unwrap().model().initial()[at], 7.0);
}

#[test]
fn the_digest_is_that_of_what_is_asked_and_not_of_its_layout() {
    let digest = |text: &str| Specification::from_json(text.as_bytes()).unwrap().sweep().unwrap().digest.to_string();
    let document = swept(json!({"over": {"k": [1]}}));
    let (compact, pretty) = (document.to_string(), serde_json::to_string_pretty(&document).unwrap());
    assert_eq!(digest(&compact), digest(&pretty));
    assert_ne!(digest(&compact), digest(&compact.replace("[1]", "[2]")));
}

#[test]
fn numbers_are_set_by_name_and_by_pointer() {
    let set = |settings: &[(&str, &str)]| {
        let settings: Vec<(String, String)> =
            settings.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
        edited(block().to_string().as_bytes(), &settings)
            .map(|text| serde_json::from_slice::<Value>(&text).unwrap())
            .map_err(|errors| (errors[0].code, errors[0].did_you_mean.clone()))
    };
    let found = set(&[("k", "2.5"), ("x.initial", "2*k"), ("/method/rtol", "1e-9")]);
    assert_eq!(found, Err(("unknown_key", None)), "`method` is not there");
    let found = set(&[("k", "2.5"), ("x.initial", "2*k"), ("/method", "{\"rtol\": 1e-9}")]).unwrap();
    assert_eq!(found["problem"]["dvi"]["parameters"]["k"], 2.5);
    assert_eq!(found["problem"]["dvi"]["states"]["x"]["initial"], "2*k");
    assert_eq!(found["method"]["rtol"], 1e-9);
    assert_eq!(set(&[("F1", "1")]), Err(("unknown_name", Some("F0".to_owned()))));
}
