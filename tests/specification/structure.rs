//! Error messages for ill-formed specifications: syntax, unknown and missing keys, values of the wrong type.

use crate::documents::*;
use dvi::problem::Control;
use dvi::specification::Specification;
use serde_json::{Value, json};

#[test]
fn an_empty_body_is_told_so() {
    assert_text("", &[("", "syntax", "the document is empty")]);
    assert_text(" \n\t ", &[("", "syntax", "the document is empty")]);
}

#[test]
fn a_syntax_error_gives_line_and_column() {
    assert_text(
        "{\"time\": {\"end\": 1},\n  \"label\": }",
        &[("/label", "syntax", "`}` where a value belongs at line 2 column 12")],
    );
    assert_text(
        "{\"time\": {\"end\": 1}",
        &[("", "syntax", "the end of the text where `{` at line 1 column 1 is open at line 1 column 20")],
    );
    assert_text("{} {}", &[("", "syntax", "text after the end of the document at line 1 column 4")]);
}

#[test]
fn nan_and_infinity_are_no_json() {
    assert_text("{\"time\": {\"end\": NaN}}", &[("/time/end", "syntax", "the word `NaN` at line 1 column 18")]);
    assert_text(
        "{\"time\": {\"end\": -Infinity}}",
        &[("/time/end", "syntax", "the word `-Infinity` at line 1 column 18")],
    );
}

#[test]
fn a_number_beyond_the_largest_is_out_of_range() {
    let text = block().to_string().replace("\"end\":10", "\"end\":1e400");
    assert_text(text, &[("/time/end", "number_out_of_range", "number out of range")]);
}

#[test]
fn invalid_utf_8_is_a_syntax_error() {
    assert_text(b"{\"label\": \"\xff\"}", &[("/label", "syntax", "invalid unicode code point")]);
}

#[test]
fn depth_is_bounded() {
    for depth in [128, 100_000] {
        assert_text("[".repeat(depth), &[("", "too_deep", "recursion limit exceeded")]);
        assert_text("{\"problem\":".repeat(depth), &[("", "too_deep", "recursion limit exceeded")]);
    }
    let nested = format!("{}{}", "[".repeat(120), "]".repeat(120));
    let text = block().to_string().replace("\"end\":10", &format!("\"end\":{nested}"));
    assert_text(text, &[("/time/end", "wrong_type", "found a list, expected a number")]);
}

#[test]
fn a_document_that_is_no_object_is_told_so() {
    for (text, found) in [("[1, 2]", "a list"), ("3", "the number 3"), ("null", "null"), ("\"dvi\"", "the string")] {
        let errors = errors_of(text);
        assert_eq!((errors[0].pointer.as_str(), errors[0].code), ("", "wrong_type"));
        assert!(errors[0].detail.starts_with(&format!("found {found}")), "{}", errors[0].detail);
        assert_eq!(errors.len(), 1, "{errors:?}");
    }
}

#[test]
fn an_empty_object_misses_the_problem_and_the_time() {
    assert_text("{}", &[("", "missing_key", "`problem` is missing"), ("", "missing_key", "`time` is missing")]);
}

#[test]
fn a_misspelt_key_is_named_with_its_right_spelling_and_nothing_else() {
    let document = with(without(block(), "/problem/dvi/states/x/rate"), "/problem/dvi/states/x/rte", json!("v"));
    assert_suggestion(&document, "/problem/dvi/states/x/rte", "unknown_key", "rate");
    let document = with(without(block(), "/time/end"), "/time/ned", json!(10));
    assert_suggestion(&document, "/time/ned", "unknown_key", "end");
}

#[test]
fn names_of_other_programs_are_told_what_they_are_called_here() {
    for (key, ours) in [("t_end", "end"), ("tstop", "end")] {
        let document = with(without(block(), "/time/end"), &format!("/time/{key}"), json!(10));
        assert_suggestion(&document, &format!("/time/{key}"), "unknown_key", ours);
    }
    for (key, without_key, ours) in
        [("x0", "initial", "initial"), ("rhs", "rate", "rate"), ("equation", "rate", "rate")]
    {
        let states = "/problem/dvi/states/x";
        let document = with(without(block(), &format!("{states}/{without_key}")), &format!("{states}/{key}"), json!(1));
        assert_suggestion(&document, &format!("{states}/{key}"), "unknown_key", ours);
    }
    let document = with(block(), "/method", json!({"reltol": 1e-6}));
    assert_suggestion(&document, "/method/reltol", "unknown_key", "rtol");
}

#[test]
fn a_misplaced_key_is_told_its_place() {
    for (place, detail) in [
        ("/rtol", "`rtol` is not a key here; `rtol` belongs in `method`"),
        ("/time/step", "`step` is not a key here; `step` belongs in `method`"),
        ("/t_end", "`t_end` is not a key here; `end` belongs in `time`"),
        (
            "/parameters",
            "`parameters` is not a key here; `parameters` belongs in the problem, beside its type's other keys",
        ),
        ("/output/dt", "`dt` is not a key here; `step` belongs in `method`"),
        ("/method/label", "`label` is not a key here; `label` belongs in the document"),
    ] {
        let document = with(with(block(), "/method", json!({})), "/output", json!({}));
        assert_errors(&with(document, place, json!(1)), &[(place, "unknown_key", detail)]);
    }
}

#[test]
fn an_unknown_key_lists_the_valid_ones() {
    let document = with(block(), "/colour", json!("red"));
    assert_errors(&document, &[("/colour", "unknown_key", "`colour` is not a key here")]);
    let expected = errors_of(document.to_string())[0].expected.clone().unwrap();
    assert_eq!(
        expected,
        "one of `$schema`, `version`, `problem`, `time`, `method`, `output`, `limits`, `stop`, `sensitivities`, \
         `periodic`, `steady_state`, `sweep`, `fit`, `study`, `view`, `label`"
    );
}

#[test]
fn keys_are_escaped_in_pointers() {
    let document = with(block(), "/a~b", json!(1));
    assert_errors(&document, &[("/a~0b", "unknown_key", "")]);
}

#[test]
fn an_unknown_problem_type_suggests_the_nearest() {
    let document = json!({"problem": {"dvii": block()["problem"]["dvi"]}, "time": {"end": 1}});
    assert_suggestion(&document, "/problem/dvii", "unknown_choice", "dvi");
}

#[test]
fn an_unknown_problem_type_hides_no_error_elsewhere() {
    let document = json!({"problem": {"tensor_flow": {}}, "time": {"end": -1}, "method": {"rtol": 7}});
    assert_errors(
        &document,
        &[
            ("/problem/tensor_flow", "unknown_choice", "`tensor_flow` is not a choice here"),
            ("/time/end", "end_before_start", ""),
            ("/method/rtol", "out_of_range", "7"),
        ],
    );
}

#[test]
fn a_problem_of_two_types_is_refused() {
    let mut document = block();
    document["problem"]["lcs"] = linear()["problem"]["lcs"].clone();
    assert_errors(&document, &[("/problem", "wrong_type", "found an object with 2 keys")]);
}

#[test]
fn a_problem_that_is_no_object_is_refused() {
    assert_errors(&with(block(), "/problem", json!([])), &[("/problem", "wrong_type", "found a list")]);
    assert_errors(&with(block(), "/problem", json!(null)), &[("/problem", "wrong_type", "found null")]);
}

#[test]
fn values_of_the_wrong_kind_say_what_was_found_and_expected() {
    for (pointer, value, detail) in [
        ("/time/end", json!("ten"), "found the string \"ten\", expected a number"),
        ("/time", json!([0, 10]), "found a list, expected an object"),
        ("/label", json!(5), "found the number 5, expected a string"),
        ("/problem/dvi/states/x/rate", json!(true), "found true, expected an expression"),
        ("/problem/dvi/states/x/initial", json!(null), "found null, expected an expression"),
        ("/problem/dvi/states/x", json!(["1", "v"]), "found a list, expected an object"),
        ("/problem/dvi/set", json!(true), "found true, expected a list"),
        ("/problem/dvi/set/0/box/of", json!(false), "found false, expected a list"),
        ("/problem/dvi/mass", json!(true), "found true, expected a matrix"),
        ("/study", json!([1e-3]), "found a list, expected an object"),
    ] {
        assert_errors(&with(block(), pointer, value), &[(pointer, "wrong_type", detail)]);
    }
}

#[test]
fn a_set_of_names_that_is_written_like_a_box_is_shown_with_the_names_alone() {
    for set in ["nonnegative", "simplex", "second_order_cone"] {
        let document = with(block(), "/problem/dvi/set/0", json!({set: {"of": ["F"]}}));
        let errors = errors_of(document.to_string());
        assert_eq!(errors[0].expected.as_deref(), Some("the names alone: `[\"F\"]`"), "{errors:?}");
    }
}

/// MATLAB, Octave and R write a JSON list of one element as the element itself, and a column of a matrix as a flat
/// list: both forms are accepted.
#[test]
fn one_value_stands_for_a_list_of_it_alone() {
    let set = json!({"box": {"of": "F", "lower": -1, "upper": 1}});
    let document = with(with(block(), "/problem/dvi/set", set), "/output", json!({"fields": "x"}));
    let specification = Specification::from_json(document.to_string().as_bytes()).unwrap();
    let names = specification.model().output_names();
    let kept: Vec<&str> = specification.output_fields().iter().map(|&field| names[field].as_str()).collect();
    assert_eq!(kept, ["x"]);
    let small = |problem: Value| json!({"problem": {"lcs": problem}, "time": {"end": 1}});
    let written = [
        small(
            json!({"initial": [1], "A": [[-1]], "a": [0], "B": [[2]], "C": [[1]], "D": [[1]], "g": [0], "set": [{"nonnegative": ["z1"]}]}),
        ),
        small(json!({"initial": 1, "A": -1, "a": 0, "B": 2, "C": 1, "D": "1", "g": 0, "set": {"nonnegative": "z1"}})),
    ];
    let read = written.map(|document| Specification::from_json(document.to_string().as_bytes()).unwrap());
    let [lists, alone] = read.each_ref().map(|read| dvi::solve(read, &Control::new()).trajectory);
    assert_eq!(lists, alone);
    // A 2 x 1 and a 1 x 2 matrix, both written in JSON as flat lists.
    let written = [
        small(
            json!({"initial": [1, 2], "A": [[-1, 0], [0, -2]], "B": [[1], [3]], "C": [[1, 4]], "D": [[1]], "set": [{"nonnegative": ["z1"]}]}),
        ),
        small(
            json!({"initial": [1, 2], "A": [[-1, 0], [0, -2]], "B": [1, 3], "C": [1, 4], "D": 1, "set": {"nonnegative": "z1"}}),
        ),
    ];
    let read = written.map(|document| Specification::from_json(document.to_string().as_bytes()).unwrap());
    let [lists, flat] = read.each_ref().map(|read| dvi::solve(read, &Control::new()).trajectory);
    assert_eq!(lists, flat);
    // The JSON pointer of an error refers to the document as the user has written it.
    let wrong = with(block(), "/problem/dvi/set", json!({"bxo": {"of": "F"}}));
    assert_suggestion(&wrong, "/problem/dvi/set/bxo", "unknown_choice", "box");
    let rows = ("/problem/dvi/mass", "wrong_shape", "expected 2 rows");
    let entries = ("/problem/dvi/mass/0", "wrong_shape", "expected 2 entries");
    assert_errors(&with(block(), "/problem/dvi/mass", json!(3)), &[rows, entries]);
}

#[test]
fn the_end_may_be_called_until_and_not_twice() {
    let document = with(block(), "/time", json!({"until": 10}));
    assert_eq!(Specification::from_json(document.to_string().as_bytes()).unwrap().time().end, 10.0);
    let twice = with(block(), "/time", json!({"until": 10, "end": 10}));
    assert_errors(&twice, &[("/time/until", "conflict", "another name of `end`")]);
}

/// In an object of a specification with fixed keys, the key `comment` may have any content; in an object whose keys are
/// names, it is a name.
#[test]
fn comments_and_the_address_of_the_schema_are_passed_over() {
    let remark = json!("why it is so");
    let mut document = block();
    document["$schema"] = json!("http://localhost:8080/schema");
    for pointer in [
        "",
        "/time",
        "/problem",
        "/problem/dvi",
        "/problem/dvi/states/x",
        "/problem/dvi/set/0",
        "/problem/dvi/set/0/box",
    ] {
        document.pointer_mut(pointer).unwrap()["comment"] = remark.clone();
    }
    let specification = Specification::from_json(document.to_string().as_bytes()).unwrap();
    assert_eq!(
        specification.model().state_names(),
        Specification::from_json(block().to_string().as_bytes()).unwrap().model().state_names()
    );
    // The key `comment` is also ignored beside the member that names the type of a problem, here one with vectors.
    let vectors = json!({"parameters": {"n": 2}, "states": {"x[1..n]": {"initial": 1, "rate": "-x[i]"}}});
    let vectors = json!({"problem": {"comment": "why", "dvi": vectors}, "time": {"end": 1}});
    assert!(Specification::from_json(vectors.to_string().as_bytes()).is_ok());
    let schema = json!({"initial": 0, "rate": "1"});
    let state = with(block(), "/problem/dvi/states/comment", schema);
    assert!(
        Specification::from_json(state.to_string().as_bytes())
            .unwrap()
            .model()
            .state_names()
            .contains(&"comment".to_owned())
    );
    let elsewhere = with(block(), "/time/$schema", json!("x"));
    assert_errors(&elsewhere, &[("/time/$schema", "unknown_key", "not a key here")]);
    assert_errors(&with(block(), "/$schema", json!(3)), &[("/$schema", "wrong_type", "expected a string")]);
}

#[test]
fn whole_numbers_must_be_whole_and_not_negative() {
    let document = json!({"name": "radau", "stages": 2.5});
    assert_errors(
        &with(block(), "/method", document),
        &[("/method/stages", "wrong_type", "found the number 2.5, expected a whole number from 1 to 9")],
    );
    let document = with(block(), "/output", json!({"times": {"count": -3}}));
    assert_errors(&document, &[("/output/times/count", "wrong_type", "found the number -3, expected a whole number")]);
}

#[test]
fn an_unknown_choice_of_a_word_suggests_the_nearest() {
    let document = with(block(), "/method", json!({"name": "radu"}));
    assert_suggestion(&document, "/method/name", "unknown_choice", "radau");
    let document = with(block(), "/method", json!({"vi_solver": "lemkee"}));
    assert_suggestion(&document, "/method/vi_solver", "unknown_choice", "lemke");
}

#[test]
fn a_missing_rate_and_a_missing_inequality_are_both_named() {
    let document = without(without(block(), "/problem/dvi/states/x/rate"), "/problem/dvi/variables/F/inequality");
    assert_errors(
        &document,
        &[
            ("/problem/dvi/states/x", "missing_key", "`rate` is missing"),
            ("/problem/dvi/variables/F", "missing_key", "`inequality` is missing"),
        ],
    );
}

#[test]
fn a_key_that_stands_twice_is_an_error() {
    let text = block().to_string().replace("\"end\":10", "\"end\":10,\"end\":11");
    assert_text(text, &[("/time/end", "duplicate_key", "occurs twice")]);
    let text = block().to_string().replace("\"v\":{", "\"x\":{\"initial\":0,\"rate\":\"x\"},\"v\":{");
    assert_text(text, &[("/problem/dvi/states/x", "duplicate_key", "occurs twice")]);
}

#[test]
fn a_sparse_entry_of_the_wrong_length_is_refused() {
    let sparse = json!({"shape": [2, 2], "entries": [[0, 0, 1], [1, 1]]});
    assert_errors(
        &with(block(), "/problem/dvi/mass", sparse),
        &[("/problem/dvi/mass/entries/1", "wrong_type", "found 2 entries, expected 3 entries")],
    );
}

#[test]
fn all_errors_of_a_document_come_in_one_answer() {
    let document = json!({
        "problem": {"dvi": {
            "parameters": {"k": "2*q", "sin": 3},
            "states": {"x": {"initial": 1, "rate": true}, "v": {"initial": "k", "rate": "-x", "colour": 1}},
            "variables": {"F": {}},
            "set": []
        }},
        "time": {"start": 5, "end": 5},
        "method": {"rtol": "small", "stages": 4, "nmae": "radau"},
        "output": {"times": {"count": 1}, "feilds": ["x"]},
        "limits": {"wall_seconds": -1},
        "label": 7
    });
    let errors = errors_of(document.to_string());
    let mut pointers: Vec<_> = errors.iter().map(|error| (error.pointer.as_str(), error.code)).collect();
    pointers.sort_unstable();
    assert_eq!(
        pointers,
        [
            ("/label", "wrong_type"),
            ("/limits/wall_seconds", "out_of_range"),
            ("/method/nmae", "unknown_key"),
            ("/method/rtol", "wrong_type"),
            ("/method/stages", "even_stages_need_step"),
            ("/output/feilds", "unknown_key"),
            ("/output/times/count", "out_of_range"),
            ("/problem/dvi/parameters/k", "unknown_name"),
            ("/problem/dvi/parameters/sin", "reserved_name"),
            ("/problem/dvi/states/v/colour", "unknown_key"),
            ("/problem/dvi/states/x/rate", "wrong_type"),
            ("/problem/dvi/variables/F", "missing_key"),
            ("/time/end", "end_before_start"),
        ],
        "{errors:#?}"
    );
}

#[test]
fn of_a_thousand_errors_a_hundred_are_listed() {
    let mut document = linear();
    document["problem"]["lcs"]["a"] = (0..1000).map(|_| "q").collect();
    let errors = errors_of(document.to_string());
    assert_eq!(errors.len(), 101);
    assert_eq!(errors[99].pointer, "/problem/lcs/a/98");
    assert_eq!((errors[100].pointer.as_str(), errors[100].code), ("", "more_errors"));
}
