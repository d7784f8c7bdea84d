//! The member `view` of a specification: its points and segments are checked like the rest of the document, and have
//! no effect on the solution.

use crate::documents::{assert_errors, block, with};
use dvi::problem::Control;
use dvi::specification::Specification;
use serde_json::json;

#[test]
fn every_error_of_a_view_is_reported_at_its_place() {
    let view = json!({
        "points": {"a": [0, "x"], "b": [1], "c": ["nothing", 2, 0.1], "d": [0, "2*"]},
        "segments": [["a", "e"], ["a"]],
        "colour": "red"
    });
    assert_errors(
        &with(block(), "/view", view),
        &[
            ("/view/colour", "unknown_key", ""),
            ("/view/points/b", "wrong_count", "found 1 entries"),
            ("/view/points/c/0", "unknown_name", ""),
            ("/view/points/d/1", "syntax", ""),
            ("/view/segments/0/1", "unknown_name", "`e` is not a point of this view"),
            ("/view/segments/1", "wrong_count", "found 1 entries"),
        ],
    );
}

#[test]
fn a_view_changes_nothing_of_the_answer() {
    let solve = |document: serde_json::Value| {
        let specification = Specification::from_json(document.to_string().as_bytes()).unwrap();
        dvi::solve(&specification, &Control::new()).trajectory
    };
    let view = json!({"points": {"a": ["x", "t"], "b": [0, 0, 1]}, "segments": [["a", "b"]]});
    let (with_view, without) = (solve(with(block(), "/view", view)), solve(block()));
    for field in ["x", "v", "F"] {
        assert!(with_view.field(field).is_some_and(|column| column.len() > 2), "{field}");
        assert_eq!(with_view.field(field), without.field(field), "{field}");
    }
}
