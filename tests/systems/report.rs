//! The statistics of a run: rejected steps and their reasons, and the convergence rate of Newton's method.

use super::harness::solve;
use super::reference::example;
use dvi::problem::Control;
use dvi::solution::Diagnostics;
use dvi::specification::Specification;
use serde_json::{Value, json};

fn run(states: &Value, end: f64) -> Diagnostics {
    let text = json!({"problem": {"dvi": {"states": states}}, "time": {"end": end}}).to_string();
    dvi::solve(&Specification::from_json(text.as_bytes()).unwrap(), &Control::new()).diagnostics
}

#[test]
fn every_rejection_has_its_reason() {
    let steps = solve(&example("van_der_pol")).diagnostics.steps;
    assert!(steps.rejected > 0 && steps.rejected_for.contains_key("error_test"), "{steps:?}");
    assert_eq!(steps.rejected, steps.rejected_for.values().sum::<u64>());
    // Steps across t = 2, where the solution x = (1 - t/2)^2 is zero, evaluate the square root of a negative number.
    let root = run(&json!({"x": {"initial": 1, "rate": "-sqrt(x)"}}), 3.0).steps;
    assert!(root.rejected_for.get("not_finite").is_some_and(|times| *times == root.rejected), "{root:?}");
}

#[test]
fn newton_converges_at_once_on_a_linear_problem_and_linearly_on_others() {
    let linear = run(&json!({"x": {"initial": 1, "rate": "-x"}}), 5.0);
    assert!(linear.newton_contraction.is_none_or(|seen| seen.largest < 1e-10), "{linear:?}");
    let curved = run(&json!({"x": {"initial": 1, "rate": "-x^3"}}), 5.0);
    let seen = curved.newton_contraction.unwrap();
    assert!(0.0 < seen.mean && seen.mean <= seen.largest && 1e-6 < seen.largest && seen.largest < 1.0, "{seen:?}");
}
