//! Problems that cannot be solved as posed are refused with the reason and a remedy.

use crate::documents::assert_errors;
use dvi::problem::Control;
use dvi::specification::Specification;
use serde_json::{Value, json};

/// Returns a chain of integrators: the rate of the first state depends on `z`, and the inequality is the state after
/// `distance` further integrations.
fn chain(distance: usize) -> Value {
    let state = ["a", "b", "c"][distance];
    json!({
        "problem": {"dvi": {
            "states": {
                "a": {"initial": 1, "rate": "z - 1"},
                "b": {"initial": 1, "rate": "a"},
                "c": {"initial": 1, "rate": "b"}
            },
            "variables": {"z": {"inequality": state}},
            "set": [{"nonnegative": ["z"]}]
        }},
        "time": {"end": 1}
    })
}

#[test]
fn index_one_is_accepted() {
    let specification = Specification::from_json(chain(0).to_string().as_bytes()).unwrap();
    assert_eq!(specification.analysis().index, Some(1.0));
}

#[test]
fn index_two_with_a_bound_needs_implicit_euler() {
    let mut document = chain(1);
    assert_errors(&document, &[("/method", "index_two_needs_euler", "the index is 2")]);
    document["method"] = json!({"stages": 1, "step": 0.001});
    let specification = Specification::from_json(document.to_string().as_bytes()).unwrap();
    // The state b = 1 + t - t^2/2 of the chain vanishes at t = 1 + sqrt 3: no bound is reached before the end t = 1.
    let solution = dvi::solve(&specification, &Control::new());
    let b = *solution.trajectory.field("b").unwrap().last().unwrap();
    assert!((b - 1.5).abs() < 1e-3, "b = {b}");
}

#[test]
fn index_two_lands_on_its_bound_by_an_impulse() {
    let mut document = chain(1);
    document["time"]["end"] = json!(4);
    document["method"] = json!({"stages": 1, "step": 0.001});
    let specification = Specification::from_json(document.to_string().as_bytes()).unwrap();
    let solution = dvi::solve(&specification, &Control::new());
    let end = |name: &str| *solution.trajectory.field(name).unwrap().last().unwrap();
    // After the inelastic impact the state b rests at zero, its velocity a vanishes, and the force z balances the
    // weight.
    assert!(end("b").abs() < 1e-12 && end("a").abs() < 1e-9, "b = {}, a = {}", end("b"), end("a"));
    assert!((end("z") - 1.0).abs() < 1e-9, "z = {}", end("z"));
}

#[test]
fn index_three_is_refused_unless_accepted() {
    let mut document = chain(2);
    assert_errors(&document, &[("/problem", "index_too_high", "the index is 3")]);
    document["method"] = json!({"accept_index_three": true});
    assert!(Specification::from_json(document.to_string().as_bytes()).is_ok());
}

#[test]
fn a_simplex_is_analysed_on_the_plane_it_lies_in() {
    // Three regions of a Filippov system with unit velocities at 120 degrees: in the directions e_2 - e_1 and e_3 -
    // e_1 of the simplex, the matrix CB is [[3, 3/2], [3/2, 3]].
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/api/examples/three_regions.json");
    let specification = Specification::from_json(&std::fs::read(path).unwrap()).unwrap();
    let analysis = specification.analysis();
    assert_eq!((analysis.index, analysis.levels.as_slice()), (Some(1.0), &[0, 2][..]));
    assert!(analysis.because.contains("least eigenvalue 1.500e0"), "{}", analysis.because);
}

#[test]
fn the_index_of_a_differential_algebraic_equation_is_told_in_both_ways_of_counting() {
    // The algebraic equation 0 = y - x^2 determines y without differentiation, and y' after one.
    let states = json!({"x": {"initial": 1, "rate": "-y"}, "y": {"initial": 1, "rate": "y - x^2"}});
    let dvi = json!({"states": states, "mass": [[1, 0], [0, 0]]});
    let document = json!({"problem": {"dvi": dvi}, "time": {"end": 3}}).to_string();
    let specification = Specification::from_json(document.as_bytes()).unwrap();
    let analysis = specification.analysis();
    assert_eq!(analysis.index, Some(0.0));
    let because = &analysis.because;
    assert!(because.contains("0 times") && because.contains("differentiation index 1"), "{because}");
}

#[test]
fn what_is_bounded_has_no_impulses_whatever_its_index() {
    // A bounded force `z`, which appears only in the second or third derivative of the state that the inequality
    // contains.
    for distance in [1, 2] {
        let mut document = chain(distance);
        for set in
            [json!([{"box": {"of": ["z"], "lower": 0, "upper": 3}}]), json!([{"ball": {"of": ["z"], "radius": 2}}])]
        {
            document["problem"]["dvi"]["set"] = set;
            let specification = Specification::from_json(document.to_string().as_bytes()).unwrap();
            assert_eq!(specification.analysis().index, Some(1.0 + distance as f64));
        }
        // Without an upper bound, the force `z` is unbounded, and impulses are possible again.
        document["problem"]["dvi"]["set"] = json!([{"nonnegative": ["z"]}]);
        assert!(Specification::from_json(document.to_string().as_bytes()).is_err());
    }
}
